"""One camera's view of meshes as depth images, for layout and for the raster tier."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from vig.render import rasterize
from vig.scene import IMAGE_SIZE, Camera, ObjectClass


@dataclass(frozen=True)
class View:
    """A camera with its pose: rotation (3, 3) and translation (3,) camera_from_world, metres."""

    camera: Camera
    rotation: np.ndarray
    translation: np.ndarray

    @staticmethod
    def of(object_class: ObjectClass, azimuth: float, elevation: float, size: int = IMAGE_SIZE) -> View:
        """The standard camera of a class for a square image of `size` pixels, at angles in radians."""
        camera = Camera.standard(size, object_class.target_height)
        rotation, translation = camera.pose(
            torch.tensor([azimuth], dtype=torch.float64), torch.tensor([elevation], dtype=torch.float64)
        )
        return View(camera, rotation[0].numpy(), translation[0].numpy())

    def widened(self, factor: int) -> View:
        """The same view on a canvas `factor` (odd) times as large, whose middle is this frame."""
        c, aside = self.camera, (factor - 1) // 2
        cx, cy = c.cx + aside * c.width, c.cy + aside * c.height
        camera = Camera(factor * c.width, factor * c.height, c.focal, cx, cy)
        return View(camera, self.rotation, self.translation)

    def scaled(self, factor: float) -> View:
        """The same view in an image `factor` times as wide and high."""
        return View(self.camera.scaled(factor), self.rotation, self.translation)

    @property
    def eye(self) -> np.ndarray:
        """The eye in the world (3,), metres."""
        return -self.rotation.T @ self.translation

    @property
    def forward(self) -> np.ndarray:
        """Unit vector (3,) in the world along which depth is counted."""
        return self.rotation[2]

    def depth(self, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """Depth (H, W) metres of a world mesh wholly in front of the eye; inf where nothing is seen."""
        return rasterize(vertices, faces, self.rotation, self.translation, self.camera, cull=True).depth

    def window(self, vertices: np.ndarray) -> tuple[slice, slice]:
        """Rows and columns of the frame that can show world points (V, 3), all in front of the eye."""
        x, y, z = self.rotation @ vertices.T + self.translation[:, None]
        camera, scale = self.camera, self.camera.focal / z
        column, row = scale * x + camera.cx, scale * y + camera.cy

        def within(low: float, high: float, size: int) -> slice:
            return slice(min(max(int(low), 0), size), min(max(int(high + 1), 0), size))

        return (
            within(row.min(), row.max(), camera.height),
            within(column.min(), column.max(), camera.width),
        )
