// What a cotangent `tangent` on the area-weighted normal is on the row's neighbour: cross(next - previous, .).
const auto arm_of = [&](const int* at) {
    const real* const next = places + 3 * at[1];
    const real* const last = places + 3 * at[2];
    const real x = next[0] - last[0], y = next[1] - last[1], z = next[2] - last[2];
    return wp::vec_t<3, real>(
        y * tangent[2] - z * tangent[1], z * tangent[0] - x * tangent[2], x * tangent[1] - y * tangent[0]);
};
