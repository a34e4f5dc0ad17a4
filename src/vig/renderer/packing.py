"""Scenes laid side by side for the kernels: one list of vertices, faces and edges for a whole batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from vig.renderer.primitives import Pyramid, stack_pyramids
from vig.renderer.scene import MeshObject, Scene
from vig.renderer.shading import smooth_normals, unit

_Tensors = dict[str, tuple[torch.Tensor | None, list[tuple[int, ...]]]]
"""Tensors by name, each with the shapes that it may have."""


@dataclass(frozen=True)
class PackedScenes:
    """All objects of B scenes, numbered through: O of them with V vertices, F faces, E edges.

    points (V, 3): homogeneous screen points (x z, y z, z), pixels and metres. normals (V, 3): unit, world.
    albedo (V, 3). vertex_object (V,), face_object (F,): which object. faces, texture_faces (F, 3), edges
    (E, 6): int32, numbered through. coordinates (T, 2): texture coordinates. texture (O,) int32: which
    of `textures` an object has, -1 for none. light (O, 9, 3), direction (O, 3), radiance (O, 3): see `shade`.
    lit (O,): whether any light falls on an object. image (O,), place (O,): an object's scene and its place
    in that scene's list. first_face (O,): the first face of each. background (B, H, W, 3) or (B, 1, 1, 3).
    """

    points: torch.Tensor
    normals: torch.Tensor
    albedo: torch.Tensor
    vertex_object: torch.Tensor
    face_object: torch.Tensor
    faces: torch.Tensor
    texture_faces: torch.Tensor
    edges: torch.Tensor
    coordinates: torch.Tensor
    texture: torch.Tensor
    textures: Pyramid | None
    light: torch.Tensor
    direction: torch.Tensor
    radiance: torch.Tensor
    lit: torch.Tensor
    image: torch.Tensor
    place: torch.Tensor
    first_face: torch.Tensor
    background: torch.Tensor
    size: tuple[int, int, int]

    @property
    def most_objects(self) -> int:
        """Objects of the scene that has most."""
        return int(self.place.max()) + 1 if len(self.place) else 0


def pack(scenes: Sequence[Scene]) -> PackedScenes:
    """Project the objects of all scenes and number them through. Raises ValueError for invalid scenes."""
    odd = (
        [each for each in scenes if not isinstance(each, Scene)] if isinstance(scenes, Sequence) else [scenes]
    )
    if odd or not scenes:
        among = " among them" * isinstance(scenes, Sequence)
        received = f"a {type(odd[0]).__name__}{among}" if odd else "none"
        raise ValueError(f"expected a scene or several; got {received}. Pass vig.renderer.Scene.")
    camera = scenes[0].camera
    height, width = camera.height, camera.width
    like = camera.translation
    if like.dtype not in (torch.float32, torch.float64):
        raise ValueError(f"a camera must be float32 or float64; got {like.dtype}. Convert it.")
    if height < 1 or width < 1:
        raise ValueError(f"an image must have at least one pixel; got {width} x {height}. Give its size.")
    owners, points, normals, albedo, lights, textures = [], [], [], [], [], []
    coordinates, texture_faces = [], []
    for index, scene in enumerate(scenes):
        _check_scene(index, scene, (height, width), like)
        for place, item in enumerate(scene.objects):
            _check_object(f"object {place} of scene {index}", item, like)
            world, normal = _placed(item)
            owners.append((index, place))
            points.append(_screen_points(scene, world))
            normals.append(normal)
            albedo.append(item.albedo.expand(len(world), 3))
            lights.append(_lights(scene, item, like))
            textures.append(item.texture)
            if item.texture is None or item.texture_coordinates is None:
                # One row of coordinates, to which all corners point.
                coordinates.append(like.new_zeros(1, 2))
                texture_faces.append(torch.zeros_like(item.topology.faces))
            else:
                coordinates.append(item.texture_coordinates)
                texture_faces.append(item.topology.texture_faces)
    topologies = [scenes[index].objects[place].topology for index, place in owners]
    counts = [(len(t.faces), t.vertex_count, len(uv)) for t, uv in zip(topologies, coordinates, strict=True)]
    starts: list[list[int]] = np.cumsum([(0, 0, 0), *counts], axis=0).tolist()
    device = like.device
    no_rows = torch.zeros((0, 6), dtype=torch.int32, device=device)

    def whole(numbers: list[Any], dtype: torch.dtype = torch.int64) -> torch.Tensor:
        return torch.tensor(numbers, dtype=dtype, device=device)

    def numbered(index: int) -> torch.Tensor:
        return torch.arange(len(owners), device=device).repeat_interleave(whole([c[index] for c in counts]))

    def shifted(tables: list[torch.Tensor], column: int) -> torch.Tensor:
        moved = [table + start[column] for table, start in zip(tables, starts, strict=False)]
        return _joined(moved, no_rows[:, :3])

    own = [texture for texture in textures if texture is not None]
    order = iter(range(len(own)))
    light, direction, radiance, lit = zip(*lights, strict=True) if lights else ((), (), (), ())
    background = [_background(scene, like) for scene in scenes]
    if any(each.shape[1:3] != (1, 1) for each in background):
        background = [each.expand(1, height, width, 3) for each in background]
    return PackedScenes(
        points=_joined(points, like.new_zeros(0, 3)),
        normals=_joined(normals, like.new_zeros(0, 3)),
        albedo=_joined(albedo, like.new_zeros(0, 3)),
        vertex_object=numbered(1),
        face_object=numbered(0),
        faces=shifted([t.faces for t in topologies], 1),
        texture_faces=shifted(texture_faces, 2),
        edges=_joined(
            [_shifted(t.edges, s[1], s[0]) for t, s in zip(topologies, starts, strict=False)], no_rows
        ),
        coordinates=_joined(coordinates, like.new_zeros(0, 2)),
        texture=whole([-1 if t is None else next(order) for t in textures], torch.int32),
        textures=stack_pyramids(own) if own else None,
        light=torch.stack(light) if light else like.new_zeros(0, 9, 3),
        direction=torch.stack(direction) if direction else like.new_zeros(0, 3),
        radiance=torch.stack(radiance) if radiance else like.new_zeros(0, 3),
        lit=whole(list(lit), torch.bool),
        image=whole([index for index, _ in owners]),
        place=whole([place for _, place in owners]),
        first_face=whole([s[0] for s in starts[:-1]]),
        background=torch.cat(background),
        size=(len(scenes), height, width),
    )


def _joined(parts: list[torch.Tensor], empty: torch.Tensor) -> torch.Tensor:
    if len(parts) == 1:
        return parts[0]
    return torch.cat(parts) if parts else empty


def _shifted(edges: torch.Tensor, vertex: int, face: int) -> torch.Tensor:
    """Add offsets to the vertices and faces of edges; -1 stays."""
    if vertex == face == 0:
        return edges
    shift = torch.tensor([vertex] * 4 + [face] * 2, dtype=torch.int32, device=edges.device)
    return torch.where(edges < 0, edges, edges + shift)


def _placed(item: MeshObject) -> tuple[torch.Tensor, torch.Tensor]:
    """World vertices and unit normals of an object."""
    world = item.vertices if item.rotation is None else item.vertices @ item.rotation.mT
    if item.translation is not None:
        world = world + item.translation
    if item.normals is None:
        return world, smooth_normals(world, item.topology.faces)
    return world, unit(item.normals if item.rotation is None else item.normals @ item.rotation.mT)


def _screen_points(scene: Scene, world: torch.Tensor) -> torch.Tensor:
    camera = scene.camera
    # Homogeneous: x and y times depth, divided only where a pixel is known to be beyond the near plane.
    in_camera = world @ camera.rotation.mT + camera.translation
    depth = in_camera[:, 2:]
    return torch.cat([in_camera[:, :2] * camera.focal + camera.centre * depth, depth], dim=1)


def _lights(
    scene: Scene, item: MeshObject, like: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, bool]:
    light = like.new_zeros(9, 3)
    if item.light is not None:
        light = item.light if item.light.ndim == 2 else item.light[:, None].expand(9, 3)
    if scene.lamp is None:
        return light, like.new_zeros(3), like.new_zeros(3), item.light is not None
    return light, unit(scene.lamp.direction[None])[0], scene.lamp.radiance, True


def _background(scene: Scene, like: torch.Tensor) -> torch.Tensor:
    """(1, 1, 1, 3), or (1, H, W, 3) of a picture."""
    if scene.background is None:
        return like.new_zeros(1, 1, 1, 3)
    return scene.background[None] if scene.background.ndim == 3 else scene.background[None, None, None]


def _check_scene(index: int, scene: Scene, size: tuple[int, int], like: torch.Tensor) -> None:
    camera, name = scene.camera, f"of scene {index}"
    if (camera.height, camera.width) != size:
        raise ValueError(
            f"images of one batch must be of one size, {size[1]} x {size[0]}; got {camera.width} x"
            f" {camera.height} {name}. Render other sizes apart."
        )
    own: _Tensors = {
        "focal": (camera.focal, [(2,)]),
        "centre": (camera.centre, [(2,)]),
        "camera rotation": (camera.rotation, [(3, 3)]),
        "camera translation": (camera.translation, [(3,)]),
        "background": (scene.background, [(3,), (*size, 3)]),
    }
    if scene.lamp is not None:
        own |= {
            "lamp direction": (scene.lamp.direction, [(3,)]),
            "lamp radiance": (scene.lamp.radiance, [(3,)]),
        }
    _check(name, own, like)
    if not (camera.focal > 0).all():
        raise ValueError(f"focal {name} must be positive pixels; got {camera.focal.tolist()}. Give two.")


def _check_object(name: str, item: MeshObject, like: torch.Tensor) -> None:
    count = item.topology.vertex_count
    coordinates, texels = item.texture_coordinates, None if item.texture is None else item.texture.texels
    own: _Tensors = {
        "vertices": (item.vertices, [(count, 3)]),
        "albedo": (item.albedo, [(3,), (count, 3)]),
        "rotation": (item.rotation, [(3, 3)]),
        "translation": (item.translation, [(3,)]),
        "light": (item.light, [(9,), (9, 3)]),
        "normals": (item.normals, [(count, 3)]),
        "texture_coordinates": (coordinates, [(0 if coordinates is None else len(coordinates), 2)]),
        "texture": (texels, [(0 if texels is None else len(texels), 3)]),
    }
    _check(f"of {name}", own, like)
    if item.texture is None:
        return
    faces = item.topology.texture_faces
    if coordinates is None or (len(faces) and int(faces.max()) >= len(coordinates)):
        raise ValueError(
            f"a texture needs a row of texture_coordinates for each of its corners; {name} has "
            f"{0 if coordinates is None else len(coordinates)} for corners up to {int(faces.max())}"
        )


def _check(of: str, tensors: _Tensors, like: torch.Tensor) -> None:
    """ValueError unless each of the tensors has one of its shapes, the camera's type, and is finite."""
    for what, (tensor, shapes) in tensors.items():
        if tensor is None:
            continue
        name = f"{what} {of}"
        if not isinstance(tensor, torch.Tensor):
            raise ValueError(f"{name} must be a tensor; got a {type(tensor).__name__}. Convert it.")
        if tuple(tensor.shape) not in shapes:
            wanted = " or ".join(map(str, shapes))
            raise ValueError(f"{name} must be {wanted}; got {tuple(tensor.shape)}. Pass it in that shape.")
        if tensor.dtype != like.dtype or tensor.device != like.device:
            raise ValueError(
                f"{name} must be {like.dtype} on {like.device}, like the camera; got {tensor.dtype} on "
                f"{tensor.device}. Convert it."
            )
        if bad := int((~tensor.detach().isfinite()).sum()):
            raise ValueError(f"{name} must be finite; {bad} of {tensor.numel()} numbers are not. Clean them.")
