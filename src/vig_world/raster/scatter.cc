// Fills a grid with the area of the surfaces in each cell, from the points scattered over them.
//
// The body of a function of `Sweep* const task`; `native.py` puts the declarations before it.

const Grid& grid = task->grid;
const int X = grid.size[0], Y = grid.size[1], Z = grid.size[2] - 1;
float* const occupancy = (float*)task->occupancy;
for (int n = 0; n < X * Y * Z; ++n)
    occupancy[n] = 0;
const float inverse = 1 / grid.cell, area = task->opacity * inverse * inverse;
const float a = grid.rise[0], b = grid.rise[1];
for (int number = 0; number < task->item_count; ++number) {
    const Item& item = ((const Item*)task->items)[number];
    if (item.is_support)
        continue;
    const char* const asset = (const char*)item.asset;
    const Header& header = *(const Header*)asset;
    const float* const points = (const float*)(asset + header.points);
    float R[3][3], T[3];
    for (int r = 0; r < 3; ++r) {
        T[r] = item.translation[r] - grid.origin[r];
        for (int c = 0; c < 3; ++c)
            R[r][c] = item.rotation[r][c];
    }
    for (int n = 0; n < header.point_count; ++n) {
        const float* const p = points + 4 * n;
        const float x = (R[0][0] * p[0] + R[0][1] * p[1] + R[0][2] * p[2] + T[0]) * inverse;
        const float y = (R[1][0] * p[0] + R[1][1] * p[1] + R[1][2] * p[2] + T[1]) * inverse;
        const float height = R[2][0] * p[0] + R[2][1] * p[1] + R[2][2] * p[2] + T[2];
        const float above = height > 0 ? height : 0;
        const float z = 2 * above / (a + sqrtf(a * a + 4 * b * above));
        // Cells lie between planes; places along x and y are of cells' centres.
        if (!(x >= 1 && x < X - 2 && y >= 1 && y < Y - 2 && z < Z && height > -GROUND_DEPTH))
            continue;
        const int ix = x, iy = y, iz = z;
        // Flat things on the ground cast no shadow beside them: weights fall to 0 there.
        const float weight = p[3] * area * (above < 0.5f * a ? above / (0.5f * a) : 1);
        const float fx = x - ix, fy = y - iy;
        float* const here = occupancy + (size_t)(iz * Y + iy) * X + ix;
        here[0] += weight * (1 - fx) * (1 - fy);
        here[1] += weight * fx * (1 - fy);
        here[X] += weight * (1 - fx) * fy;
        here[X + 1] += weight * fx * fy;
    }
}
