"""The renderer for users: scenes in, images out, differentiable in every continuous input."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import torch

from vig.renderer.packing import PackedScenes, pack
from vig.renderer.primitives import (
    Visible,
    antialias,
    barycentrics,
    find_crossings,
    interpolate,
    sample_texture,
    visible_faces,
)
from vig.renderer.raster import NEAR
from vig.renderer.scene import Rendering, Scene
from vig.renderer.shading import shade, unit

MARGIN = 1
"""Pixels drawn around the image and cut off again, so that its own border is blended like its middle."""


def render(
    scenes: Scene | Sequence[Scene],
    shading: Literal["vertex", "pixel"] = "vertex",
    samples: int = 1,
) -> Rendering:
    """Draw a batch of scenes, each with objects of its own; all images of one size.

    shading: light is reflected at the vertices and interpolated (the paper's), or reflected at every pixel by
    the interpolated normal. samples: colours, coverage and masks are the means over samples x samples points
    a pixel, each blended at occlusion edges in turn; 1 for fits, 3 or more for pictures and datasets.

    Colour is albedo x texture x reflected light, linear RGB, unclipped. Gradients (torch.autograd, forward
    mode too) reach vertices, poses, camera, albedo, textures and their coordinates, normals, lights and
    background, silhouettes included. ids have none. Raises ValueError for shapes, types and non-finite
    numbers that cannot be drawn.
    """
    if shading not in ("vertex", "pixel"):
        raise ValueError(f"shading must be 'vertex' or 'pixel'; got {shading!r}. Choose one.")
    if not isinstance(samples, int) or samples < 1:
        raise ValueError(f"samples must be a whole number of 1 or more; got {samples}. Take 1 for fits.")
    packed = pack([scenes] if isinstance(scenes, Scene) else scenes)
    points, size = _gridded(packed, samples)
    layer = packed.image[packed.face_object].int()
    visible = visible_faces(points, packed.faces, layer, size)
    textured = packed.textures is not None
    weights = barycentrics(points, packed.faces[visible.face], visible.centres, textured)
    rgb, normals, depth = _surface(packed, points, visible, weights, shading)
    owner = packed.place[packed.face_object[visible.face]]
    masks = (owner[:, None] == torch.arange(packed.most_objects, device=owner.device)).to(rgb.dtype)

    screen = _screen(points)
    behind = _background(packed, samples, packed.most_objects)
    crossings = find_crossings(points, packed.faces, packed.edges, layer, size)
    picture = visible.image(torch.cat([rgb, masks], dim=1), behind)
    picture = _reduced(antialias(picture, screen, crossings), samples)
    colours, masks = picture[..., :3], picture[..., 3:]
    visible_masks = masks.permute(0, 3, 1, 2)

    # Depth, normals and numbers are of pixel centres: averages of them would belong to no surface.
    if samples > 1:
        points, size = _gridded(packed, 1)
        visible = visible_faces(points, packed.faces, layer, size)
        weights = barycentrics(points, packed.faces[visible.face], visible.centres, False)
        _, normals, depth = _surface(packed, points, visible, weights, None)
        owner = packed.place[packed.face_object[visible.face]]
    triangle = visible.face - packed.first_face[packed.face_object[visible.face]]
    ids = visible.image(torch.stack([owner, triangle], dim=1).int(), -1)
    return Rendering(
        rgb=colours,
        coverage=visible_masks.sum(1),
        visible_masks=visible_masks,
        full_masks=_full_masks(packed, visible_masks, samples),
        depth=_cropped(visible.image(depth, torch.inf))[..., 0],
        normals=_cropped(visible.image(normals)),
        object_id=_cropped(ids)[..., 0],
        triangle_id=_cropped(ids)[..., 1],
    )


def jacobian(
    function: Callable[[torch.Tensor], torch.Tensor], latents: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Value (...) of a function of P numbers, and its Jacobian (..., P), by forward differentiation.

    function: renders, say, from a vector of latents (P,) and returns one tensor. One pass per number: for few
    numbers and many pixels, as in Gauss-Newton. torch.func.jvp gives a single direction.
    """
    if latents.ndim != 1:
        raise ValueError(f"latents must be one vector (P,); got {tuple(latents.shape)}")
    value, columns = function(latents), []
    # Forward mode: one pass gives all pixels' derivative by one number.
    for direction in torch.eye(len(latents), dtype=latents.dtype, device=latents.device):
        columns.append(torch.func.jvp(function, (latents,), (direction,))[1])
    return value, torch.stack(columns, dim=-1) if columns else value.new_zeros(*value.shape, 0)


def _gridded(packed: PackedScenes, samples: int) -> tuple[torch.Tensor, tuple[int, int, int]]:
    """Homogeneous points on the grid of samples, with its margin, and the size of that grid."""
    images, height, width = packed.size
    # Points are homogeneous, (x z, y z, z): a shift of the image is a shift by z.
    place, depth = packed.points[:, :2], packed.points[:, 2:]
    points = torch.cat([place * samples + MARGIN * depth, depth], dim=1)
    return points, (images, height * samples + 2 * MARGIN, width * samples + 2 * MARGIN)


def _screen(points: torch.Tensor) -> torch.Tensor:
    """Pixel coordinates (V, 2); of no meaning nearer than NEAR, where no edge is blended."""
    depth = points[:, 2:]
    return points[:, :2] / torch.where(depth >= NEAR, depth, 1.0)


def _surface(
    packed: PackedScenes,
    points: torch.Tensor,
    visible: Visible,
    weights: torch.Tensor,
    shading: Literal["vertex", "pixel"] | None,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Colour (N, 3), unit normal (N, 3) and depth (N, 1) of the covered pixels; no colour without shading."""
    attributes = [packed.normals, points[:, 2:], packed.albedo]
    if shading == "vertex":
        attributes.append(_reflected(packed, packed.normals, packed.vertex_object))
    corners = packed.faces[visible.face]
    at_centre, *along = weights.unbind(1)
    rows = interpolate(torch.cat(attributes, dim=1), corners, at_centre)
    normals, depth, colour, *reflected = torch.tensor_split(rows, (3, 4, 7, 10)[: len(attributes) - 1], dim=1)
    normals = unit(normals)
    if shading is None:
        return colour, normals, depth
    owner = packed.face_object[visible.face]
    colour = colour * (reflected[0] if reflected else _reflected(packed, normals, owner))
    if packed.textures is not None:
        corners = packed.texture_faces[visible.face]
        uv = interpolate(packed.coordinates, corners, at_centre)
        changes = [interpolate(packed.coordinates, corners, way) for way in along]
        footprint = torch.stack(changes, dim=1)
        colour = colour * sample_texture(packed.textures, packed.texture[owner], uv, footprint)
    return colour, normals, depth


def _reflected(packed: PackedScenes, normals: torch.Tensor, owner: torch.Tensor) -> torch.Tensor:
    """What white surfaces of these objects reflect: (N, 3); 1 where an object has no light."""
    colour = shade(normals, owner, packed.light, packed.direction, packed.radiance)
    return torch.where(packed.lit[owner][:, None], colour, 1.0)


def _background(packed: PackedScenes, samples: int, masks: int) -> torch.Tensor:
    """What is seen where nothing is, on the grid of samples with its margin: colours, then empty masks."""
    background = packed.background
    if background.shape[1:3] != (1, 1):
        background = background.repeat_interleave(samples, 1).repeat_interleave(samples, 2)
        rows, columns = (
            torch.arange(-MARGIN, n + MARGIN, device=background.device).clamp(0, n - 1)
            for n in background.shape[1:3]
        )
        background = background[:, rows][:, :, columns]
    return torch.cat([background, background.new_zeros(*background.shape[:3], masks)], dim=3)


def _full_masks(packed: PackedScenes, visible_masks: torch.Tensor, samples: int) -> torch.Tensor:
    """Coverage of each object as if it were alone: (B, O, H, W)."""
    images, most, height, width = visible_masks.shape
    if most <= 1:
        return visible_masks
    points, grid = _gridded(packed, samples)
    # Each object gets an image layer of its own.
    size = (len(packed.image), *grid[1:])
    layer = packed.face_object.int()
    visible = visible_faces(points, packed.faces, layer, size)
    crossings = find_crossings(points, packed.faces, packed.edges, layer, size)
    alone = visible.image(points.new_ones(len(visible.pixel), 1))
    alone = _reduced(antialias(alone, _screen(points), crossings), samples)[..., 0]
    full = points.new_zeros(images * most, height, width)
    return full.index_copy(0, packed.image * most + packed.place, alone).view(images, most, height, width)


def _cropped(image: torch.Tensor) -> torch.Tensor:
    """The image without its margin."""
    return image[:, MARGIN:-MARGIN, MARGIN:-MARGIN]


def _reduced(image: torch.Tensor, samples: int) -> torch.Tensor:
    """The image without its margin, every samples x samples points averaged."""
    image = _cropped(image)
    if samples == 1:
        return image
    images, height, width, channels = image.shape
    blocks = image.reshape(images, height // samples, samples, width // samples, samples, channels)
    return blocks.mean(dim=(2, 4))
