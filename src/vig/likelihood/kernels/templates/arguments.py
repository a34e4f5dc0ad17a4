"""The structs by the names that arguments of kernels have: `mesh`, `view`, ..."""

import warp as wp


@wp.struct
class Mesh:
    """Faces (F, 3), edges (E, 5), rings, components (V, 3) and reflectance (V,) of `Geometry`."""

    faces: wp.array2d(dtype=wp.int32)
    edges: wp.array2d(dtype=wp.int32)
    ring_start: wp.array(dtype=wp.int32)
    ring: wp.array2d(dtype=wp.int32)
    basis: wp.array2d(dtype=shape_row)
    reflectance: wp.array(dtype=real)


@wp.struct
class View:
    """Camera of each point (B,): camera_from_world, cosine and sine of the roll, (focal length, cx, cy)
    in pixels; metres from the eye to the target; the image's size in pixels."""

    rotation: wp.array(dtype=mat33)
    level: wp.array(dtype=vec2)
    intrinsics: wp.array(dtype=vec3)
    distance: real
    width: wp.int32
    height: wp.int32


@wp.struct
class Vertices:
    """Vertices (B, V): world frame, (x, y, 1 / depth) on the screen, and of those that are used by a face
    that is seen (2) or an occlusion edge (1): unit normal (world), one over its length before,
    irradiance."""

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
    """Light (B,) in a row's columns, shape coefficients (B,); with `shadowed`, `Geometry`'s transfer, the
    changes of the vertices' lobes (B, V), and the irradiances' derivatives by shape through them."""

    light: wp.array(dtype=rest_row)
    coefficients: wp.array(dtype=shape_row)
    shadowed: wp.int32
    transfer_mean: wp.array(dtype=lobe_vector)
    transfer_by_shape: wp.array2d(dtype=shape_row)
    lobe_changes: wp.array2d(dtype=lobe_vector)
    shadow_rates: wp.array2d(dtype=shape_row)


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
    normal in the camera's frame, and its place in the world."""

    on_corner: wp.array2d(dtype=vec4)
    on_normal: wp.array2d(dtype=vec3)
    on_world: wp.array2d(dtype=vec3)


@wp.struct
class Totals:
    """What each thread (B, parts) adds to Eq. 4, and its derivative by albedo."""

    values: wp.array2d(dtype=real)
    on_albedo: wp.array2d(dtype=vec3)


@wp.struct
class NormalRows:
    """Rows (B, R) of the Gauss-Newton matrix in two parts, cut into S equal segments, and how many are
    filled of each segment (B, S); see `claim_row`."""

    row_counts: wp.array2d(dtype=wp.int32)
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
    """Faces turned to the eye (B, F), and the mesh edges (B, E) between one that is and one that is not:
    of the edges that a thread takes those, in their order, of which there are counts (B, parts)."""

    facing: wp.array2d(dtype=wp.uint8)
    occluding_edges: wp.array2d(dtype=wp.int32)
    counts: wp.array2d(dtype=wp.int32)
