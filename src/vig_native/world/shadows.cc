#include "shadows.h"

#include <algorithm>
#include <cmath>

namespace vig::world {
namespace {

constexpr float SHADOW_CELL = 0.016f;            // metres
constexpr int SHADOW_SIZE[3] = {80, 80, 21};     // cells along x and y, centred at the object, and planes from z = 0 up
constexpr float RISE[2] = {0.010f, 0.0006f};     // 1 cm between planes at first, 3 cm at the top, 0.44 m up
constexpr float LARGEST = 0.4f;                  // metres of an object from its origin; beyond, the grid grows with it

// Add the area of an item's surface to the cells that it lies in, from the points scattered over it.
void scatter(const Grid& grid, std::vector<float>& opacity, const Item& item) {
    const int X = grid.size[0], Y = grid.size[1], Z = grid.size[2] - 1;
    const float inverse = 1 / grid.cell;
    const Mat3<float> R = to_single(item.rotation);
    const Vec3<float> T = Vec3<float>{(float)item.translation.x, (float)item.translation.y, (float)item.translation.z}
        - grid.origin;
    for (size_t n = 0; n < item.asset->points.size(); n += 4) {
        const float* const p = &item.asset->points[n];
        const Vec3<float> at = R * load3(p) + T;
        const float x = at.x * inverse, y = at.y * inverse, z = grid.plane_of(at.z);
        if (!(x >= 1 && x < X - 2 && y >= 1 && y < Y - 2 && z < Z && at.z > -GROUND_DEPTH))
            continue;
        const int ix = (int)x, iy = (int)y, iz = (int)z;
        // Flat things on the ground cast no shadow beside them: weights fall to 0 there.
        const float weight = p[3] * inverse * inverse * std::clamp(at.z / (0.5f * grid.rise[0]), 0.0f, 1.0f);
        const float fx = x - ix, fy = y - iy;
        float* const here = &opacity[((size_t)iz * Y + iy) * X + ix];
        here[0] += weight * (1 - fx) * (1 - fy);
        here[1] += weight * fx * (1 - fy);
        here[X] += weight * (1 - fx) * fy;
        here[X + 1] += weight * fx * fy;
    }
}

// From -limit to limit, NaN too.
float bounded(float value, float limit) { return value > -limit ? value < limit ? value : limit : -limit; }

}  // namespace

void cast_shadows(SweepSpace& space, const std::vector<Item>& items, const Sky& sky, float reach) {
    Grid& grid = space.grid;
    const float scale = std::max(1.0f, reach / LARGEST);
    std::copy_n(SHADOW_SIZE, 3, grid.size);
    grid.cell = SHADOW_CELL * scale;
    grid.rise[0] = RISE[0] * scale;
    grid.rise[1] = RISE[1] * scale;
    grid.origin = {-grid.cell * (SHADOW_SIZE[0] - 1) / 2, -grid.cell * (SHADOW_SIZE[1] - 1) / 2, 0};
    space.opacity.assign(SHADOW_SIZE[0] * SHADOW_SIZE[1] * (SHADOW_SIZE[2] - 1), 0);
    for (const Item& item : items)
        if (!item.is_support)
            scatter(grid, space.opacity, item);
    sweep(space, sky, 0);
}

void sweep(SweepSpace& space, const Sky& sky, float reach) {
    Grid& grid = space.grid;
    const int X = grid.size[0], Y = grid.size[1], Z = grid.size[2] - 1, K = sky.count;
    const int wide = X + 2 * SWEEP_MARGIN;
    const size_t plane_size = (size_t)wide * (Y + 2 * SWEEP_MARGIN), cells = (size_t)X * Y;
    grid.values.assign((Z + 1) * cells * 4, 0);
    space.planes.assign(2 * K * plane_size, 0);
    float* const gathered = grow(space.gathered, 4 * cells);
    float most = 0;
    for (int c = 0; c < 4; ++c) {
        float sum = 0;
        for (int k = 0; k < K; ++k)
            sum += std::abs(sky.weights[4 * k + c]);
        most = std::max(most, sum);
    }
    grid.scale = most / 32000 + 1e-12f;
    struct Move {
        ptrdiff_t by;
        float shares[4];
    };
    std::vector<Move> moves(K);
    // The cells of a plane that something shades, whole lanes of them; the others keep the zeros that they hold.
    int first_x = X, end_x = 0, first_y = Y, end_y = 0;
    for (int s = Z - 1; s >= 0; --s) {
        float* const opaque = &space.opacity[s * cells];
        const float step = grid.rise[0] + grid.rise[1] * (2 * s + 1);
        const float kept = reach > 0 ? std::exp(-step / reach) : 1;
        int furthest = 0;  // cells that shadows move at most
        for (int k = 0; k < K; ++k) {
            const float move_x = bounded(sky.slopes[2 * k] * step / grid.cell, SWEEP_MARGIN - 2);
            const float move_y = bounded(sky.slopes[2 * k + 1] * step / grid.cell, SWEEP_MARGIN - 2);
            const int whole_x = (int)std::floor(move_x), whole_y = (int)std::floor(move_y);
            const float fx = move_x - whole_x, fy = move_y - whole_y;
            furthest = std::max({furthest, 1 + std::abs(whole_x), 1 + std::abs(whole_y)});
            moves[k] = {(ptrdiff_t)(k * plane_size) + whole_y * wide + whole_x,
                        {kept * (1 - fx) * (1 - fy), kept * fx * (1 - fy), kept * (1 - fx) * fy, kept * fx * fy}};
        }
        if (end_x > 0) {
            first_x = std::max(0, (first_x - furthest) / LANES * LANES);
            end_x = std::min(X, (end_x + furthest + LANES - 1) / LANES * LANES);
            first_y = std::max(0, first_y - furthest);
            end_y = std::min(Y, end_y + furthest);
        }
        for (int y = 0; y < Y; ++y)
            for (int x = 0; x < X; x += LANES) {
                float* const here = opaque + (size_t)y * X + x;
                int any = 0;
                for (int lane = 0; lane < LANES; ++lane) {
                    here[lane] = here[lane] < 1 ? here[lane] : 1;
                    any |= here[lane] > 0;
                }
                if (any) {
                    first_x = std::min(first_x, x);
                    end_x = std::max(end_x, x + LANES);
                    first_y = std::min(first_y, y);
                    end_y = std::max(end_y, y + 1);
                }
            }
        if (!end_x)
            continue;
        // Planes of shadow alternate between two halves of the memory.
        const float* const before = space.planes.data() + (s & 1 ? K * plane_size : 0);
        float* const after = space.planes.data() + (s & 1 ? 0 : K * plane_size);
        for (int y = first_y; y < end_y; ++y)
            for (int x = first_x; x < end_x; x += LANES) {
                const Lanes<float> here = lanes_at<float>((const float*)opaque + (size_t)y * X + x), clear = 1 - here;
                Lanes<float> lost[4] = {};
                const size_t place = (size_t)(y + SWEEP_MARGIN) * wide + SWEEP_MARGIN + x;
                for (int k = 0; k < K; ++k) {
                    const float* const from = before + place + moves[k].by;
                    const float* const w = moves[k].shares;
                    const Lanes<float> above = w[0] * lanes_at(from) + w[1] * lanes_at(from + 1) + w[2] * lanes_at(from + wide)
                        + w[3] * lanes_at(from + wide + 1);
                    const Lanes<float> dark = here + above * clear;
                    lanes_at(after + place + k * plane_size) = dark;
                    for (int c = 0; c < 4; ++c)
                        lost[c] += sky.weights[4 * k + c] * dark;
                }
                for (int c = 0; c < 4; ++c)
                    lanes_at(gathered + c * cells + (size_t)y * X + x) = lost[c];
            }
        // Nothing is lost at the grid's border, and so beyond it.
        int16_t* const out = &grid.values[s * cells * 4];
        const float stored = 1 / grid.scale;
        for (int y = std::max(first_y, 1); y < std::min(end_y, Y - 1); ++y)
            for (int n = y * X + std::max(first_x, 1); n < y * X + std::min(end_x, X - 1); ++n)
                for (int c = 0; c < 4; ++c)
                    out[4 * n + c] = (int16_t)(gathered[c * cells + n] * stored);
    }
}

}  // namespace vig::world
