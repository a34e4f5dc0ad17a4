"""Scenes laid side by side for the kernels: the objects of a whole batch, numbered through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

import torch

from vig_renderer.device import table_state
from vig_renderer.primitives import Pyramid, Topology
from vig_renderer.scene import MeshObject, Scene

_Tensors = dict[str, tuple[torch.Tensor | None, list[tuple[int, ...]]]]
"""Tensors by name, each with the shapes that it may have."""

INPUTS = (
    *("vertices", "rotation", "translation", "normals", "albedo", "light"),
    *("lamp", "radiance", "eye_rotation", "eye_translation", "focal", "centre"),
)
"""What of an object, its lamp and its camera places and lights it, in the order of `PackedScenes.inputs`."""


@dataclass(frozen=True)
class PackedScenes:
    """All objects of B scenes, numbered through: O of them with V vertices, F faces, E edges.

    inputs: of each object those of INPUTS, None where there is none. topologies (O). image, place (O): an
    object's scene and its place in that scene's list. first_vertex, first_face, first_coordinate (O + 1):
    where its own begin. texture (O): which of `pyramids` an object has, -1 for none. coordinates: their
    texture coordinates, None of the others. background (B, H, W, 3) or (B, 1, 1, 3). size: (B, H, W).
    """

    scenes: Sequence[Scene]
    inputs: list[torch.Tensor | None]
    topologies: list[Topology]
    image: list[int]
    place: list[int]
    first_vertex: list[int]
    first_face: list[int]
    first_coordinate: list[int]
    texture: list[int]
    pyramids: list[Pyramid]
    coordinates: list[torch.Tensor | None]
    background: torch.Tensor
    size: tuple[int, int, int]

    @property
    def most_objects(self) -> int:
        """Objects of the scene that has most."""
        return max(self.place, default=-1) + 1

    @property
    def tensors(self) -> list[torch.Tensor]:
        """All that a picture is differentiable in."""
        return [self.background, *self.textures, *(each for each in self.inputs if each is not None)]

    @property
    def textures(self) -> list[torch.Tensor]:
        """Texture coordinates and texels of each object that has them, one after the other."""
        own = (each for each in self.coordinates if each is not None)
        pairs = zip(own, self.pyramids, strict=True)
        return [tensor for coordinates, pyramid in pairs for tensor in (coordinates, pyramid.texels)]

    @cached_property
    def tables(self) -> list[list[int]]:
        """Of each object the last fields of `struct Object` of arguments.cc: addresses, then sizes."""
        rows = []
        for n, topology in enumerate(self.topologies):
            albedo, light = self.inputs[n * len(INPUTS) + 4 : n * len(INPUTS) + 6]
            pyramid = self.pyramids[self.texture[n]] if self.texture[n] >= 0 else None
            faces, edges = topology.faces, topology.edges
            rows.append(
                [
                    *(faces.data_ptr(), edges.data_ptr(), topology.texture_faces.data_ptr()),
                    pyramid.levels.data_ptr() if pyramid else 0,
                    *(topology.vertex_count, faces.shape[0], edges.shape[0]),
                    *(self.first_vertex[n], self.first_face[n], self.place[n]),
                    1 if albedo is None or albedo.ndim == 1 else albedo.shape[0],
                    3 if light is not None and light.ndim == 2 else 1,
                    self.first_coordinate[n + 1] - self.first_coordinate[n],
                    *((pyramid.texels.shape[0], pyramid.levels.shape[0]) if pyramid else (0, 0)),
                ]
            )
        return rows

    def check_unchanged(self) -> None:
        """RuntimeError where a table has been written to or exchanged since the first call."""
        states = [each.state() for each in self.topologies]
        states += [table_state(each.levels) for each in self.pyramids]
        if vars(self).setdefault("_states", states) != states:
            raise RuntimeError("a topology or pyramid was modified while a rendering needed it. Render anew.")

    def check_tables(self) -> None:
        """ValueError that names the first table whose numbers are out of range."""
        for index, scene in enumerate(self.scenes):
            for place, item in enumerate(scene.objects):
                item.topology.check()
                if item.texture is not None:
                    item.texture.check()
                _check_object(f"object {place} of scene {index}", item, self.background)

    def check_numbers(self) -> None:
        """ValueError that names the first input that is not finite, or focal lengths of 0 or less."""
        for index, scene in enumerate(self.scenes):
            _check(f"of scene {index}", _scene_tensors(scene), finite=True)
            if not ((focal := scene.camera.focal) > 0).all():
                raise ValueError(
                    f"focal of scene {index} must be positive pixels; got {focal.tolist()}. Give two."
                )
            for place, item in enumerate(scene.objects):
                _check(f"of object {place} of scene {index}", _object_tensors(item), finite=True)


def pack(scenes: Sequence[Scene]) -> PackedScenes:
    """Number the objects of all scenes through. Raises ValueError for shapes and types that do not fit.

    Numbers are for `check_numbers`, where a kernel has met one that is not finite.
    """
    odd = (
        [each for each in scenes if not isinstance(each, Scene)] if isinstance(scenes, Sequence) else [scenes]
    )
    if odd or not scenes:
        among = " among them" * isinstance(scenes, Sequence)
        received = f"a {type(odd[0]).__name__}{among}" if odd else "none"
        raise ValueError(f"expected a scene or several; got {received}. Pass vig_renderer.Scene.")
    camera = scenes[0].camera
    height, width = camera.height, camera.width
    like = camera.translation
    if like.dtype not in (torch.float32, torch.float64):
        raise ValueError(f"a camera must be float32 or float64; got {like.dtype}. Convert it.")
    if height < 1 or width < 1:
        raise ValueError(f"an image must have at least one pixel; got {width} x {height}. Give its size.")
    inputs: list[torch.Tensor | None] = []
    pyramids: list[Pyramid] = []
    coordinates: list[torch.Tensor | None] = []
    owners, topologies, texture = [], [], []
    for index, scene in enumerate(scenes):
        _check_scene(index, scene, (height, width), like)
        eye, lamp = scene.camera, scene.lamp
        shared = (
            *((lamp.direction, lamp.radiance) if lamp else (None, None)),
            *(eye.rotation, eye.translation, eye.focal, eye.centre),
        )
        for place, item in enumerate(scene.objects):
            _check_object(f"object {place} of scene {index}", item, like)
            owners.append((index, place))
            inputs += (item.vertices, item.rotation, item.translation, item.normals, item.albedo, item.light)
            inputs += shared
            topologies.append(item.topology)
            if item.texture is None or item.texture_coordinates is None:
                texture.append(-1)
                coordinates.append(None)
            else:
                texture.append(len(pyramids))
                pyramids.append(item.texture)
                coordinates.append(item.texture_coordinates)
    background = [_background(scene, like) for scene in scenes]
    if any(each.shape[1:3] != (1, 1) for each in background):
        background = [each.expand(1, height, width, 3) for each in background]
    return PackedScenes(
        scenes=scenes,
        inputs=inputs,
        topologies=topologies,
        image=[index for index, _ in owners],
        place=[place for _, place in owners],
        first_vertex=[0, *accumulate(topology.vertex_count for topology in topologies)],
        first_face=[0, *accumulate(len(topology.faces) for topology in topologies)],
        first_coordinate=[0, *accumulate(0 if each is None else len(each) for each in coordinates)],
        texture=texture,
        pyramids=pyramids,
        coordinates=coordinates,
        background=background[0] if len(background) == 1 else torch.cat(background),
        size=(len(scenes), height, width),
    )


def _background(scene: Scene, like: torch.Tensor) -> torch.Tensor:
    """(1, 1, 1, 3), or (1, H, W, 3) of a picture."""
    if scene.background is None:
        return like.new_zeros(1, 1, 1, 3)
    return scene.background[None] if scene.background.ndim == 3 else scene.background[None, None, None]


def _scene_tensors(scene: Scene) -> _Tensors:
    camera, lamp = scene.camera, scene.lamp
    own: _Tensors = {
        "focal": (camera.focal, [(2,)]),
        "centre": (camera.centre, [(2,)]),
        "camera rotation": (camera.rotation, [(3, 3)]),
        "camera translation": (camera.translation, [(3,)]),
        "background": (scene.background, [(3,), (camera.height, camera.width, 3)]),
    }
    if lamp is not None:
        own |= {"lamp direction": (lamp.direction, [(3,)]), "lamp radiance": (lamp.radiance, [(3,)])}
    return own


def _object_tensors(item: MeshObject) -> _Tensors:
    count = item.topology.vertex_count
    coordinates, texels = item.texture_coordinates, None if item.texture is None else item.texture.texels
    return {
        "vertices": (item.vertices, [(count, 3)]),
        "albedo": (item.albedo, [(3,), (count, 3)]),
        "rotation": (item.rotation, [(3, 3)]),
        "translation": (item.translation, [(3,)]),
        "light": (item.light, [(9,), (9, 3)]),
        "normals": (item.normals, [(count, 3)]),
        "texture_coordinates": (coordinates, [(0 if coordinates is None else len(coordinates), 2)]),
        "texture": (texels, [(0 if texels is None else len(texels), 3)]),
    }


def _check_scene(index: int, scene: Scene, size: tuple[int, int], like: torch.Tensor) -> None:
    camera, name = scene.camera, f"of scene {index}"
    if (camera.height, camera.width) != size:
        raise ValueError(
            f"images of one batch must be of one size, {size[1]} x {size[0]}; got {camera.width} x"
            f" {camera.height} {name}. Render other sizes apart."
        )
    _check(name, _scene_tensors(scene), like)


def _check_object(name: str, item: MeshObject, like: torch.Tensor) -> None:
    _check(f"of {name}", _object_tensors(item), like)
    item.topology.check_unchanged()
    topology, texture = item.topology, item.texture
    _check_device(f"the topology of {name}", (topology.faces, topology.texture_faces, topology.edges), like)
    if texture is None:
        return
    _check_device(f"the texture of {name}", (texture.levels, texture.first), like)
    rows = 0 if item.texture_coordinates is None else len(item.texture_coordinates)
    if item.texture_coordinates is None or item.topology.texture_rows > rows:
        raise ValueError(
            f"a texture needs a row of texture_coordinates for each of its corners; {name} has "
            f"{rows} for corners up to {item.topology.texture_rows - 1}"
        )


def _check_device(what: str, tables: tuple[torch.Tensor, ...], like: torch.Tensor) -> None:
    """ValueError unless tables are where the camera is: kernels read them there."""
    for each in tables:
        if each.device != like.device:
            raise ValueError(
                f"{what} must be on {like.device}, like the camera; it is on {each.device}. Make it there:"
                f" Topology.of has a device, a pyramid is where its texture is."
            )


def _check(of: str, tensors: _Tensors, like: torch.Tensor | None = None, finite: bool = False) -> None:
    """ValueError unless each of the tensors has one of its shapes, the type of `like`, and is finite."""
    for what, (tensor, shapes) in tensors.items():
        if tensor is None:
            continue
        if not isinstance(tensor, torch.Tensor):
            raise ValueError(f"{what} {of} must be a tensor; got a {type(tensor).__name__}. Convert it.")
        if tensor.shape not in shapes:
            wanted = " or ".join(map(str, shapes))
            raise ValueError(
                f"{what} {of} must be {wanted}; got {tuple(tensor.shape)}. Pass it in that shape."
            )
        if like is not None and (tensor.dtype != like.dtype or tensor.device != like.device):
            raise ValueError(
                f"{what} {of} must be {like.dtype} on {like.device}, like the camera; got {tensor.dtype} on "
                f"{tensor.device}. Convert it."
            )
        if finite and (bad := int((~tensor.detach().isfinite()).sum())):
            raise ValueError(
                f"{what} {of} must be finite; {bad} of {tensor.numel()} numbers are not. Clean them."
            )
