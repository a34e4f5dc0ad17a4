// The ring of a vertex: rows (neighbour, next, previous), from `row` to `end`, of places in the world.
const real* const places = (const real*)vertices.world.data + (size_t)image * vertices.world.shape.dims[1] * 3;
const int* row = (const int*)mesh.ring.data + 3 * ((const int*)mesh.ring_start.data)[vertex];
const int* const end = (const int*)mesh.ring.data + 3 * ((const int*)mesh.ring_start.data)[vertex + 1];
