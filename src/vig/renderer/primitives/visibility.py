"""Which face is seen at each pixel's centre, for meshes of any number of images at once.

Points are homogeneous on the screen: (x z, y z, z) with (x, y) in pixels and z the depth in metres, so that
a face that crosses the eye's plane needs no clipping: the ray through a pixel meets it where all three edge
functions have one sign and the depth is beyond NEAR.
"""

# mypy: disable-error-code="arg-type"

import functools
from dataclasses import dataclass
from types import SimpleNamespace

import torch
import warp as wp

from vig.renderer.device import initialise, scalar_type
from vig.renderer.primitives.arguments import check_floats, check_size, check_table
from vig.renderer.primitives.opaque import array_of, device_of, kernel_module, opaque
from vig.renderer.raster import NEAR, NOTHING


@functools.cache
def screen_functions(dtype: torch.dtype) -> SimpleNamespace:
    """Types and device functions on homogeneous screen points."""
    initialise()
    real = scalar_type(dtype)
    vec2, vec3 = wp.types.vector(2, real), wp.types.vector(3, real)
    near = real(NEAR)

    @wp.func
    def from_pixel(point: vec3, x: real, y: real):
        """The point's place relative to a pixel, still times its depth."""
        return vec2(point[0] - x * point[2], point[1] - y * point[2])

    @wp.func
    def cross(a: vec2, b: vec2):
        return a[0] * b[1] - a[1] * b[0]

    @wp.func
    def weights_at(a: vec3, b: vec3, c: vec3, x: real, y: real):
        """Barycentric weights, up to one common factor, of the ray through (x, y)."""
        oa = from_pixel(a, x, y)
        ob = from_pixel(b, x, y)
        oc = from_pixel(c, x, y)
        return vec3(cross(ob, oc), -cross(oa, oc), cross(oa, ob))

    @wp.func
    def depth_inside(weights: vec3, a: vec3, b: vec3, c: vec3):
        """Depth where the ray of these weights meets the triangle; -1 where it passes beside it."""
        inside = (weights[0] >= real(0.0) and weights[1] >= real(0.0) and weights[2] >= real(0.0)) or (
            weights[0] <= real(0.0) and weights[1] <= real(0.0) and weights[2] <= real(0.0)
        )
        total = weights[0] + weights[1] + weights[2]
        if not inside or total == real(0.0):
            return real(-1.0)
        return (weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2]) / total

    @wp.func
    def clipped(a: vec3, b: vec3):
        """Where the segment from a (before the near plane) to b (beyond it) crosses that plane, in pixels."""
        share = (near - a[2]) / (b[2] - a[2])
        return vec2(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])) / near

    @wp.func
    def seen_of_edge(a: vec3, b: vec3, low: vec2, high: vec2):
        """Widen a box by the part of a side that lies beyond the near plane."""
        p = vec2(real(0.0), real(0.0))
        q = vec2(real(0.0), real(0.0))
        if a[2] < near and b[2] < near:
            return low, high
        if a[2] < near:
            p = clipped(a, b)
        else:
            p = vec2(a[0], a[1]) / a[2]
        if b[2] < near:
            q = clipped(b, a)
        else:
            q = vec2(b[0], b[1]) / b[2]
        return wp.min(low, wp.min(p, q)), wp.max(high, wp.max(p, q))

    @wp.func
    def box_of(a: vec3, b: vec3, c: vec3):
        """Bounding box in pixels of what lies beyond the near plane; empty where nothing does."""
        if wp.min(a[2], wp.min(b[2], c[2])) >= near:
            pa = vec2(a[0], a[1]) / a[2]
            pb = vec2(b[0], b[1]) / b[2]
            pc = vec2(c[0], c[1]) / c[2]
            return wp.min(pa, wp.min(pb, pc)), wp.max(pa, wp.max(pb, pc))
        low = vec2(real(1.0e9), real(1.0e9))
        high = vec2(real(-1.0e9), real(-1.0e9))
        low, high = seen_of_edge(a, b, low, high)
        low, high = seen_of_edge(b, c, low, high)
        low, high = seen_of_edge(c, a, low, high)
        return low, high

    @wp.func
    def first_line(low: real):
        """The first row or column from `low` on, clamped before it becomes a whole number."""
        return int(wp.ceil(wp.max(low, real(0.0))))

    @wp.func
    def last_line(high: real, count: int):
        """The last row or column up to `high`, clamped before it becomes a whole number."""
        return int(wp.floor(wp.min(high, real(count - 1))))

    return SimpleNamespace(
        real=real,
        vec2=vec2,
        vec3=vec3,
        weights_at=weights_at,
        depth_inside=depth_inside,
        box_of=box_of,
        first_line=first_line,
        last_line=last_line,
    )


@functools.cache
def _kernels(dtype: torch.dtype) -> SimpleNamespace:
    f = screen_functions(dtype)
    real, vec3 = f.real, f.vec3
    weights_at, depth_inside, box_of = f.weights_at, f.depth_inside, f.box_of
    first_line, last_line = f.first_line, f.last_line
    near = real(NEAR)

    @wp.kernel(module=kernel_module("visibility", dtype))
    def draw(
        points: wp.array(dtype=vec3),
        faces: wp.array2d(dtype=wp.int32),
        layer: wp.array(dtype=wp.int32),
        keys: wp.array3d(dtype=wp.int64),
    ):
        face = wp.tid()
        i = faces[face, 0]
        j = faces[face, 1]
        k = faces[face, 2]
        # Corners in the order of their numbers: two faces round an edge off alike, and no pixel is lost.
        low_number = wp.min(i, wp.min(j, k))
        high_number = wp.max(i, wp.max(j, k))
        a = points[low_number]
        b = points[i + j + k - low_number - high_number]
        c = points[high_number]
        low, high = box_of(a, b, c)
        half = real(0.5)
        x0 = first_line(low[0] - half)
        y0 = first_line(low[1] - half)
        x1 = last_line(high[0] - half, keys.shape[2])
        y1 = last_line(high[1] - half, keys.shape[1])
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                weights = weights_at(a, b, c, real(x) + half, real(y) + half)
                depth = depth_inside(weights, a, b, c)
                if depth >= near:
                    # Positive floats are ordered like the whole numbers of the same bits.
                    bits = wp.cast(wp.float32(depth), wp.int32)
                    key = (wp.int64(bits) << wp.int64(32)) | wp.int64(face)
                    wp.atomic_min(keys, layer[face], y, x, key)

    return SimpleNamespace(draw=draw, vec3=vec3)


@dataclass(frozen=True)
class Visible:
    """The N pixels at whose centres something is seen, in B images (layers) of H x W.

    pixel[n] = (b H + y) W + x says which pixel, int64, ascending; face[n] = f that face f is the nearest
    there, int64.
    """

    pixel: torch.Tensor
    face: torch.Tensor
    size: tuple[int, int, int]

    @property
    def centres(self) -> torch.Tensor:
        """Pixel coordinates (N, 2) int32 of the pixels' upper left corners: the centres less a half."""
        _, height, width = self.size
        inside = self.pixel % (height * width)
        return torch.stack([inside % width, inside // width], dim=1).int()

    @property
    def layer(self) -> torch.Tensor:
        """Which image each pixel is of: (N,)."""
        return self.pixel // (self.size[1] * self.size[2])

    def image(self, values: torch.Tensor, nothing: torch.Tensor | float = 0.0) -> torch.Tensor:
        """Rows (N, C) spread into an image (B, H, W, C), `nothing` (broadcast) where nothing is seen."""
        channels = values.shape[1]
        blank = torch.as_tensor(nothing, dtype=values.dtype, device=values.device)
        flat = blank.expand(*self.size, channels).reshape(-1, channels)
        return flat.index_copy(0, self.pixel, values).view(*self.size, channels)


def visible_faces(
    points: torch.Tensor, faces: torch.Tensor, layer: torch.Tensor, size: tuple[int, int, int]
) -> Visible:
    """Find the nearest face at every pixel's centre of B images.

    points (V, 3): homogeneous screen points of all meshes. faces (F, 3) int32 into them. layer (F,) int32:
    the image in which a face is drawn. size: (B, H, W). Both sides of a face are drawn; what is nearer
    than NEAR to the eye's plane is cut off; degenerate faces are nothing. Depths are compared in float32.
    Which face is seen has no derivative. Raises ValueError for other shapes and types and for indices of
    vertices or images that are not there.
    """

    check_size(size)

    def run(points: torch.Tensor, faces: torch.Tensor, layer: torch.Tensor) -> torch.Tensor:
        check_floats(points=(points, (None, 3)))
        check_table("faces", faces, (None, 3), len(points))
        check_table("layer", layer, (len(faces),), size[0])
        kernels = _kernels(points.dtype)
        keys = torch.full(size, NOTHING, dtype=torch.int64, device=points.device)
        wp.launch(
            kernels.draw,
            dim=len(faces),
            inputs=[
                array_of(points, kernels.vec3),
                array_of(faces, wp.int32),
                array_of(layer, wp.int32),
                array_of(keys, wp.int64),
            ],
            device=device_of(points),
        )
        return keys

    keys = opaque(run, points.detach(), faces, layer).view(-1)
    pixel = (keys != NOTHING).nonzero().squeeze(1)
    return Visible(pixel, keys[pixel] & 0xFFFFFFFF, size)
