"""The object's square window in a photo of any size: cutting it out and mapping results back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image

from vig.errors import UserError
from vig.scene import IMAGE_SIZE, Camera

WINDOW_OVER_BOX = 1.4
"""Side of the window over the longer side of the object's box, as in training images (median)."""

BOX_BELOW_CENTRE = 0.033
"""How far the box's centre lies below the window's, in sides of the window (median of training images)."""

SMALLEST_BOX = 8


@dataclass(frozen=True)
class Window:
    """A square of a photo: left and top corner and side, in the photo's pixels; it may reach beyond it."""

    left: float
    top: float
    side: float

    @staticmethod
    def of(width: int, height: int, box: tuple[float, float, float, float] | None = None) -> Window:
        """The window of a box (x, y, w, h) round the whole object, or of the whole photo.

        Raises:
            UserError: The box is not inside the photo or too small.
        """
        if box is None:
            side = float(max(width, height))
            return Window((width - side) / 2, (height - side) / 2, side)
        x, y, w, h = box
        inside = x >= 0 and y >= 0 and x + w <= width and y + h <= height
        if not all(map(math.isfinite, box)) or min(w, h) < SMALLEST_BOX or not inside:
            raise UserError(
                f"expected a box x,y,w,h of at least {SMALLEST_BOX} pixels a side within the photo of"
                f" {width} x {height}; got {x:g},{y:g},{w:g},{h:g}. Cut it at the photo's edges or widen it."
            )
        side = WINDOW_OVER_BOX * max(w, h)
        return Window(x + w / 2 - side / 2, y + h / 2 - (0.5 + BOX_BELOW_CENTRE) * side, side)

    def cut(self, photo: np.ndarray, size: int = IMAGE_SIZE) -> tuple[np.ndarray, np.ndarray]:
        """Resample the window: linear RGB (size, size, 3) float32, and (size, size) bool, where it lies in
        the photo. photo (H, W, 3) linear RGB. Beyond the photo its border is continued.
        """
        height, width = photo.shape[:2]
        whole = self.left == 0 and self.top == 0 and self.side == width == height == size
        if whole:
            return photo, np.ones((size, size), bool)
        margin = int(np.ceil(max(0, -self.left, -self.top, self.left + self.side - width)))
        margin = int(max(margin, np.ceil(self.top + self.side - height)))
        padded = np.pad(photo, ((margin, margin), (margin, margin), (0, 0)), mode="edge")
        inside = np.pad(np.ones((height, width), np.float32), margin)
        corner = (self.left + margin, self.top + margin)
        area = (*corner, corner[0] + self.side, corner[1] + self.side)
        method = Image.Resampling.BOX if self.side > size else Image.Resampling.BICUBIC
        channels = [*np.moveaxis(padded, 2, 0), inside]
        cut = [
            np.asarray(
                Image.fromarray(np.ascontiguousarray(channel, np.float32)).resize((size, size), method, area)
            )
            for channel in channels
        ]
        return np.clip(np.stack(cut[:3], axis=-1), 0, 1), cut[3] > 0.5

    def camera(self, camera: Camera, width: int, height: int) -> Camera:
        """The camera of the whole photo of width x height from that of its window."""
        scale = self.side / camera.width
        return replace(
            camera.scaled(scale),
            width=width,
            height=height,
            cx=camera.cx * scale + self.left,
            cy=camera.cy * scale + self.top,
        )

    def back(self, image: np.ndarray, width: int, height: int) -> np.ndarray:
        """A map (S, S) of the window, in [0, 1], drawn into the photo's frame: (height, width) float32.

        Outside the window it is 0.
        """
        scale = len(image) / self.side
        transform = (scale, 0.0, -self.left * scale, 0.0, scale, -self.top * scale)
        source = Image.fromarray(np.ascontiguousarray(image, np.float32))
        return np.asarray(
            source.transform((width, height), Image.Transform.AFFINE, transform, Image.Resampling.BILINEAR)
        )
