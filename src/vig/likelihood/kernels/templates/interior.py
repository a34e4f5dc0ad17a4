"""Kernels of Eq. 4 inside the silhouette: value and cotangents, and rows of the normal matrix."""

import torch
import warp as wp

from vig.likelihood.densities import density_of
from vig.likelihood.kernels.layout import LANES, density_code, native_file
from vig_renderer.raster import FACE_MASK, NOTHING

NEGLIGIBLE = 1e-9
"""Posterior of being visible below which a pixel has no gradient: most hidden pixels."""

FARTHEST = 80.0
"""Nats between the two components beyond which exp(-gap) is as good as 0: float32 ends at 87."""

negligible = real(NEGLIGIBLE)
code = density_code(density) + native_file(
    dtype,
    "explain_lines.cc",
    LANES=LANES,
    SINGLE=dtype == torch.float32,
    LOG_UNIT=density_of(density).LOG_UNIT,
    FARTHEST=FARTHEST,
    NEGLIGIBLE=NEGLIGIBLE,
    FACE_MASK=FACE_MASK,
    NOTHING=NOTHING,
)


@wp.func_native(snippet=code)
def explain_lines(
    image: wp.int32,
    part: wp.int32,
    chunk: wp.int32,
    mesh: Mesh,
    view: View,
    vertices: Vertices,
    photos: Photos,
    keys: wp.array2d(dtype=wp.int64),
    differentiate: wp.int32,
    images: wp.int32,
    totals: Totals,
    cotangents: Cotangents,
    pictures: Pictures,
): ...


@wp.kernel(module=module)
def interior(
    mesh: Mesh,
    view: View,
    vertices: Vertices,
    photos: Photos,
    keys: wp.array2d(dtype=wp.int64),
    chunk: wp.int32,
    differentiate: wp.int32,
    images: wp.int32,
    totals: Totals,
    cotangents: Cotangents,
    pictures: Pictures,
):
    """A chunk of an image's lines. Value: the gain of its covered pixels over background."""
    image, part = wp.tid()
    explain_lines(
        image,
        part,
        chunk,
        mesh,
        view,
        vertices,
        photos,
        keys,
        differentiate,
        images,
        totals,
        cotangents,
        pictures,
    )


@wp.kernel(module=module)
def interior_rows(
    mesh: Mesh,
    view: View,
    vertices: Vertices,
    vertex_rows: VertexRows,
    photos: Photos,
    keys: wp.array2d(dtype=wp.int64),
    stride: wp.int32,
    pictures: Pictures,
    normal_rows: NormalRows,
):
    """Every `stride`th pixel of every `stride`th line stands for its square of them in the normal matrix:
    a row of irradiance, scaled by the root of its weight."""
    image, line = wp.tid()
    y = line * stride
    eye = eye_of(image, view)
    world_from_camera = wp.transpose(eye.rotation)
    # One row stands for stride^2 pixels, so its root weight is multiplied by stride.
    per_row = real(stride) / photos.sigma[image]
    half_precision = noise_of(photos.sigma[image]).half_precision
    for column in range((view.width + stride - 1) / stride):
        x = column * stride
        at = y * view.width + x
        key = keys[image, at]
        visible = real(0.0)
        if key != wp.int64(NOTHING):
            visible = pictures.posterior[image, at]
        if visible > negligible:
            slot = claim_row(image, line, normal_rows)
            surface = surface_of(image, int(key & face_mask), mesh, vertices)
            pixel = vec2(real(x) + real(0.5), real(y) + real(0.5))
            sample = seen_at(surface, pixel)
            off = pixel - surface.origin
            error = photos.observed[photos.photo[image], at] - photos.albedo[image] * sample[0]
            # Iteratively reweighted least squares: the inlier's posterior times the density's slope.
            weight = visible * pull(wp.dot(error, error) * half_precision)
            size = per_row * wp.sqrt(weight)
            inverse = size / sample[1]
            v = wp.dot(surface.by_second, off) * vertices.screen[image, surface.j][2] * inverse
            w = wp.dot(surface.by_third, off) * vertices.screen[image, surface.k][2] * inverse
            # u, v, w: perspective-correct weights of the corners, times the root weight.
            u = size - v - w
            # - d irradiance / d (x, y): the surface moves under a fixed pixel.
            slide = (surface.slope * sample[0] - surface.lit_slope) * inverse
            spot = vec3(pixel[0], pixel[1], sample[1])
            on_spot = vec3(slide[0], slide[1], real(0.0))
            cotangent = (world_from_camera * camera_cotangent(eye, spot, on_spot)) / size
            normal_rows.normal_rest[image, slot] = moved(
                vertex_rows.rest_rows[image, surface.i] * u
                + vertex_rows.rest_rows[image, surface.j] * v
                + vertex_rows.rest_rows[image, surface.k] * w,
                eye,
                on_spot,
                spot,
            )
            row = (
                vertex_rows.shape_rows[image, surface.i] * u
                + vertex_rows.shape_rows[image, surface.j] * v
                + vertex_rows.shape_rows[image, surface.k] * w
            )
            row = add_basis(row, mesh, surface.i, cotangent * u)
            row = add_basis(row, mesh, surface.j, cotangent * v)
            normal_rows.normal_shape[image, slot] = add_basis(row, mesh, surface.k, cotangent * w)
