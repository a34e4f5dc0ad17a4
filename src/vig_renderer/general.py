"""The stages of a picture in plain torch: on any device, forward mode and second derivatives, too.

Each does what the stage of the same name in `native.py` does; `packed` says which objects there are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from vig_renderer.defaults import default_settings
from vig_renderer.packing import INPUTS, PackedScenes
from vig_renderer.primitives import (
    antialias,
    barycentrics,
    find_crossings,
    interpolate,
    sample_texture,
    stack_pyramids,
    visible_faces,
)
from vig_renderer.raster import NEAR
from vig_renderer.shading import shade, smooth_normals, unit

MARGIN = 1
"""Pixels drawn around the image and cut off again, so that its own border is blended like its middle."""

NORMAL, ALBEDO, LIT = slice(0, 3), slice(3, 6), slice(6, 9)
"""Columns of a vertex's attributes; the last are what light it reflects, where that is found at vertices."""


@dataclass(frozen=True)
class Tables:
    """The objects' faces (F, 3), texture_faces (F, 3) and edges (E, 6) numbered through, int32.

    vertex_object (V,), face_object (F,): which object. image, place, first_face (O,): see `PackedScenes`.
    """

    faces: Tensor
    texture_faces: Tensor
    edges: Tensor
    vertex_object: Tensor
    face_object: Tensor
    image: Tensor
    place: Tensor
    first_face: Tensor

    @staticmethod
    def of(packed: PackedScenes) -> Tables:
        """Those of all objects."""
        packed.check_unchanged()
        device, topologies = packed.background.device, packed.topologies

        def whole(numbers: list[int]) -> Tensor:
            return torch.tensor(numbers, dtype=torch.int64, device=device)

        def joined(parts: list[Tensor], columns: int) -> Tensor:
            nothing = torch.zeros((0, columns), dtype=torch.int32, device=device)
            return torch.cat([nothing, *parts]) if len(parts) != 1 else parts[0]

        def owners(starts: list[int]) -> Tensor:
            return torch.arange(len(topologies), device=device).repeat_interleave(whole(starts).diff())

        starts = list(
            zip(topologies, packed.first_vertex, packed.first_face, packed.first_coordinate, strict=False)
        )
        edges = []
        for each, vertex, face, _ in starts:
            shift = torch.tensor([vertex] * 4 + [face] * 2, dtype=torch.int32, device=device)
            edges.append(torch.where(each.edges < 0, each.edges, each.edges + shift))
        textured = [own >= 0 for own in packed.texture]
        return Tables(
            faces=joined([each.faces + vertex for each, vertex, _, _ in starts], 3),
            # Corners without a texture point to the first row of the coordinates, which is read and not used.
            texture_faces=joined(
                [
                    each.texture_faces + first if own else torch.zeros_like(each.texture_faces)
                    for (each, _, _, first), own in zip(starts, textured, strict=True)
                ],
                3,
            ),
            edges=joined(edges, 6),
            vertex_object=owners(packed.first_vertex),
            face_object=owners(packed.first_face),
            image=whole(packed.image),
            place=whole(packed.place),
            first_face=whole(packed.first_face[:-1]),
        )


@default_settings()
def place(packed: PackedScenes, columns: int, *inputs: Tensor | None) -> tuple[Tensor, Tensor, Tensor]:
    """Homogeneous screen points (x z, y z, z) of all vertices (V, 3), their attributes, and lights (O, 34).

    attributes (V, columns): unit normal in the world, albedo and, of 9 columns, the light reflected by white.
    A light: 9 x 3 coefficients, direction and radiance of the lamp, 1 where there is any light and 0 else.
    """
    like = packed.background
    points, attributes, lights = [like.new_zeros(0, 3)], [like.new_zeros(0, columns)], [like.new_zeros(0, 34)]
    for n, topology in enumerate(packed.topologies):
        mine = dict(zip(INPUTS, inputs[n * len(INPUTS) : (n + 1) * len(INPUTS)], strict=True))
        vertices, albedo, rotation, own = (
            mine[name] for name in ("vertices", "albedo", "rotation", "normals")
        )
        focal, centre, eye, eye_place = (mine[name] for name in INPUTS[-2:] + INPUTS[-4:-2])
        assert vertices is not None and albedo is not None and focal is not None
        assert centre is not None and eye is not None and eye_place is not None
        world = vertices if rotation is None else vertices @ rotation.mT
        if (translation := mine["translation"]) is not None:
            world = world + translation
        if own is None:
            normals = smooth_normals(world, topology.faces)
        else:
            normals = unit(own if rotation is None else own @ rotation.mT)
        light = _light(mine["light"], mine["lamp"], mine["radiance"], like)
        rows = [normals, albedo.expand(len(world), 3)]
        if columns > ALBEDO.stop:
            rows.append(_reflected(normals, world.new_zeros(len(world), dtype=torch.int64), light[None]))
        # Homogeneous: x and y times depth, divided only where a pixel is known to be beyond the near plane.
        seen = world @ eye.mT + eye_place
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


def _reflected(normals: Tensor, owner: Tensor, lights: Tensor) -> Tensor:
    """What white surfaces of these objects reflect: (N, 3); 1 where an object has no light."""
    sky, lamp, radiance = lights[:, :27].reshape(-1, 9, 3), lights[:, 27:30], lights[:, 30:33]
    colour = shade(normals, owner, sky, lamp, radiance)
    return torch.where(lights[owner, 33:] != 0, colour, 1.0)


@default_settings()
def paint(
    packed: PackedScenes,
    samples: int,
    points: Tensor,
    attributes: Tensor,
    lights: Tensor,
    background: Tensor,
    *textures: Tensor,
) -> tuple[Tensor, Tensor, Tensor]:
    """Colours (B, H, W, 3), coverage (B, H, W) and visible masks (B, O, H, W), blended at occlusion edges.

    textures: texture coordinates and texels of each object that has them, one after the other.
    """
    tables, most = Tables.of(packed), packed.most_objects
    points, size = _gridded(packed, points, samples)
    layer = tables.image[tables.face_object].int()
    visible = visible_faces(points, tables.faces, layer, size)
    corners, owner = tables.faces[visible.face], tables.face_object[visible.face]
    at_centre, *along = barycentrics(points, corners, visible.centres, bool(textures)).unbind(1)
    rows = interpolate(attributes, corners, at_centre)
    if attributes.shape[1] > ALBEDO.stop:
        rgb = rows[:, ALBEDO] * rows[:, LIT]
    else:
        rgb = rows[:, ALBEDO] * _reflected(unit(rows[:, NORMAL]), owner, lights)
    if textures:
        own = [
            replace(each, texels=texels) for each, texels in zip(packed.pyramids, textures[1::2], strict=True)
        ]
        coordinates = torch.cat([*textures[::2], points.new_zeros(1, 2)])
        corners = tables.texture_faces[visible.face]
        uv, right, down = (interpolate(coordinates, corners, way) for way in (at_centre, *along))
        number = torch.tensor(packed.texture, dtype=torch.int32, device=owner.device)[owner]
        rgb = rgb * sample_texture(stack_pyramids(own), number, uv, torch.stack([right, down], dim=1))
    masks = (tables.place[owner][:, None] == torch.arange(most, device=owner.device)).to(rgb.dtype)
    crossings = find_crossings(points, tables.faces, tables.edges, layer, size)
    picture = visible.image(torch.cat([rgb, masks], dim=1), _behind(background, samples, most))
    picture = _reduced(antialias(picture, _screen(points), crossings), samples)
    visible_masks = picture[..., 3:].permute(0, 3, 1, 2)
    return picture[..., :3], visible_masks.sum(1), visible_masks


@default_settings()
def alone(packed: PackedScenes, samples: int, points: Tensor) -> tuple[Tensor]:
    """Coverage of each object as if it were the only one: (O, H, W)."""
    tables = Tables.of(packed)
    points, grid = _gridded(packed, points, samples)
    # Each object gets an image layer of its own.
    size, layer = (len(packed.image), *grid[1:]), tables.face_object.int()
    if len(packed.image) == 0:
        return (points.new_zeros(0, *packed.size[1:]),)
    visible = visible_faces(points, tables.faces, layer, size)
    crossings = find_crossings(points, tables.faces, tables.edges, layer, size)
    image = visible.image(points.new_ones(len(visible.pixel), 1))
    return (_reduced(antialias(image, _screen(points), crossings), samples)[..., 0],)


@default_settings()
def surface(packed: PackedScenes, points: Tensor, attributes: Tensor) -> tuple[Tensor, ...]:
    """Depth (B, H, W), unit normals (B, H, W, 3) and numbers of objects and triangles at pixels' centres."""
    tables = Tables.of(packed)
    points, size = _gridded(packed, points, 1)
    visible = visible_faces(points, tables.faces, tables.image[tables.face_object].int(), size)
    corners, owner = tables.faces[visible.face], tables.face_object[visible.face]
    weights = barycentrics(points, corners, visible.centres, False)[:, 0]
    rows = interpolate(torch.cat([attributes[:, NORMAL], points[:, 2:]], dim=1), corners, weights)
    triangle = visible.face - tables.first_face[owner]
    ids = _cropped(visible.image(torch.stack([tables.place[owner], triangle], dim=1).int(), -1))
    depth, normals = visible.image(rows[:, 3:], torch.inf), visible.image(unit(rows[:, :3]))
    return _cropped(depth)[..., 0], _cropped(normals), ids[..., 0], ids[..., 1]


def _gridded(packed: PackedScenes, points: Tensor, samples: int) -> tuple[Tensor, tuple[int, int, int]]:
    """Homogeneous points on the grid of samples, with its margin, and the size of that grid."""
    images, height, width = packed.size
    # Points are homogeneous, (x z, y z, z): a shift of the image is a shift by z.
    at, depth = points[:, :2], points[:, 2:]
    points = torch.cat([at * samples + MARGIN * depth, depth], dim=1)
    return points, (images, height * samples + 2 * MARGIN, width * samples + 2 * MARGIN)


def _screen(points: Tensor) -> Tensor:
    """Pixel coordinates (V, 2); of no meaning nearer than NEAR, where no edge is blended."""
    depth = points[:, 2:]
    return points[:, :2] / torch.where(depth >= NEAR, depth, 1.0)


def _behind(background: Tensor, samples: int, masks: int) -> Tensor:
    """What is seen where nothing is, on the grid of samples with its margin: colours, then empty masks."""
    if background.shape[1:3] != (1, 1):
        background = background.repeat_interleave(samples, 1).repeat_interleave(samples, 2)
        rows, columns = (
            torch.arange(-MARGIN, n + MARGIN, device=background.device).clamp(0, n - 1)
            for n in background.shape[1:3]
        )
        background = background[:, rows][:, :, columns]
    return torch.cat([background, background.new_zeros(*background.shape[:3], masks)], dim=3)


def _cropped(image: Tensor) -> Tensor:
    """The image without its margin."""
    return image[:, MARGIN:-MARGIN, MARGIN:-MARGIN]


def _reduced(image: Tensor, samples: int) -> Tensor:
    """The image without its margin, every samples x samples points averaged."""
    image = _cropped(image)
    if samples == 1:
        return image
    images, height, width, channels = image.shape
    blocks = image.reshape(images, height // samples, samples, width // samples, samples, channels)
    return blocks.mean(dim=(2, 4))
