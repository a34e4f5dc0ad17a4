"""A posed camera, and the depth images that it sees, for layout and rendering."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from vig.scene import IMAGE_SIZE, Camera, ObjectClass
from vig_native import engine
from vig_world.dataset.spec import Lens, SceneSpec
from vig_world.raster.rasterize import rasterize
from vig_world.rotations import about_z

NEAR = 0.02  # metres; anything nearer to the camera's plane is clipped


@dataclass(frozen=True)
class View:
    """A camera with its pose: rotation (3, 3) and translation (3,) camera_from_world, metres."""

    camera: Camera
    rotation: np.ndarray
    translation: np.ndarray

    @staticmethod
    def of(object_class: ObjectClass, azimuth: float, elevation: float, size: int = IMAGE_SIZE) -> View:
        """Return the standard camera of a class for a square image of `size` pixels, at angles in radians."""
        return View.through(Lens(), object_class, azimuth, elevation, size)

    @staticmethod
    def of_scene(
        spec: SceneSpec, object_class: ObjectClass, size: int | tuple[int, int] = IMAGE_SIZE
    ) -> View:
        """Return the camera of a scene, for an image of `size` pixels a side, or of width x height.

        In the middle of the frame is the largest square that it has room for: the picture for which the scene
        was composed. A wide frame shows more at the sides, a tall one more above and below.
        """
        width, height = (size, size) if isinstance(size, int) else size
        side = min(width, height)
        square = View.through(spec.lens, object_class, spec.azimuth, spec.elevation, side)
        return square.reframe(width, height)

    @staticmethod
    @lru_cache(maxsize=64)
    def through(
        lens: Lens, object_class: ObjectClass, azimuth: float, elevation: float, size: int = IMAGE_SIZE
    ) -> View:
        """Return the camera of a class with a lens of its own."""
        standard = object_class.camera(size, lens.farther)
        camera = replace(
            standard,
            focal=standard.focal * lens.scale,
            cx=standard.cx + lens.shift[0] * size,
            cy=standard.cy + lens.shift[1] * size,
            roll=lens.roll,
        )
        placed = camera.distance, camera.target_height, camera.roll  # the same for images of all sizes
        return View(camera, *_pose(*placed, azimuth, elevation))

    def widen(self, factor: int) -> View:
        """Return the same view on a canvas `factor` (odd) times as large, whose middle is this frame."""
        c, aside = self.camera, (factor - 1) // 2
        cx, cy = c.cx + aside * c.width, c.cy + aside * c.height
        camera = Camera(factor * c.width, factor * c.height, c.focal, cx, cy)
        return View(camera, self.rotation, self.translation)

    def reframe(self, width: int, height: int) -> View:
        """Return the same view in a frame of width x height pixels with the same middle."""
        c = self.camera
        if (width, height) == (c.width, c.height):
            return self
        cx, cy = c.cx + (width - c.width) / 2, c.cy + (height - c.height) / 2
        return View(replace(c, width=width, height=height, cx=cx, cy=cy), self.rotation, self.translation)

    def scale(self, factor: float) -> View:
        """Return the same view in an image `factor` times as wide and high."""
        return View(self.camera.scale(factor), self.rotation, self.translation)

    @cached_property
    def eye(self) -> np.ndarray:
        """Return the camera's centre in the world (3,), metres."""
        return -self.rotation.T @ self.translation

    @cached_property
    def near(self) -> float:
        """Return the depth, metres, to which things are clipped: less for a camera near object or ground."""
        height = max(float(self.eye[2]), 1e-3)
        # Shares of the distance to the object, and of the camera's height, up to which things are clipped
        # where that is less: for things of at most 7 cm, and cameras on the ground.
        near_share, eye_share = 0.2, 0.5
        return min(NEAR, near_share * self.camera.distance, eye_share * height)

    @cached_property
    def native(self) -> Any:
        """Return the same view in the native library."""
        c, pose = (
            self.camera,
            [np.ascontiguousarray(a, np.float64) for a in (self.rotation, self.translation)],
        )
        return engine.camera(*pose, c.focal, c.cx, c.cy, self.near, c.width, c.height)

    @property
    def forward(self) -> np.ndarray:
        """Return the unit vector (3,) in the world along which depth is counted."""
        return self.rotation[2]

    def depth(self, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """Return the depth (H, W) metres of a world mesh wholly before the camera; inf where none is seen."""
        return rasterize(vertices, faces, self.rotation, self.translation, self.camera, cull=True).depth

    def windows(self, clouds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return first and end rows and columns, (N,) each, of the frame that can show clouds (N, P, 3)."""
        points = clouds @ self.rotation.T + self.translation
        camera = self.camera
        scale = camera.focal / points[..., 2]
        row, column = scale * points[..., 1] + camera.cy, scale * points[..., 0] + camera.cx
        return (
            row.min(1).clip(0, camera.height).astype(int),
            (row.max(1) + 1).clip(0, camera.height).astype(int),
            column.min(1).clip(0, camera.width).astype(int),
            (column.max(1) + 1).clip(0, camera.width).astype(int),
        )


@lru_cache(maxsize=64)
def _pose(
    distance: float, target_height: float, roll: float, azimuth: float, elevation: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rotation (3, 3) and translation (3,) of a camera, read-only.

    Same as `Camera.pose`, which is for many views at once: plain numbers are faster for a single one.
    """
    sa, ca, se, ce = math.sin(azimuth), math.cos(azimuth), math.sin(elevation), math.cos(elevation)
    level = np.array([[ca, sa, 0.0], [se * sa, -se * ca, -ce], [-ce * sa, ce * ca, -se]])
    rotation = about_z(roll) @ level if roll else level
    translation = -target_height * rotation[:, 2] + [0.0, 0.0, distance]
    for array in (rotation, translation):
        array.setflags(write=False)
    return rotation, translation
