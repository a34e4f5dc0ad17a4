"""Sums over a vertex's ring of neighbours, in C++ for the sake of their speed: normals and the way back.

With rows (neighbour i, next, previous) the area-weighted normal of vertex v is the sum of
cross(p_i - p_v, p_next - p_v); for a cotangent t on it that of p_i is cross(p_next - p_previous, t), and that
of p_v minus the sum of these.
"""

import functools
from types import SimpleNamespace

import torch
import warp as wp

from vig.likelihood.kernels.surface import surface_functions


@functools.cache
def ring_functions(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """The device functions for one scalar type and number of shape components."""
    f = surface_functions(dtype, modes)
    real, vec3, shape_row = f.real, f.vec3, f.shape_row
    begin = f"""
    typedef {"float" if real is wp.float32 else "double"} real;
    const real* const places = (const real*)world.data + (size_t)image * world.shape.dims[1] * 3;
    const int* row = (const int*)ring.data + 3 * ((const int*)ring_start.data)[vertex];
    const int* const end = (const int*)ring.data + 3 * ((const int*)ring_start.data)[vertex + 1];
    """
    arm = """
        const real* const next = places + 3 * row[1];
        const real* const last = places + 3 * row[2];
        const real x = next[0] - last[0], y = next[1] - last[1], z = next[2] - last[2];
        const real arm_x = y * tangent[2] - z * tangent[1];
        const real arm_y = z * tangent[0] - x * tangent[2];
        const real arm_z = x * tangent[1] - y * tangent[0];
        own_x -= arm_x;
        own_y -= arm_y;
        own_z -= arm_z;
    """

    @wp.func_native(
        snippet=begin
        + """
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
    """
    )
    def ring_normal(
        image: wp.int32,
        vertex: wp.int32,
        world: wp.array2d(dtype=vec3),
        ring_start: wp.array(dtype=wp.int32),
        ring: wp.array2d(dtype=wp.int32),
    ) -> vec3: ...

    @wp.func_native(
        snippet=begin
        + f"""
    constexpr int WIDTH = {f.layout.shape};
    const real* const components = (const real*)basis.data;
    real sum[WIDTH] = {{}}, own_x = 0, own_y = 0, own_z = 0;
    for (; row < end; row += 3) {{
        {arm}
        const real* const b = components + (size_t)row[0] * 3 * WIDTH;
        for (int n = 0; n < WIDTH; ++n)
            sum[n] += arm_x * b[n] + arm_y * b[WIDTH + n] + arm_z * b[2 * WIDTH + n];
    }}
    const real* const b = components + (size_t)vertex * 3 * WIDTH;
    real* const out = (real*)rows.data + ((size_t)image * rows.shape.dims[1] + vertex) * WIDTH;
    for (int n = 0; n < WIDTH; ++n)
        out[n] = sum[n] + own_x * b[n] + own_y * b[WIDTH + n] + own_z * b[2 * WIDTH + n];
    """
    )
    def ring_row(
        image: wp.int32,
        vertex: wp.int32,
        tangent: vec3,
        world: wp.array2d(dtype=vec3),
        ring_start: wp.array(dtype=wp.int32),
        ring: wp.array2d(dtype=wp.int32),
        basis: wp.array2d(dtype=shape_row),
        rows: wp.array2d(dtype=shape_row),
    ): ...

    @wp.func_native(
        snippet=begin
        + f"""
    real* const on = (real*)on_world.data + (size_t)image * on_world.shape.dims[1] * 3;
    real own_x = in_world[0], own_y = in_world[1], own_z = in_world[2];
    for (; row < end; row += 3) {{
        {arm}
        wp::atomic_add(on + 3 * row[0], arm_x);
        wp::atomic_add(on + 3 * row[0] + 1, arm_y);
        wp::atomic_add(on + 3 * row[0] + 2, arm_z);
    }}
    wp::atomic_add(on + 3 * vertex, own_x);
    wp::atomic_add(on + 3 * vertex + 1, own_y);
    wp::atomic_add(on + 3 * vertex + 2, own_z);
    """
    )
    def ring_pull(
        image: wp.int32,
        vertex: wp.int32,
        tangent: vec3,
        in_world: vec3,
        world: wp.array2d(dtype=vec3),
        ring_start: wp.array(dtype=wp.int32),
        ring: wp.array2d(dtype=wp.int32),
        on_world: wp.array2d(dtype=vec3),
    ): ...

    return SimpleNamespace(ring_normal=ring_normal, ring_row=ring_row, ring_pull=ring_pull, **vars(f))
