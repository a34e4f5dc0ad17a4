"""Groups of arrays that kernels take as one argument each, for one scalar type and number of components.

B points are evaluated at once; a thread works on one `part` of one of them. A field is found by its name
among the buffers of a `Pass`, so that a name means the same array in every group.
"""

import functools
from types import SimpleNamespace

import torch
import warp as wp

from vig.likelihood.kernels.types import kernel_types


@functools.cache
def argument_groups(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """The structs by the names that arguments of kernels have: `mesh`, `view`, ..."""
    t = kernel_types(dtype, modes)
    real, vec3, vec4, mat33 = t.real, t.vec3, t.vec4, t.mat33
    shape_row, rest_row, lobe_vector = t.shape_row, t.rest_row, t.lobe_vector

    @wp.struct
    class Mesh:
        """Faces (F, 3), edges (E, 5), rings and components (V, 3) of `Geometry`."""

        faces: wp.array2d(dtype=wp.int32)
        edges: wp.array2d(dtype=wp.int32)
        ring_start: wp.array(dtype=wp.int32)
        ring: wp.array2d(dtype=wp.int32)
        basis: wp.array2d(dtype=shape_row)

    @wp.struct
    class View:
        """Camera of each point (B,): camera_from_world, (focal length, cx, cy) in pixels; metres from the eye
        to the target; the image's size in pixels."""

        rotation: wp.array(dtype=mat33)
        intrinsics: wp.array(dtype=vec3)
        distance: real
        width: wp.int32
        height: wp.int32

    @wp.struct
    class Vertices:
        """Vertices (B, V): world frame, (x, y, 1 / depth) on the screen, and of those that are used by a face
        turned to the eye: unit normal (world), one over the normal's length before, irradiance."""

        world: wp.array2d(dtype=vec3)
        screen: wp.array2d(dtype=vec3)
        used: wp.array2d(dtype=wp.uint8)
        normals: wp.array2d(dtype=vec3)
        inverse_lengths: wp.array2d(dtype=real)
        irradiances: wp.array2d(dtype=real)

    @wp.struct
    class VertexRows:
        """Derivatives (B, V) of the irradiances; see `surface`."""

        shape_rows: wp.array2d(dtype=shape_row)
        rest_rows: wp.array2d(dtype=rest_row)

    @wp.struct
    class Lighting:
        """Light (B,) in a row's columns; with `shadowed`, changes of the vertices' lobes (B, V), and the
        irradiances' derivatives with respect to shape through them (B, K + 1, V)."""

        light: wp.array(dtype=rest_row)
        shadowed: wp.int32
        lobe_changes: wp.array2d(dtype=lobe_vector)
        shadow_rates: wp.array3d(dtype=real)

    @wp.struct
    class Photos:
        """Photos (N, H * W) in linear RGB, log priors, and of each point (B,) photo, noise and albedo."""

        observed: wp.array2d(dtype=vec3)
        log_prior: wp.array2d(dtype=vec3)
        photo: wp.array(dtype=wp.int32)
        sigma: wp.array(dtype=real)
        albedo: wp.array(dtype=vec3)

    @wp.struct
    class Cotangents:
        """Derivatives (B, V) of Eq. 4 by each vertex's screen point and irradiance (x, y, q, irradiance), its
        normal in the camera's frame, its place in the world, and, with self-shadow, its irradiance alone."""

        on_corner: wp.array2d(dtype=vec4)
        on_normal: wp.array2d(dtype=vec3)
        on_world: wp.array2d(dtype=vec3)
        on_light: wp.array2d(dtype=real)

    @wp.struct
    class Totals:
        """What each thread (B, parts) adds to Eq. 4, and its derivative by albedo."""

        values: wp.array2d(dtype=real)
        on_albedo: wp.array2d(dtype=vec3)

    @wp.struct
    class NormalRows:
        """Rows (B, R) of the Gauss-Newton matrix in two parts, and how many are filled (B,)."""

        row_count: wp.array(dtype=wp.int32)
        normal_shape: wp.array2d(dtype=shape_row)
        normal_rest: wp.array2d(dtype=rest_row)

    @wp.struct
    class Pictures:
        """Images (B, H * W): posterior of being visible, coverage, irradiance."""

        posterior: wp.array2d(dtype=real)
        coverage: wp.array2d(dtype=real)
        irradiance: wp.array2d(dtype=real)

    @wp.struct
    class Occluding:
        """Faces turned to the eye (B, F), and the mesh edges (B, E) between one that is and one that is not,
        of which there are counts (B,)."""

        facing: wp.array2d(dtype=wp.uint8)
        occluding_edges: wp.array2d(dtype=wp.int32)
        counts: wp.array(dtype=wp.int32)

    return SimpleNamespace(
        mesh=Mesh,
        view=View,
        vertices=Vertices,
        vertex_rows=VertexRows,
        lighting=Lighting,
        photos=Photos,
        cotangents=Cotangents,
        totals=Totals,
        normal_rows=NormalRows,
        pictures=Pictures,
        occluding=Occluding,
    )
