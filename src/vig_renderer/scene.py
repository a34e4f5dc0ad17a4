"""Inputs and outputs of `render`: meshes with a pose and a surface, lights, a camera; the rendering."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import torch

from vig_renderer.texture import Pyramid
from vig_renderer.topology import Topology


@dataclass(frozen=True)
class MeshObject:
    """A mesh somewhere in the world, its surface, and the light that falls on it.

    vertices (V, 3): metres, the object's frame. topology: their faces. rotation (3, 3), translation (3,):
    world_from_object; None is the identity. albedo: (3,) for the whole, or (V, 3) colours of the vertices,
    linear RGB. texture: multiplies the albedo; it needs texture_coordinates (T, 2), one row per vertex or as
    `topology.texture_faces` states. normals (V, 3): unit, the object's frame; None means the mean of the
    adjacent faces', on the side from which their corners run counter-clockwise. light: SH coefficients (9,)
    grey or (9, 3) RGB of incident radiance, world frame. An object with neither light nor a lamp in its
    scene shows its albedo as it is.
    """

    vertices: torch.Tensor
    topology: Topology
    albedo: torch.Tensor
    rotation: torch.Tensor | None = None
    translation: torch.Tensor | None = None
    light: torch.Tensor | None = None
    texture: Pyramid | None = None
    texture_coordinates: torch.Tensor | None = None
    normals: torch.Tensor | None = None


@dataclass(frozen=True)
class DirectionalLight:
    """A distant lamp.

    direction (3,): towards the lamp, world frame, of any length. radiance (3,): linear RGB that a white
    surface facing it reflects.
    """

    direction: torch.Tensor
    radiance: torch.Tensor


@dataclass(frozen=True)
class Pinhole:
    """A camera: image size in pixels, focal lengths (2,) and principal point (2,) in pixels, pose.

    rotation (3, 3), translation (3,): camera_from_world, OpenCV axes, metres. Pixel centres at half-integers.
    """

    width: int
    height: int
    focal: torch.Tensor
    centre: torch.Tensor
    rotation: torch.Tensor
    translation: torch.Tensor

    @staticmethod
    def on_sphere(camera: Any, azimuth: torch.Tensor, elevation: torch.Tensor) -> "Pinhole":
        """Return a `vig.Camera` on its sphere at an azimuth and elevation (scalars, radians), of their type.

        Or any with its width, height, focal, focal_y, cx and cy, pixels, and `pose`.
        """
        rotation, translation = camera.pose(azimuth[None], elevation[None])
        return Pinhole(
            camera.width,
            camera.height,
            azimuth.new_tensor([camera.focal, camera.focal_y or camera.focal]),
            azimuth.new_tensor([camera.cx, camera.cy]),
            rotation[0],
            translation[0],
        )


@dataclass(frozen=True)
class Scene:
    """One image's content. background: linear RGB (3,) or (H, W, 3); None is black."""

    objects: list[MeshObject]
    camera: Pinhole
    lamp: DirectionalLight | None = None
    background: torch.Tensor | None = field(default=None)


@dataclass(frozen=True)
class Rendering:
    """B images of H x W, O objects in the scene that has most.

    rgb (B, H, W, 3): linear. coverage (B, H, W): the share of a pixel that objects cover. visible_masks
    (B, O, H, W): the share that shows each object. full_masks (B, O, H, W): the share that it covers,
    visible or hidden by others. These four are blended at occlusion edges.

    The surface at the pixel's centre: depth (B, H, W) in metres along the optical axis, inf where nothing
    is; normals (B, H, W, 3) unit, world frame, 0 where nothing is; object_id (B, H, W) int32, the place in
    the scene's list, -1 where nothing is; triangle_id (B, H, W) int32, the row of that object's faces, or -1.

    Full masks and the surface are computed on first use.
    """

    rgb: torch.Tensor
    coverage: torch.Tensor
    visible_masks: torch.Tensor
    full_masks: torch.Tensor
    depth: torch.Tensor
    normals: torch.Tensor
    object_id: torch.Tensor
    triangle_id: torch.Tensor

    @staticmethod
    def lazily(
        rgb: torch.Tensor,
        coverage: torch.Tensor,
        visible_masks: torch.Tensor,
        full_masks: Callable[[], torch.Tensor],
        surface: Callable[[], Sequence[torch.Tensor]],
    ) -> "Rendering":
        """Return a rendering whose full masks and surface (the last four) are computed at first use."""
        made = object.__new__(Rendering)
        modes = torch.is_inference_mode_enabled(), torch.is_grad_enabled()
        vars(made).update(rgb=rgb, coverage=coverage, visible_masks=visible_masks)
        vars(made).update(_later=(modes, full_masks, surface))
        return made

    def __getattr__(self, name: str) -> torch.Tensor:
        """Return a field that has not been computed."""
        if name not in ("full_masks", *_SURFACE) or "_later" not in vars(self):
            raise AttributeError(f"a Rendering has no {name}")
        (inference, graph), full_masks, surface = vars(self)["_later"]
        with torch.inference_mode(inference), torch.set_grad_enabled(graph):
            if name == "full_masks":
                vars(self)[name] = full_masks()
            else:
                vars(self).update(zip(_SURFACE, surface(), strict=True))
        found: torch.Tensor = vars(self)[name]
        return found

    def __getstate__(self) -> dict[str, torch.Tensor]:
        """Return all fields, computed: for copies, pickle and torch.save."""
        return {each.name: getattr(self, each.name) for each in fields(self)}


_SURFACE = ("depth", "normals", "object_id", "triangle_id")
