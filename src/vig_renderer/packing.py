"""Scenes laid side by side for the library: the objects of a whole batch, numbered through."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, chain
from typing import Any

import torch

from vig_native import engine
from vig_renderer.scene import MeshObject, Scene

_Tensors = dict[str, tuple[torch.Tensor | None, list[tuple[int, ...]]]]
"""Tensors by name, each with the shapes that it may have."""

INPUTS = (
    *("vertices", "rotation", "translation", "normals", "albedo", "light"),
    *("lamp", "radiance", "camera_rotation", "camera_translation", "focal", "centre"),
    *("coordinates", "texels"),
)
"""Names of an object's inputs, in the order of `ObjectInput` in vig_native/scenes.h."""


@dataclass(frozen=True)
class PackedScenes:
    """All objects of B scenes, numbered through: O of them with V vertices and F faces.

    inputs (O): those of INPUTS for each object, None where there is none. meshes (O): see `Topology.mesh`.
    image, place (O): an object's scene and its place in that scene's list. vertex_counts (O). levels (O): for
    the object's texture, see `Pyramid`. background (B, H, W, 3), or (B, 3). size: (B, H, W).
    """

    scenes: Sequence[Scene]
    inputs: list[list[torch.Tensor | None]]
    meshes: list[Any]
    image: list[int]
    place: list[int]
    vertex_counts: list[int]
    levels: list[torch.Tensor | None]
    background: torch.Tensor
    size: tuple[int, int, int]

    @property
    def most_objects(self) -> int:
        """Return the greatest number of objects in a scene."""
        return max(self.place, default=-1) + 1

    @property
    def tensors(self) -> list[torch.Tensor | None]:
        """Return the differentiable inputs of a picture: the background, then the inputs of each object."""
        return [self.background, *chain.from_iterable(self.inputs)]

    def in_library(self, samples: int, near: float, alone: bool = False) -> Any:
        """Return scenes in the native library: a layer for each image, or for each object's mask alone."""
        starts = list(range(len(self.image) + 1))
        if not alone:
            starts = [0, *accumulate(self.image.count(image) for image in range(self.size[0]))]
        kind = engine.Scenes32 if self.background.dtype == torch.float32 else engine.Scenes64
        levels = [None if each is None else each.contiguous().numpy() for each in self.levels]
        masks = 1 if alone else self.most_objects
        return kind(self.meshes, levels, self.place, starts, *self.size[1:], samples, near, masks, alone)

    def check_numbers(self) -> None:
        """Raise ValueError that names the first input that is not finite, or focal lengths of 0 or less."""
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

    Numbers are for `check_numbers`, where the library has met one that is not finite.
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
    if like.device.type != "cpu":
        raise ValueError(f"the renderer draws on the processor; got a camera on {like.device}. Call .cpu().")
    if not all(isinstance(side, int) and side < 1 << 24 for side in (height, width)):
        raise ValueError(
            f"an image's sides must be whole numbers below 2^24; got {width} x {height}. Give its size."
        )
    if height < 1 or width < 1:
        raise ValueError(f"an image must have at least one pixel; got {width} x {height}. Give its size.")
    inputs, meshes, image, place, counts, levels = [], [], [], [], [], []
    for index, scene in enumerate(scenes):
        _check_scene(index, scene, (height, width), like)
        camera, lamp = scene.camera, scene.lamp
        shared = (
            *((lamp.direction, lamp.radiance) if lamp else (None, None)),
            *(camera.rotation, camera.translation, camera.focal, camera.centre),
        )
        for number, item in enumerate(scene.objects):
            meshes.append(_check_mesh(f"object {number} of scene {index}", item, like))
            image.append(index)
            place.append(number)
            counts.append(item.topology.vertex_count)
            levels.append(None if item.texture is None else item.texture.levels)
            own = item.vertices, item.rotation, item.translation, item.normals, item.albedo, item.light
            textured = item.texture is not None
            inputs.append([*own, *shared, item.texture_coordinates if textured else None])
            inputs[-1].append(item.texture.texels if item.texture else None)
    background = [_background(scene, like) for scene in scenes]
    if any(each.ndim == 3 for each in background):
        background = [each if each.ndim == 3 else each.expand(height, width, 3) for each in background]
    return PackedScenes(
        scenes=scenes,
        inputs=inputs,
        meshes=meshes,
        image=image,
        place=place,
        vertex_counts=counts,
        levels=levels,
        background=background[0][None] if len(background) == 1 else torch.stack(background),
        size=(len(scenes), height, width),
    )


def _background(scene: Scene, like: torch.Tensor) -> torch.Tensor:
    """Return (3,), or (H, W, 3) of a picture."""
    return like.new_zeros(3) if scene.background is None else scene.background


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


def _check_mesh(name: str, item: MeshObject, like: torch.Tensor) -> Any:
    """Return the mesh of an object, see `Topology.mesh`."""
    _check(f"of {name}", _object_tensors(item), like)
    mesh = item.topology.mesh
    rows = 0 if item.texture_coordinates is None else len(item.texture_coordinates)
    if item.texture is not None and (item.texture_coordinates is None or mesh.texture_rows > rows):
        raise ValueError(
            f"a texture needs a row of texture_coordinates for each of its corners; {name} has "
            f"{rows} for corners up to {mesh.texture_rows - 1}"
        )
    return mesh


def _check(of: str, tensors: _Tensors, like: torch.Tensor | None = None, finite: bool = False) -> None:
    """Raise ValueError unless each tensor has one of its shapes, the type of `like`, and is finite."""
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
