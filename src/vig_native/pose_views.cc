#include "pose_views.h"

#include "least_squares.h"

namespace vig {

double score_view(const Views& views, const ViewPhoto& photo, const PlacedView& placed, float outline, float unseen) {
    const int size = views.size, area = size * size;
    const size_t pixels = (size_t)photo.height * photo.width;
    const float* const view = views.planes + (size_t)placed.view * Views::PLANES * area;
    double matrix[3][10] = {}, right[3][4] = {}, squares[3] = {}, seen = 0, covered = 0;
    for (int j = 0, place = 0; j < size; ++j)
        for (int i = 0; i < size; ++i, ++place) {
            const float coverage = view[place];
            if (coverage <= 0)
                continue;
            covered += coverage;
            const float x = i + 0.5f - size * 0.5f, y = j + 0.5f - size * 0.5f;
            const float column = placed.cos * x - placed.sin * y + placed.x - 0.5f;
            const float row = placed.sin * x + placed.cos * y + placed.y - 0.5f;
            const int left = (int)std::floor(column), top = (int)std::floor(row);
            if (left < 0 || top < 0 || left >= photo.width - 1 || top >= photo.height - 1)
                continue;
            const float fx = column - left, fy = row - top;
            const auto at = [&](int plane) {
                const float* const p = photo.planes + plane * pixels + (size_t)top * photo.width + left;
                return (p[0] * (1 - fx) + p[1] * fx) * (1 - fy) + (p[photo.width] * (1 - fx) + p[photo.width + 1] * fx) * fy;
            };
            const float weight = coverage * at(3);
            if (weight <= 1e-3f)
                continue;
            seen += weight;
            // The photo's colour is the view's times a gain and a light from one side.
            const float terms[4] = {1, view[4 * area + place], view[5 * area + place], view[6 * area + place]};
            for (int c = 0; c < 3; ++c) {
                const float colour = view[(1 + c) * area + place], observed = at(c);
                const float once = weight * colour, twice = once * colour;
                for (int r = 0, n = 0; r < 4; ++r) {
                    right[c][r] += once * terms[r] * observed;
                    for (int s = r; s < 4; ++s)
                        matrix[c][n++] += twice * terms[r] * terms[s];
                }
                squares[c] += weight * observed * observed;
            }
        }
    double log_errors = 0;
    for (int c = 0; c < 3; ++c) {
        double full[4][4], rows[4][5], solution[4];
        for (int r = 0, n = 0; r < 4; ++r)
            for (int s = r; s < 4; ++s)
                full[r][s] = full[s][r] = matrix[c][n++];
        for (int r = 0; r < 4; ++r) {
            for (int s = 0; s < 4; ++s)
                rows[r][s] = full[r][s] + (r == s) * (matrix[c][0] + 1e-9) * (r == 0 ? 1e-6 : 0.05);
            rows[r][4] = right[c][r];
        }
        solve(rows, solution);
        double error = squares[c];
        for (int r = 0; r < 4; ++r) {
            error -= 2 * solution[r] * right[c][r];
            for (int s = 0; s < 4; ++s)
                error += solution[r] * full[r][s] * solution[s];
        }
        log_errors += std::log((std::max(error, 0.0) + 1e-4 * seen) / (seen + 1e-6));
    }
    const double beyond = std::max(0.0, photo.total_seen / ((double)placed.scale * placed.scale) - seen);
    const double overlap = seen / (seen + beyond + unseen * (covered - seen) + 1e-6);
    return -0.5 * log_errors + outline * std::log(overlap + 1e-3);
}

}  // namespace vig
