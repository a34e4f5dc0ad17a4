#include "pose.h"

#include <array>

#include "least_squares.h"
#include "softplus.h"

namespace vig {

namespace {

Vec3<float> texture_at(const TexturedMesh& mesh, int face, float u, float v, float octave) {
    const Texture& texture = mesh.textures[mesh.texture_of_face[face]];
    const int last = (int)texture.levels.size() - 1;
    const int number = (int)std::clamp(mesh.octave[face] + octave + 0.5f, 0.0f, (float)last);
    const Texture::Level& level = texture.levels[number];
    const float x = (u - std::floor(u)) * level.width - 0.5f, y = (1 - (v - std::floor(v))) * level.height - 0.5f;
    const int left = (int)std::floor(x), top = (int)std::floor(y);
    const float across = x - left, down = y - top;
    const int x0 = std::max(left, 0), x1 = std::min(left + 1, level.width - 1);
    const int y0 = std::max(top, 0), y1 = std::min(top + 1, level.height - 1);
    const auto at = [&](int row, int column) { return load3(&mesh.texels[level.first + 3 * ((size_t)row * level.width + column)]); };
    return (at(y0, x0) * (1 - across) + at(y0, x1) * across) * (1 - down) + (at(y1, x0) * (1 - across) + at(y1, x1) * across) * down;
}

// The rotation by a vector's length about it (Rodrigues).
Mat3<float> rotation_by(const double* turn) {
    const double angle = std::sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);
    const double s = angle > 1e-9 ? std::sin(angle) / angle : 1, c = angle > 1e-9 ? (1 - std::cos(angle)) / (angle * angle) : 0.5;
    const double x = turn[0], y = turn[1], z = turn[2];
    return {{{float(1 - c * (y * y + z * z)), float(c * x * y - s * z), float(c * x * z + s * y)},
             {float(c * x * y + s * z), float(1 - c * (x * x + z * z)), float(c * y * z - s * x)},
             {float(c * x * z - s * y), float(c * y * z + s * x), float(1 - c * (x * x + y * y))}}};
}

Mat3<float> product(const Mat3<float>& a, const Mat3<float>& b) {
    Mat3<float> out;
    for (int i = 0; i < 3; ++i)
        out.row[i] = b.transposed(a.row[i]);
    return out;
}

// LANES pixels side by side: photo less surface in log colours, normals, weights.
struct Rows {
    float residual[3][LANES], normal[3][LANES], weight[LANES];
};

// The normal equations of gains and a light's slope, lane by lane, and the log-likelihood.
struct LightSums {
    Lanes<float> weight, by_channel[3], by_normal[3], sides[3], squares[6], likelihood;

    // Weigh each pixel by its probability to show the surface, or all alike.
    void add(const Rows& rows, const float* light, float half_inlier, float log_odds, bool alike) {
        float square[LANES], t[LANES], r[LANES], log_1_r[LANES], w[LANES], nat[LANES], sum[LANES];
        for (int n = 0; n < LANES; ++n) {
            const float side = light[3] * rows.normal[0][n] + light[4] * rows.normal[1][n] + light[5] * rows.normal[2][n];
            const float x = rows.residual[0][n] - light[0] - side, y = rows.residual[1][n] - light[1] - side;
            const float z = rows.residual[2][n] - light[2] - side;
            square[n] = x * x + y * y + z * z;
            const float far = std::abs(square[n] * (half_inlier - 0.5f) + log_odds);
            t[n] = far < 80 ? far : 80;
        }
        softplus(t, r, log_1_r);
        for (int n = 0; n < LANES; ++n) {
            const float inside = -square[n] * half_inlier, outside = log_odds - 0.5f * square[n], most = 1 / (1 + r[n]);
            const float share = outside > inside ? r[n] * most : most;
            nat[n] = rows.weight[n] * ((outside > inside ? outside : inside) + log_1_r[n]);
            w[n] = rows.weight[n] * (alike ? 1.0f : share + (1 - share) * 0.5f / half_inlier);
            sum[n] = rows.residual[0][n] + rows.residual[1][n] + rows.residual[2][n];
        }
        const auto& in = lanes_at(w);
        weight += in;
        likelihood += lanes_at(nat);
        for (int k = 0, pair = 0; k < 3; ++k) {
            const Lanes<float> along = in * lanes_at(rows.normal[k]);
            by_channel[k] += in * lanes_at(rows.residual[k]);
            by_normal[k] += along;
            sides[k] += along * lanes_at(sum);
            for (int l = k; l < 3; ++l)
                squares[pair++] += along * lanes_at(rows.normal[l]);
        }
    }

    // Fill the equations; return the log-likelihood.
    double fill(double (&rows)[6][7]) const {
        constexpr int COUNT = sizeof(LightSums) / sizeof(Lanes<float>);
        float sums[COUNT];
        sum_rows<COUNT, float>(&weight, sums);
        for (int k = 0, pair = 10; k < 3; ++k) {
            rows[k][k] = sums[0];
            rows[k][6] = sums[1 + k];
            for (int c = 0; c < 3; ++c)
                rows[c][3 + k] = rows[3 + k][c] = sums[4 + k];
            rows[3 + k][6] = sums[7 + k];
            for (int l = k; l < 3; ++l)
                rows[3 + k][3 + l] = rows[3 + l][3 + k] = 3 * sums[pair++];
        }
        return sums[16];
    }
};

}  // namespace

bool draw_pose(const TexturedMesh& mesh, const PosePhoto& photo, const RigidPose& pose, PoseScratch& scratch, float* bounds) {
    const int width = photo.width * SAMPLES, height = photo.height * SAMPLES;
    scratch.screen.resize(3 * (size_t)mesh.vertices);
    scratch.facing.resize(mesh.faces);
    std::fill_n(bounds, 4, 0.0f);
    for (int v = 0; v < mesh.vertices; ++v) {
        const Vec3<float> point = pose.rotation * load3(&mesh.positions[3 * (size_t)v]) + pose.translation;
        if (!(point.z > 1e-3f))
            return false;
        const float q = 1 / point.z, x = photo.focal * point.x * q + photo.cx, y = photo.focal * point.y * q + photo.cy;
        store3(&scratch.screen[3 * (size_t)v], {x * SAMPLES, y * SAMPLES, q});
        bounds[0] = v ? std::min(bounds[0], x) : x;
        bounds[1] = v ? std::max(bounds[1], x) : x;
        bounds[2] = v ? std::min(bounds[2], y) : y;
        bounds[3] = v ? std::max(bounds[3], y) : y;
    }
    scratch.seen.clear(width * height);
    draw_faces(scratch.screen.data(), mesh.corners.data(), mesh.faces, width, height, mesh.closed, scratch.seen, scratch.facing.data());
    scratch.pixels.clear();
    const float octave = std::log2(photo.metres_per_pixel);
    const int top = std::clamp((int)std::floor(bounds[2]), 0, photo.height), bottom = std::clamp((int)std::ceil(bounds[3]), 0, photo.height);
    const int left = std::clamp((int)std::floor(bounds[0]), 0, photo.width), right = std::clamp((int)std::ceil(bounds[1]), 0, photo.width);
    for (int y = top; y < bottom; ++y)
        for (int x = left; x < right; ++x) {
            static_assert(SAMPLES == 2);
            int covered = 0, shaded = 0;
            Vec3<float> colour{}, normal{};
            for (const int sample : {0, 3, 1, 2}) {  // two on a diagonal tell the colour, others where these are not covered
                const int column = x * SAMPLES + sample % SAMPLES, row = y * SAMPLES + sample / SAMPLES;
                const int face = scratch.seen.face[(size_t)row * width + column];
                if (face == NO_FACE)
                    continue;
                ++covered;
                if (shaded > 0 && sample != 3)
                    continue;
                ++shaded;
                const Fragment<float> here = fragment_at(scratch.screen.data(), mesh.corners.data(), face, column, row);
                float u = 0, v = 0;
                for (int k = 0; k < 3; ++k) {
                    const size_t corner = mesh.corners[3 * (size_t)face + k];
                    u += here.weights[k] * mesh.uv[6 * (size_t)face + 2 * k];
                    v += here.weights[k] * mesh.uv[6 * (size_t)face + 2 * k + 1];
                    normal = normal + load3(&mesh.normals[3 * corner]) * here.weights[k];
                }
                colour = colour + texture_at(mesh, face, u, v, octave);
            }
            if (covered == 0)
                continue;
            scratch.pixels.push_back({y * photo.width + x, (float)covered / (SAMPLES * SAMPLES), colour * (1.0f / shaded),
                                      pose.rotation * (normal * (1.0f / shaded))});
        }
    return true;
}

double score_pose(const TexturedMesh& mesh, const PosePhoto& photo, const RigidPose& pose, PoseScratch& scratch, double* light,
                  float* inlier) {
    float bounds[4];
    if (!draw_pose(mesh, photo, pose, scratch, bounds))
        return -1e9;
    const PoseWeights& weights = photo.weights;
    const size_t area = (size_t)photo.width * photo.height;
    double covered = 0, seen = 0, beside = 0;
    int kept = 0;
    scratch.rows.resize((scratch.pixels.size() / LANES + 1) * sizeof(Rows) / sizeof(float));
    Rows* const rows_of = (Rows*)scratch.rows.data();
    for (const PosePixel& pixel : scratch.pixels) {
        covered += pixel.coverage;
        const float weight = pixel.coverage * photo.seen[pixel.place];
        if (weight <= 1e-3f)
            continue;
        seen += weight;
        if (!photo.surroundings.empty())
            beside += weight * photo.surroundings[pixel.place];
        Rows& rows = rows_of[kept / LANES];
        const int lane = kept++ % LANES;
        if (lane == 0)
            rows = {};
        for (int c = 0; c < 3; ++c) {
            rows.residual[c][lane] = photo.log_colour[c * area + pixel.place] - pixel.log_colour[c];
            rows.normal[c][lane] = pixel.normal[c];
        }
        rows.weight[lane] = weight;
    }
    if (seen < 4)
        return -1e6;
    // Noise of the log colours: a Gaussian of `sigma`, or, with the rest of `share`, one of deviation 1: of things in front,
    // highlights, wear. Reweighted least squares for the light.
    const double variance = weights.sigma * weights.sigma;
    const double odds = std::pow(weights.sigma, 3) * (1 - weights.share) / weights.share;
    const double gain_weight = variance * seen / (weights.pixels * weights.gain_deviation * weights.gain_deviation);
    const double slope_weight = variance * seen / (weights.pixels * weights.slope_deviation * weights.slope_deviation);
    const float half_inlier = float(0.5 / variance), log_odds = (float)std::log(odds);
    double by_light[6] = {}, likelihood = 0;
    constexpr int ROUNDS = 4;
    for (int round = 0; round <= ROUNDS; ++round) {
        float at[6];
        std::copy_n(by_light, 6, at);
        LightSums sums{};
        for (int block = 0; block * LANES < kept; ++block)
            sums.add(rows_of[block], at, half_inlier, log_odds, round == 0);
        double rows[6][7] = {};
        likelihood = sums.fill(rows);
        if (round == ROUNDS)
            break;
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j)  // gains of the channels are alike, whatever the exposure
                rows[i][j] += gain_weight * ((i == j) - 1.0 / 3) + (i == j) * 1e-4 * seen;
            rows[3 + i][3 + i] += slope_weight;
        }
        solve(rows, by_light);
    }
    const double mean = (by_light[0] + by_light[1] + by_light[2]) / 3;
    double prior = 0;
    for (int c = 0; c < 3; ++c) {
        prior += std::pow((by_light[c] - mean) / weights.gain_deviation, 2);
        prior += std::pow(by_light[3 + c] / weights.slope_deviation, 2);
    }
    double score = likelihood / seen;
    if (!photo.surroundings.empty()) {
        const double normaliser = std::log(weights.share / std::pow(weights.sigma, 3)) - 1.5 * std::log(2 * 3.14159265358979);
        score = weights.surroundings * (likelihood + normaliser * seen - beside);
    }
    score -= 0.5 * prior / weights.pixels;
    if (photo.outlined) {
        const double beyond = std::max(0.0, (double)photo.total_seen - seen);
        score += weights.outline * std::log(seen / (seen + beyond + weights.unseen * (covered - seen)) + 1e-3);
    }
    if (photo.boxed)
        for (int side = 0; side < 4; ++side) {
            const double off = (bounds[side] - photo.box[side]) / weights.box_deviation;
            score -= 0.5 * off * off / (1 + 0.02 * off * off);  // 25 at most for each side: boxes are drawn by hand
        }
    if (light)
        std::copy_n(by_light, 6, light);
    if (inlier) {
        std::fill_n(inlier, area, 0.0f);
        for (const PosePixel& pixel : scratch.pixels) {
            double square = 0;
            for (int c = 0; c < 3; ++c) {
                const double side = by_light[3] * pixel.normal.x + by_light[4] * pixel.normal.y + by_light[5] * pixel.normal.z;
                square += std::pow(photo.log_colour[c * area + pixel.place] - pixel.log_colour[c] - by_light[c] - side, 2);
            }
            const double inside = std::exp(-0.5 * square / variance), outside = odds * std::exp(-0.5 * square);
            inlier[pixel.place] = pixel.coverage * (float)(inside / (inside + outside + 1e-30));
        }
    }
    return score;
}

double refine_pose(const TexturedMesh& mesh, const PosePhoto& photo, RigidPose& pose, int evaluations, const float* steps,
                   PoseScratch& scratch) {
    constexpr int N = 6;
    typedef std::array<double, N> Point;
    const RigidPose start = pose;
    const auto moved = [&](const Point& x) {
        const double turn[3] = {x[0] * steps[0], x[1] * steps[0], x[2] * steps[0]};
        const float z = start.translation.z * (float)std::exp(x[5] * steps[2]);
        const float scale = z / start.translation.z;
        return RigidPose{product(rotation_by(turn), start.rotation),
                         {start.translation.x * scale + (float)(x[3] * steps[1]) * z, start.translation.y * scale + (float)(x[4] * steps[1]) * z, z}};
    };
    int left = evaluations;
    const auto cost = [&](const Point& x) {
        --left;
        return -score_pose(mesh, photo, moved(x), scratch);
    };
    std::array<Point, N + 1> simplex{};
    std::array<double, N + 1> costs{};
    for (int i = 0; i <= N; ++i) {
        if (i > 0)
            simplex[i][i - 1] = 1;
        costs[i] = cost(simplex[i]);
    }
    // Coefficients for this many unknowns: Gao and Han (2012).
    constexpr double EXPAND = 1 + 2.0 / N, CONTRACT = 0.75 - 0.5 / N, SHRINK = 1 - 1.0 / N;
    while (left > 0) {
        for (int i = 1; i <= N; ++i)  // by cost
            for (int j = i; j > 0 && costs[j] < costs[j - 1]; --j) {
                std::swap(costs[j], costs[j - 1]);
                std::swap(simplex[j], simplex[j - 1]);
            }
        if (costs[N] - costs[0] < 1e-3)
            break;
        Point middle{};
        for (int i = 0; i < N; ++i)
            for (int k = 0; k < N; ++k)
                middle[k] += simplex[i][k] / N;
        const auto along = [&](double factor) {
            Point x;
            for (int k = 0; k < N; ++k)
                x[k] = middle[k] + factor * (middle[k] - simplex[N][k]);
            return x;
        };
        const auto take = [&](const Point& x, double value) {
            simplex[N] = x;
            costs[N] = value;
        };
        const Point reflected = along(1);
        const double value = cost(reflected);
        if (value < costs[0]) {
            const Point expanded = along(EXPAND);
            const double further = cost(expanded);
            further < value ? take(expanded, further) : take(reflected, value);
        } else if (value < costs[N - 1]) {
            take(reflected, value);
        } else {
            const Point contracted = along(value < costs[N] ? CONTRACT : -CONTRACT);
            const double nearer = cost(contracted);
            if (nearer < std::min(value, costs[N])) {
                take(contracted, nearer);
            } else {
                for (int i = 1; i <= N; ++i) {
                    for (int k = 0; k < N; ++k)
                        simplex[i][k] = simplex[0][k] + SHRINK * (simplex[i][k] - simplex[0][k]);
                    costs[i] = cost(simplex[i]);
                }
            }
        }
    }
    const int best = (int)(std::min_element(costs.begin(), costs.end()) - costs.begin());
    pose = moved(simplex[best]);
    return -costs[best];
}

}  // namespace vig
