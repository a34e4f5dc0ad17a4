// The area-weighted normal: the sum of cross(neighbour - vertex, next - vertex).
const real* const here = places + 3 * vertex;
real nx = 0, ny = 0, nz = 0;
for (; row < end; row += 3) {
    const real* const a = places + 3 * row[0];
    const real* const b = places + 3 * row[1];
    const real ax = a[0] - here[0], ay = a[1] - here[1], az = a[2] - here[2];
    const real bx = b[0] - here[0], by = b[1] - here[1], bz = b[2] - here[2];
    nx += ay * bz - az * by;
    ny += az * bx - ax * bz;
    nz += ax * by - ay * bx;
}
return wp::vec_t<3, real>(nx, ny, nz);
