// The ring of a vertex: rows (neighbour, next, previous), from `first` to `end`, of places in the world.
// Functions of it, of which a caller's last line names one.
const real* const places = (const real*)vertices.world.data + (size_t)image * vertices.world.shape.dims[1] * 3;
const int* const first = (const int*)mesh.ring.data + 3 * ((const int*)mesh.ring_start.data)[vertex];
const int* const end = (const int*)mesh.ring.data + 3 * ((const int*)mesh.ring_start.data)[vertex + 1];

// The area-weighted normal: the sum of cross(neighbour - vertex, next - vertex).
const auto normal = [&]() {
    const real* const here = places + 3 * vertex;
    real nx = 0, ny = 0, nz = 0;
    for (const int* row = first; row < end; row += 3) {
        const real* const a = places + 3 * row[0];
        const real* const b = places + 3 * row[1];
        const real ax = a[0] - here[0], ay = a[1] - here[1], az = a[2] - here[2];
        const real bx = b[0] - here[0], by = b[1] - here[1], bz = b[2] - here[2];
        nx += ay * bz - az * by;
        ny += az * bx - ax * bz;
        nz += ax * by - ay * bx;
    }
    return wp::vec_t<3, real>(nx, ny, nz);
};

// What a cotangent `tangent` on the normal is on the row's neighbour: cross(next - previous, .).
const auto arm_of = [&](const int* row, const auto& tangent) {
    const real* const next = places + 3 * row[1];
    const real* const last = places + 3 * row[2];
    const real x = next[0] - last[0], y = next[1] - last[1], z = next[2] - last[2];
    return wp::vec_t<3, real>(
        y * tangent[2] - z * tangent[1], z * tangent[0] - x * tangent[2], x * tangent[1] - y * tangent[0]);
};

// Derivatives by the shape coefficients: sum over the ring of arm . component, WIDTH columns of them.
const auto write_row = [&](const auto& basis, const auto& tangent, auto& shape_rows) {
    const real* const components = (const real*)basis.data;
    real sum[WIDTH] = {}, own_x = 0, own_y = 0, own_z = 0;
    for (const int* row = first; row < end; row += 3) {
        const wp::vec_t<3, real> arm = arm_of(row, tangent);
        // The normal does not change when all its ring moves together: the vertex's own part is minus the sum.
        own_x -= arm[0];
        own_y -= arm[1];
        own_z -= arm[2];
        const real* const b = components + (size_t)row[0] * 3 * WIDTH;
        for (int n = 0; n < WIDTH; ++n)
            sum[n] += arm[0] * b[n] + arm[1] * b[WIDTH + n] + arm[2] * b[2 * WIDTH + n];
    }
    const real* const b = components + (size_t)vertex * 3 * WIDTH;
    real* const out = (real*)shape_rows.data + ((size_t)image * shape_rows.shape.dims[1] + vertex) * WIDTH;
    for (int n = 0; n < WIDTH; ++n)
        out[n] = sum[n] + own_x * b[n] + own_y * b[WIDTH + n] + own_z * b[2 * WIDTH + n];
};

// Add a cotangent on the normal, and in_world on the vertex itself, to cotangents on world places.
const auto pull = [&](const auto& tangent, const auto& in_world, auto& on_world) {
    real* const on = (real*)on_world.data + (size_t)image * on_world.shape.dims[1] * 3;
    real own_x = in_world[0], own_y = in_world[1], own_z = in_world[2];
    for (const int* row = first; row < end; row += 3) {
        const wp::vec_t<3, real> arm = arm_of(row, tangent);
        own_x -= arm[0];
        own_y -= arm[1];
        own_z -= arm[2];
        wp::atomic_add(on + 3 * row[0], arm[0]);
        wp::atomic_add(on + 3 * row[0] + 1, arm[1]);
        wp::atomic_add(on + 3 * row[0] + 2, arm[2]);
    }
    wp::atomic_add(on + 3 * vertex, own_x);
    wp::atomic_add(on + 3 * vertex + 1, own_y);
    wp::atomic_add(on + 3 * vertex + 2, own_z);
};
