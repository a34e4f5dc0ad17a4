// Sweeps planes of shadow down through a grid, one for each direction of light; see `shadows.py`.
//
// The body of a function of `Sweep* const task`; `native.py` puts the declarations before it.

const Grid& grid = task->grid;
const int X = grid.size[0], Y = grid.size[1], Z = grid.size[2] - 1, K = task->direction_count;
const int wide = X + 2 * SWEEP_MARGIN, high = Y + 2 * SWEEP_MARGIN;
const size_t plane_size = (size_t)wide * high;
float* const occupancy = (float*)task->occupancy;
float* const planes = (float*)task->planes;
float* const gathered = (float*)task->gathered;
const float* const directions = (const float*)task->directions;
const float* const weights = (const float*)task->weights;
short* const values = (short*)grid.values;
typedef float Floats __attribute__((ext_vector_type(SWEEP_LANES), aligned(4)));
long long move[MOST_DIRECTIONS];
float share[MOST_DIRECTIONS][4];
const float stored = 1 / grid.scale, inverse = 1 / grid.cell;
// The cells of a plane that something shades, whole lanes of them; the others keep the zeros that they hold.
int first_x = X, end_x = 0, first_y = Y, end_y = 0;
for (size_t n = 0; n < (size_t)(Z + 1) * X * Y * 4; ++n)
    values[n] = 0;
for (size_t n = 0; n < 2 * K * plane_size; ++n)
    planes[n] = 0;
for (int s = Z - 1; s >= 0; --s) {
    float* const opaque = occupancy + (size_t)s * X * Y;
    const float step = grid.rise[0] + grid.rise[1] * (2 * s + 1);
    const float kept = task->reach > 0 ? expf(-step / task->reach) : 1;
    int reach = 0;  // cells that shadows move at most
    for (int k = 0; k < K; ++k) {
        const float move_x = directions[2 * k] * step * inverse;
        const float move_y = directions[2 * k + 1] * step * inverse;
        const int whole_x = (int)floorf(move_x), whole_y = (int)floorf(move_y);
        const float fx = move_x - whole_x, fy = move_y - whole_y;
        reach = wp::max(reach, 1 + wp::max(abs(whole_x), abs(whole_y)));
        move[k] = k * plane_size + whole_y * wide + whole_x;
        share[k][0] = kept * (1 - fx) * (1 - fy);
        share[k][1] = kept * fx * (1 - fy);
        share[k][2] = kept * (1 - fx) * fy;
        share[k][3] = kept * fx * fy;
    }
    if (end_x > 0) {
        first_x = wp::max(0, (first_x - reach) / SWEEP_LANES * SWEEP_LANES);
        end_x = wp::min(X, (end_x + reach + SWEEP_LANES - 1) / SWEEP_LANES * SWEEP_LANES);
        first_y = wp::max(0, first_y - reach);
        end_y = wp::min(Y, end_y + reach);
    }
    for (int y = 0; y < Y; ++y)
        for (int x = 0; x < X; x += SWEEP_LANES) {
            float* const here = opaque + (size_t)y * X + x;
            int any = 0;
            for (int lane = 0; lane < SWEEP_LANES; ++lane) {
                here[lane] = here[lane] < 1 ? here[lane] : 1;
                any |= here[lane] > 0;
            }
            if (any) {
                first_x = wp::min(first_x, x);
                end_x = wp::max(end_x, x + SWEEP_LANES);
                first_y = wp::min(first_y, y);
                end_y = wp::max(end_y, y + 1);
            }
        }
    if (!end_x)
        continue;
    // Planes of shadow alternate between two halves of the scratch memory. Sixteen cells at once.
    const float* const before = planes + (s & 1 ? K * plane_size : 0);
    float* const after = planes + (s & 1 ? 0 : K * plane_size);
    for (int y = first_y; y < end_y; ++y)
        for (int x = first_x; x < end_x; x += SWEEP_LANES) {
            const Floats here = *(const Floats*)(opaque + (size_t)y * X + x), clear = 1 - here;
            Floats g0 = 0, g1 = 0, g2 = 0, g3 = 0;
            const size_t place = (size_t)(y + SWEEP_MARGIN) * wide + SWEEP_MARGIN + x;
            for (int k = 0; k < K; ++k) {
                const float* const from = before + place + move[k];
                const float* const w = share[k];
                const float* const c = weights + 4 * k;
                const Floats above = w[0] * *(const Floats*)from + w[1] * *(const Floats*)(from + 1)
                    + w[2] * *(const Floats*)(from + wide) + w[3] * *(const Floats*)(from + wide + 1);
                const Floats dark = here + above * clear;
                *(Floats*)(after + place + k * plane_size) = dark;
                g0 += c[0] * dark;
                g1 += c[1] * dark;
                g2 += c[2] * dark;
                g3 += c[3] * dark;
            }
            float* const gather = gathered + (size_t)y * X + x;
            *(Floats*)gather = g0;
            *(Floats*)(gather + X * Y) = g1;
            *(Floats*)(gather + 2 * X * Y) = g2;
            *(Floats*)(gather + 3 * X * Y) = g3;
        }
    short* const out = values + (size_t)s * X * Y * 4;
    for (int y = first_y; y < end_y; ++y)
        for (int n = y * X + first_x; n < y * X + end_x; ++n)
            for (int c = 0; c < 4; ++c)
                out[4 * n + c] = (short)(gathered[c * X * Y + n] * stored);
    // Nothing is lost at the grid's border, and so beyond it.
    for (int y = 0; y < Y; ++y)
        for (int x = 0; x < X; x += y == 0 || y == Y - 1 ? 1 : X - 1)
            for (int c = 0; c < 4; ++c)
                out[4 * (y * X + x) + c] = 0;
}
