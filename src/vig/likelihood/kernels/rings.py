"""Sums over a vertex's ring of neighbours, in C++ for the sake of their speed: normals and the way back.

With rows (neighbour i, next, previous) the area-weighted normal of vertex v is the sum of
cross(p_i - p_v, p_next - p_v); for a cotangent t on it that of p_i is cross(p_next - p_previous, t), and that
of p_v minus the sum of these.
"""

import functools
from types import SimpleNamespace

import torch
import warp as wp

from vig.likelihood.kernels.groups import argument_groups
from vig.likelihood.kernels.types import RowLayout, kernel_types, native_file


@functools.cache
def ring_functions(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """The device functions for one scalar type and number of shape components."""
    groups, vec3 = argument_groups(dtype, modes), kernel_types(dtype, modes).vec3
    Mesh, Vertices, VertexRows, Cotangents = (
        groups.mesh,
        groups.vertices,
        groups.vertex_rows,
        groups.cotangents,
    )
    width = RowLayout(modes).shape

    @wp.func_native(snippet=native_file(dtype, "ring.cc", "ring_normal.cc"))
    def ring_normal(image: wp.int32, vertex: wp.int32, mesh: Mesh, vertices: Vertices) -> vec3: ...

    @wp.func_native(snippet=native_file(dtype, "ring.cc", "ring_arm.cc", "ring_row.cc", WIDTH=width))
    def ring_row(
        image: wp.int32, vertex: wp.int32, tangent: vec3, mesh: Mesh, vertices: Vertices, rows: VertexRows
    ): ...

    @wp.func_native(snippet=native_file(dtype, "ring.cc", "ring_arm.cc", "ring_pull.cc"))
    def ring_pull(
        image: wp.int32,
        vertex: wp.int32,
        tangent: vec3,
        in_world: vec3,
        mesh: Mesh,
        vertices: Vertices,
        cotangents: Cotangents,
    ): ...

    return SimpleNamespace(ring_normal=ring_normal, ring_row=ring_row, ring_pull=ring_pull)
