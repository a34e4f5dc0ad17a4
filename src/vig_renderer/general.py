"""Pictures in plain torch on the native library's visibility: forward mode and second derivatives, too.

Each function matches that of the same name in `native.py`; `packed` lists the objects.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import torch
from torch import Tensor

from vig_renderer.defaults import default_settings
from vig_renderer.interpolation import Crossings, antialias, barycentrics, interpolate
from vig_renderer.packing import INPUTS, PackedScenes
from vig_renderer.shading import shade, smooth_normals, unit
from vig_renderer.texture import Pyramid, sample_texture

MARGIN = 1
"""Pixels drawn around the image and cut off again, so that its own border is blended like its middle."""

NORMAL, ALBEDO, LIT = slice(0, 3), slice(3, 6), slice(6, 9)
"""Columns of a vertex's attributes; the last are its reflected light, where that is computed at vertices."""


class _Opaque(torch.autograd.Function):
    @staticmethod
    def forward(run: Callable[..., Any], *arguments: Any) -> Any:
        return run(*arguments)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        ctx.mark_non_differentiable(*output)

    @staticmethod
    def vmap(info: Any, axes: tuple[Any, ...], run: Callable[..., Any], *arguments: Any) -> Any:
        if any(axis is not None for axis in axes[1:]):
            raise NotImplementedError("the renderer draws no scenes under vmap; give `render` a list of them")
        return run(*arguments), (None,) * 4


@dataclass(frozen=True)
class Visible:
    """Visible faces and occlusion edges on the grids of samples (L, H', W') of L layers.

    Attributes:
        pixel: (N,) int64 covered points, (l H' + y) W' + x, ascending.
        face: (N,) int64 the face that is nearest there, numbered through.
        crossings: Visible occlusion edges, points numbered as in `pixel`.
        size: (L, H', W').
    """

    pixel: Tensor
    face: Tensor
    crossings: Crossings
    size: tuple[int, int, int]

    @staticmethod
    def find(
        packed: PackedScenes, samples: int, near: float, points: Tensor, alone: bool = False
    ) -> "Visible":
        """Return the visible faces and edges of homogeneous points (V, 3). Nothing of it has a derivative."""
        layers = len(packed.image) if alone else packed.size[0]
        height, width = (side * samples + 2 * MARGIN for side in packed.size[1:])
        size = layers, height, width

        def run(points: Tensor) -> tuple[Tensor, ...]:
            scenes = packed.in_library(samples, near, alone)
            scenes.bind(points.contiguous().numpy(), None)
            scenes.find(True, 1)
            faces, edges, rows, edge_count = [], [torch.zeros(0, 2).long()], [torch.zeros(0, 7).long()], 0
            for layer, found in enumerate(scenes.found()):
                face, silhouettes, crossings = (torch.from_numpy(each).long() for each in found)
                faces.append(face)
                edges.append(silhouettes[:, :2])
                shift = layer * height * width
                rows.append(crossings + torch.tensor([edge_count, 0, 0, 0, 0, shift, shift]))
                edge_count += len(silhouettes)
            seen = torch.cat(faces) if faces else torch.zeros(0).long()
            pixel = (seen >= 0).nonzero().squeeze(1)
            return pixel, seen[pixel], torch.cat(edges), torch.cat(rows)

        apply: Callable[..., tuple[Tensor, ...]] = _Opaque.apply
        pixel, face, edges, rows = apply(run, points.detach())
        edge, axis, line, low, sharers, here, there = rows.unbind(1)
        return Visible(pixel, face, Crossings(edges, edge, axis, line, low, here, there, sharers), size)

    @property
    def centres(self) -> Tensor:
        """Return coordinates (N, 2) of the points on the grid less a half: columns and rows."""
        _, height, width = self.size
        inside = self.pixel % (height * width)
        return torch.stack([inside % width, inside // width], dim=1)

    def image(self, values: Tensor, nothing: Tensor | float = 0.0) -> Tensor:
        """Spread rows (N, C) into an image (L, H', W', C), `nothing` (broadcast) where nothing is seen."""
        channels = values.shape[1]
        blank = torch.as_tensor(nothing, dtype=values.dtype, device=values.device)
        flat = blank.expand(*self.size, channels).reshape(-1, channels)
        return flat.index_copy(0, self.pixel, values).view(*self.size, channels)


@dataclass(frozen=True)
class Tables:
    """The objects' faces (F, 3) int64 numbered through.

    face_object (F,): which object. first_face, place (O,): an object's first face, its place in its scene.
    """

    faces: Tensor
    face_object: Tensor
    first_face: Tensor
    place: Tensor

    @staticmethod
    def of(packed: PackedScenes) -> "Tables":
        """Return the tables of all objects."""
        tables = [torch.from_numpy(mesh.tables()[0]).long() for mesh in packed.meshes]
        counts, first_vertex = [len(each) for each in tables], [0, *accumulate(packed.vertex_counts)]
        faces = [each + first for each, first in zip(tables, first_vertex, strict=False)]
        return Tables(
            torch.cat([torch.zeros(0, 3).long(), *faces]),
            torch.arange(len(tables)).repeat_interleave(torch.tensor(counts).long()),
            torch.tensor([0, *accumulate(counts)])[:-1],
            torch.tensor(packed.place).long(),
        )


@default_settings()
def draw(
    packed: PackedScenes, samples: int, columns: int, near: float, background: Tensor, *inputs: Tensor | None
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Draw all scenes: colours (B, H, W, 3), coverage (B, H, W), visible masks (B, O, H, W); see `Rendering`.

    Then `place`'s points and attributes. inputs: those of INPUTS for each object, one after the other.
    columns: number of attributes, 9 with light at the vertices.
    """
    objects = [
        dict(zip(INPUTS, inputs[start : start + len(INPUTS)], strict=True))
        for start in range(0, len(inputs), len(INPUTS))
    ]
    points, attributes, lights = place(packed, columns, objects)
    images = paint(packed, samples, near, points, attributes, lights, background, objects)
    return *images, points, attributes


def place(
    packed: PackedScenes, columns: int, objects: list[dict[str, Tensor | None]]
) -> tuple[Tensor, Tensor, Tensor]:
    """Return homogeneous screen points (x z, y z, z) of vertices (V, 3), their attributes, lights (O, 34).

    attributes (V, columns): unit normal in the world, albedo and, of 9 columns, the light reflected by white.
    A light: 9 x 3 coefficients, direction and radiance of the lamp, 1 where there is any light and 0 else.
    """
    like = packed.background
    points, attributes, lights = [like.new_zeros(0, 3)], [like.new_zeros(0, columns)], [like.new_zeros(0, 34)]
    for mine, mesh in zip(objects, packed.meshes, strict=True):
        vertices, albedo, rotation, own = (
            mine[name] for name in ("vertices", "albedo", "rotation", "normals")
        )
        focal, centre, rotation_to_camera, camera_place = (
            mine[name] for name in ("focal", "centre", "camera_rotation", "camera_translation")
        )
        assert vertices is not None and albedo is not None and focal is not None
        assert centre is not None and rotation_to_camera is not None and camera_place is not None
        world = vertices if rotation is None else vertices @ rotation.mT
        if (translation := mine["translation"]) is not None:
            world = world + translation
        if own is None:
            normals = smooth_normals(world, torch.from_numpy(mesh.tables()[0]))
        else:
            normals = unit(own if rotation is None else own @ rotation.mT)
        light = _light(mine["light"], mine["lamp"], mine["radiance"], like)
        rows = [normals, albedo.expand(len(world), 3)]
        if columns > ALBEDO.stop:
            rows.append(_reflect(normals, world.new_zeros(len(world), dtype=torch.int64), light[None]))
        # Homogeneous: x and y times depth, divided only where a pixel is known to be beyond the near plane.
        seen = world @ rotation_to_camera.mT + camera_place
        depth = seen[:, 2:]
        points.append(torch.cat([seen[:, :2] * focal + centre * depth, depth], dim=1))
        attributes.append(torch.cat(rows, dim=1))
        lights.append(light[None])
    return torch.cat(points), torch.cat(attributes), torch.cat(lights)


def _light(light: Tensor | None, lamp: Tensor | None, radiance: Tensor | None, like: Tensor) -> Tensor:
    sky = like.new_zeros(27)
    if light is not None:
        sky = light.reshape(27) if light.ndim == 2 else light.repeat_interleave(3)
    sun = like.new_zeros(6)
    if lamp is not None and radiance is not None:
        sun = torch.cat([unit(lamp[None])[0], radiance])
    any_light = like.new_full((1,), float(light is not None or lamp is not None))
    return torch.cat([sky, sun, any_light])


def _reflect(normals: Tensor, owner: Tensor, lights: Tensor) -> Tensor:
    """Return the light that these objects' white surfaces reflect: (N, 3); 1 where an object has no light."""
    sky, lamp, radiance = lights[:, :27].reshape(-1, 9, 3), lights[:, 27:30], lights[:, 30:33]
    colour = shade(normals, owner, sky, lamp, radiance)
    return torch.where(lights[owner, 33:] != 0, colour, 1.0)


def paint(
    packed: PackedScenes,
    samples: int,
    near: float,
    points: Tensor,
    attributes: Tensor,
    lights: Tensor,
    background: Tensor,
    objects: list[dict[str, Tensor | None]],
) -> tuple[Tensor, Tensor, Tensor]:
    """Return colours (B, H, W, 3), coverage (B, H, W) and visible masks (B, O, H, W), with blended edges."""
    tables, most = Tables.of(packed), packed.most_objects
    seen = Visible.find(packed, samples, near, points)
    points = _to_grid(points, samples)
    corners, owner = tables.faces[seen.face], tables.face_object[seen.face]
    weights = barycentrics(points, corners, seen.centres)
    rows = interpolate(attributes, corners, weights[:, 0])
    if attributes.shape[1] > ALBEDO.stop:
        rgb = rows[:, ALBEDO] * rows[:, LIT]
    else:
        rgb = rows[:, ALBEDO] * _reflect(unit(rows[:, NORMAL]), owner, lights)
    for number, (mine, levels) in enumerate(zip(objects, packed.levels, strict=True)):
        coordinates, texels = mine["coordinates"], mine["texels"]
        if levels is None or coordinates is None or texels is None:
            continue
        own = (owner == number).nonzero().squeeze(1)
        mesh_corners = torch.from_numpy(packed.meshes[number].tables()[1]).long()
        corners = mesh_corners[seen.face[own] - tables.first_face[number]]
        uv, right, down = (interpolate(coordinates, corners, weights[own, row]) for row in range(3))
        colours = sample_texture(Pyramid(texels, levels), uv, torch.stack([right, down], dim=1))
        rgb = rgb * torch.ones_like(rgb).index_copy(0, own, colours)
    masks = (tables.place[owner][:, None] == torch.arange(most)).to(rgb.dtype)
    picture = seen.image(torch.cat([rgb, masks], dim=1), _behind(background, samples, most))
    picture = _average_samples(antialias(picture, _screen(points, near), seen.crossings), samples)
    visible_masks = picture[..., 3:].permute(0, 3, 1, 2)
    return picture[..., :3], visible_masks.sum(1), visible_masks


@default_settings()
def full_masks(packed: PackedScenes, samples: int, near: float, points: Tensor) -> tuple[Tensor]:
    """Return the coverage of each object as if it were the only one: (O, H, W)."""
    seen = Visible.find(packed, samples, near, points, alone=True)
    image = seen.image(points.new_ones(len(seen.pixel), 1))
    screen = _screen(_to_grid(points, samples), near)
    return (_average_samples(antialias(image, screen, seen.crossings), samples)[..., 0],)


@default_settings()
def surface(packed: PackedScenes, near: float, points: Tensor, attributes: Tensor) -> tuple[Tensor, ...]:
    """Return depth (B, H, W), unit normals (B, H, W, 3) and object and triangle numbers at pixel centres."""
    tables, seen = Tables.of(packed), Visible.find(packed, 1, near, points)
    points = _to_grid(points, 1)
    corners, owner = tables.faces[seen.face], tables.face_object[seen.face]
    weights = barycentrics(points, corners, seen.centres, derivatives=False)[:, 0]
    rows = interpolate(torch.cat([attributes[:, NORMAL], points[:, 2:]], dim=1), corners, weights)
    triangle = seen.face - tables.first_face[owner]
    ids = _crop(seen.image(torch.stack([tables.place[owner], triangle], dim=1).int(), -1))
    depth, normals = seen.image(rows[:, 3:], torch.inf), seen.image(unit(rows[:, :3]))
    return _crop(depth)[..., 0], _crop(normals), ids[..., 0], ids[..., 1]


def _to_grid(points: Tensor, samples: int) -> Tensor:
    """Return homogeneous points on the grid of samples, with its margin."""
    # Points are homogeneous, (x z, y z, z): a shift of the image is a shift by z.
    at, depth = points[:, :2], points[:, 2:]
    return torch.cat([at * samples + MARGIN * depth, depth], dim=1)


def _screen(points: Tensor, near: float) -> Tensor:
    """Return pixel coordinates (V, 2); meaningless nearer than `near`, where no edge is blended."""
    depth = points[:, 2:]
    return points[:, :2] / torch.where(depth >= near, depth, 1.0)


def _behind(background: Tensor, samples: int, masks: int) -> Tensor:
    """Return the background on the grid of samples with its margin: colours, then empty masks."""
    if background.ndim == 2:
        background = background[:, None, None]
    else:
        background = background.repeat_interleave(samples, 1).repeat_interleave(samples, 2)
        rows, columns = (torch.arange(-MARGIN, n + MARGIN).clamp(0, n - 1) for n in background.shape[1:3])
        background = background[:, rows][:, :, columns]
    return torch.cat([background, background.new_zeros(*background.shape[:3], masks)], dim=3)


def _crop(image: Tensor) -> Tensor:
    """Return the image without its margin."""
    return image[:, MARGIN:-MARGIN, MARGIN:-MARGIN]


def _average_samples(image: Tensor, samples: int) -> Tensor:
    """Return the image without its margin, every samples x samples points averaged."""
    image = _crop(image)
    if samples == 1:
        return image
    images, height, width, channels = image.shape
    blocks = image.reshape(images, height // samples, samples, width // samples, samples, channels)
    return blocks.mean(dim=(2, 4))
