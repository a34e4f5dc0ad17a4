// Add a cotangent on the normal, and in_world on the vertex itself, to cotangents on world places.
real* const on = (real*)cotangents.on_world.data + (size_t)image * cotangents.on_world.shape.dims[1] * 3;
real own_x = in_world[0], own_y = in_world[1], own_z = in_world[2];
for (; row < end; row += 3) {
    const wp::vec_t<3, real> arm = arm_of(row);
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
