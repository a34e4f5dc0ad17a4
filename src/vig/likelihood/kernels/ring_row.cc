// Derivatives by the shape coefficients: sum over the ring of arm . component, WIDTH columns of them.
const real* const components = (const real*)mesh.basis.data;
real sum[WIDTH] = {}, own_x = 0, own_y = 0, own_z = 0;
for (; row < end; row += 3) {
    const wp::vec_t<3, real> arm = arm_of(row);
    own_x -= arm[0];
    own_y -= arm[1];
    own_z -= arm[2];
    const real* const b = components + (size_t)row[0] * 3 * WIDTH;
    for (int n = 0; n < WIDTH; ++n)
        sum[n] += arm[0] * b[n] + arm[1] * b[WIDTH + n] + arm[2] * b[2 * WIDTH + n];
}
const real* const b = components + (size_t)vertex * 3 * WIDTH;
real* const out = (real*)rows.shape_rows.data + ((size_t)image * rows.shape_rows.shape.dims[1] + vertex) * WIDTH;
for (int n = 0; n < WIDTH; ++n)
    out[n] = sum[n] + own_x * b[n] + own_y * b[WIDTH + n] + own_z * b[2 * WIDTH + n];
