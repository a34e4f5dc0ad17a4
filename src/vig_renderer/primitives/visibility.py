"""Which face is seen at each pixel's centre, for meshes of any number of images at once.

Points are homogeneous on the screen: (x z, y z, z) with (x, y) in pixels and z the depth in metres. Faces
that reach behind the near plane are cut off there; then the rasteriser of `vig_renderer.raster` draws them.
"""

import functools
from dataclasses import dataclass
from typing import Any

import torch
import warp as wp

from vig_renderer.device import (
    check_floats,
    check_size,
    check_table,
    kernel_module,
    launch,
    opaque,
    scalar_type,
)
from vig_renderer.once import make_once
from vig_renderer.raster import FACE_MASK, KEYS_MARGIN, NEAR, NOTHING, native_draw_faces


@make_once
def _draw_layers(dtype: torch.dtype) -> Any:
    vec3 = wp.types.vector(3, scalar_type(dtype))
    draw_faces = native_draw_faces(dtype)

    @wp.kernel(module=kernel_module("visibility", dtype))
    def draw_layers(
        screen: wp.array2d(dtype=vec3),
        faces: wp.array2d(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        chunk: wp.int32,
        width: wp.int32,
        height: wp.int32,
        keys: wp.array2d(dtype=wp.int64),
        facing: wp.array2d(dtype=wp.uint8),
    ):
        """Draw one mesh, faces starts[b] to starts[b + 1] of which are seen in image b."""
        image, part = wp.tid()
        first = starts[image] + part * chunk
        end = wp.min(first + chunk, starts[image + 1])
        draw_faces(0, image, first, end, screen, faces, width, height, 0, keys, facing)

    return draw_layers


@dataclass(frozen=True)
class Visible:
    """The N covered pixels of B images (layers) of H x W.

    pixel[n] = (b H + y) W + x, int64, ascending. face[n], int64: the face that is nearest there.
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

    Which face is seen has no derivative. Both sides of a face are drawn; what is nearer than NEAR to the
    eye's plane is cut off; degenerate faces are nothing.

    Args:
        points: (V, 3) homogeneous screen points of all meshes.
        faces: (F, 3) int32 into them.
        layer: (F,) int32, the image in which a face is drawn.
        size: (B, H, W).
    """
    check_size(size)
    images, height, width = size
    keys, origin = opaque(functools.partial(_draw, size=size), points.detach(), faces, layer)
    keys = keys[:, : height * width].reshape(-1)
    pixel = (keys != NOTHING).nonzero().squeeze(1)
    return Visible(pixel, origin[keys[pixel] & FACE_MASK], size)


def _draw(
    points: torch.Tensor, faces: torch.Tensor, layer: torch.Tensor, size: tuple[int, int, int]
) -> tuple[torch.Tensor, torch.Tensor]:
    """Keys (B, H W + KEYS_MARGIN) of triangles, and the face of which each triangle is a part."""
    check_floats(points=(points, (None, 3)))
    check_table("faces", faces, (None, 3), len(points))
    check_table("layer", layer, (len(faces),), size[0])
    images, height, width = size
    keys = torch.full((images, height * width + KEYS_MARGIN), NOTHING, device=points.device)
    points, corners, origin = beyond_near(points, faces.long())
    order = torch.argsort(layer[origin], stable=True)
    counts = torch.bincount(layer[origin].long(), minlength=images)
    starts = torch.nn.functional.pad(counts.cumsum(0), (1, 0)).int()
    corners, origin = corners[order].int(), origin[order]
    most = int(counts.max())
    # On a processor one thread draws an image; elsewhere each draws as many faces as it sets up at once.
    chunk = max(most, 1) if points.device.type == "cpu" else 16
    depth = points[:, 2:]
    q = torch.where(depth >= NEAR, 1 / depth, 0.0)
    screen = torch.cat([points[:, :2] * q, q], dim=1)[None]
    facing = keys.new_empty((1, len(corners)), dtype=torch.uint8)
    parts = images, -(-most // chunk)
    arguments = screen, corners, starts, chunk, width, height, keys, facing
    launch(_draw_layers(points.dtype), parts, *arguments)
    return keys, origin


def beyond_near(points: torch.Tensor, faces: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Clip faces at the near plane: points, corners (F', 3) of triangles, and the face of each (F',).

    Points on the near plane are added at the end. A part's first corner is its farthest: the near ones may
    lie far outside the image, and what is drawn from there would be inexact.
    """
    behind = ~(points[:, 2] >= NEAR)[faces]  # NaN, too
    count = behind.sum(1)
    whole = (count == 0).nonzero().squeeze(1)
    across = ((count == 1) | (count == 2)).nonzero().squeeze(1)
    if len(across) == 0:
        return points, faces[whole], whole
    one = count[across] == 1
    # The corner that is alone on its side of the plane comes first.
    alone = torch.where(one[:, None], behind[across], ~behind[across]).int().argmax(1, keepdim=True)
    a, b, c = faces[across].gather(1, (alone + torch.arange(3, device=faces.device)) % 3).unbind(1)

    def cut(other: torch.Tensor) -> torch.Tensor:
        # From the hidden end, in either face at an edge: both get the same point.
        low, high = points[torch.where(one, a, other)], points[torch.where(one, other, a)]
        share = (NEAR - low[:, 2:]) / (high[:, 2:] - low[:, 2:])
        place = low[:, :2] + share * (high[:, :2] - low[:, :2])
        return torch.cat([place, torch.full_like(share, NEAR)], dim=1)

    first = len(points) + torch.arange(len(across), device=faces.device)
    last = first + len(across)
    # With one corner hidden, four remain: they are halved from the farther of b and c, in the same sense.
    four = torch.stack([b, c, last, first], 1)[one]
    four = torch.where((points[b, 2] < points[c, 2])[one, None], four.roll(-1, 1), four)
    tip = torch.stack([a, first, last], 1)[~one]
    corners = torch.cat([faces[whole], four[:, [0, 1, 2]], four[:, [0, 2, 3]], tip])
    origin = torch.cat([whole, across[one], across[one], across[~one]])
    return torch.cat([points, cut(b), cut(c)]), corners, origin
