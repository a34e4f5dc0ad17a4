"""The object's square window in a photo of any size: cutting it out and mapping results back."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image

from vig.errors import UserError
from vig.photo.images import linear_photo
from vig.scene import IMAGE_SIZE, Camera
from vig.scene.camera import FOCAL_OVER_WIDTH

WINDOW_OVER_BOX = 1.4
"""Side of the window over the longer side of the object's box, as in training images (median)."""

BOX_BELOW_CENTRE = 0.033
"""How far the box's centre lies below the window's, in sides of the window (median of training images)."""

SMALLEST_BOX = 8
LEFT = 4
"""Pixels of a half over those of the window cut from it: with 2, fits turn by a degree or two."""
LINES = 256
"""Lines of a photo that are drawn at a time."""
STRIP = 32
"""Lines of a half that are made at a time."""
FARTHER = (0.75, 25.0)
"""From an eye just outside the object to one so far away that perspective does not show."""


BESIDE = 4
"""Pixels beside a window that its resampling may read."""


class Halved:
    """A photo (H, W, 3) as `coded_photo` gives it, and its halves, linear RGB, made as they are needed."""

    def __init__(self, photo: np.ndarray):
        self._levels, self.shape = [photo], photo.shape

    def level(self, reduction: float) -> tuple[np.ndarray, int]:
        """The photo at 1 / scale of its size, and scale: a power of 2, `reduction` / `LEFT` at the most."""
        number = max(0, math.floor(math.log2(reduction / LEFT)))
        while len(self._levels) <= number:
            fine = self._levels[-1]
            made = np.empty((-(-fine.shape[0] // 2), -(-fine.shape[1] // 2), 3), np.float32)
            for top in range(0, len(made), STRIP):
                strip = linear_photo(fine[2 * top : 2 * (top + STRIP)])
                for channel in range(3):
                    plane = Image.fromarray(np.ascontiguousarray(strip[..., channel]))
                    made[top : top + STRIP, :, channel] = plane.reduce(2)
            self._levels.append(made)
        return self._levels[number], 2**number


@dataclass(frozen=True)
class Window:
    """A square of a photo: left and top corner and side, in the photo's pixels; it may reach beyond it.

    It is turned about its centre, clockwise by `roll` radians, so that what it shows stands upright.
    """

    left: float
    top: float
    side: float
    roll: float = 0.0

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
        return Window.round_box(box)

    @staticmethod
    def round_box(box: tuple[float, float, float, float], roll: float = 0.0) -> Window:
        """The window of a box (x, y, w, h) wherever it lies."""
        x, y, w, h = box
        side = WINDOW_OVER_BOX * max(w, h)
        # The box's centre lies below the window's, down the window's own vertical.
        below = BOX_BELOW_CENTRE * side
        centre = x + w / 2 + below * math.sin(roll), y + h / 2 - below * math.cos(roll)
        return Window(centre[0] - side / 2, centre[1] - side / 2, side, roll)

    def cut(self, photo: np.ndarray | Halved, size: int = IMAGE_SIZE) -> tuple[np.ndarray, np.ndarray]:
        """Resample the window: linear RGB (size, size, 3) float32, and (size, size) bool, where it lies in
        the photo. photo (H, W, 3) as `coded_photo`. Beyond the photo its border is continued.
        """
        if isinstance(photo, Halved):
            photo, scale = photo.level(self.side / size)
            here = Window(self.left / scale, self.top / scale, self.side / scale, self.roll)
            return here.cut(photo, size)
        if self.roll:
            return self._cut_turned(photo, size)
        height, width = photo.shape[:2]
        whole = self.left == 0 and self.top == 0 and self.side == width == height == size
        if whole:
            return linear_photo(photo), np.ones((size, size), bool)
        right, bottom = self.left + self.side, self.top + self.side
        # Only what the resampling reads is made linear: the window, and what the bicubic takes beside it.
        margin = math.ceil(max(0, -self.left, -self.top, right - width, bottom - height))
        columns, rows = (
            np.arange(max(math.floor(low) - BESIDE, -margin), min(math.ceil(high) + BESIDE, length + margin))
            for low, high, length in ((self.left, right, width), (self.top, bottom, height))
        )
        padded = linear_photo(photo[np.ix_(rows.clip(0, height - 1), columns.clip(0, width - 1))])
        inside = np.outer((rows >= 0) & (rows < height), (columns >= 0) & (columns < width))
        area = (self.left - columns[0], self.top - rows[0], right - columns[0], bottom - rows[0])
        method = Image.Resampling.BOX if self.side > size else Image.Resampling.BICUBIC
        channels = [*np.moveaxis(padded, 2, 0), inside]
        cut = [
            np.asarray(
                Image.fromarray(np.ascontiguousarray(channel, np.float32)).resize((size, size), method, area)
            )
            for channel in channels
        ]
        return np.clip(np.stack(cut[:3], axis=-1), 0, 1), cut[3] > 0.5

    def _cut_turned(self, photo: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
        """`cut`, from the upright window about this one, resampled at its scale."""
        wide = math.ceil(size * (abs(math.cos(self.roll)) + abs(math.sin(self.roll))))
        side = self.side * wide / size
        grown = (side - self.side) / 2
        image, known = Window(self.left - grown, self.top - grown, side).cut(photo, wide)
        cos, sin = math.cos(self.roll), math.sin(self.roll)
        middle = wide / 2 - (cos - sin) * size / 2, wide / 2 - (sin + cos) * size / 2
        transform = (cos, -sin, middle[0], sin, cos, middle[1])
        cut = [
            np.asarray(
                Image.fromarray(np.ascontiguousarray(channel, np.float32)).transform(
                    (size, size), Image.Transform.AFFINE, transform, Image.Resampling.BICUBIC
                )
            )
            for channel in (*np.moveaxis(image, 2, 0), known)
        ]
        return np.clip(np.stack(cut[:3], axis=-1), 0, 1), cut[3] > 0.5

    def farther(self, focal: float) -> float:
        """How much longer a photo's focal length in pixels is than that of the window's standard camera,
        within `FARTHER`.
        """
        return min(max(focal / (FOCAL_OVER_WIDTH * self.side), FARTHER[0]), FARTHER[1])

    @property
    def centre(self) -> tuple[float, float]:
        """Its middle in the photo's pixels."""
        return self.left + self.side / 2, self.top + self.side / 2

    def to_photo(self, x: float, y: float) -> tuple[float, float]:
        """A point of the photo from where it is in the window: pixels of the photo from its middle."""
        cos, sin = math.cos(self.roll), math.sin(self.roll)
        return self.centre[0] + cos * x - sin * y, self.centre[1] + sin * x + cos * y

    def to_window(self, x: float, y: float) -> tuple[float, float]:
        """Where a point of the photo is in the window: pixels of the photo from its middle."""
        cos, sin, x, y = math.cos(self.roll), math.sin(self.roll), x - self.centre[0], y - self.centre[1]
        return cos * x + sin * y, cos * y - sin * x

    def camera(self, camera: Camera, width: int, height: int) -> Camera:
        """The camera of the whole photo of width x height from that of its window."""
        scale = self.side / camera.width
        at = ((camera.cx - camera.width / 2) * scale, (camera.cy - camera.height / 2) * scale)
        cx, cy = self.to_photo(*at)
        camera = camera.scaled(scale)
        return replace(camera, width=width, height=height, cx=cx, cy=cy, roll=camera.roll + self.roll)

    def back(self, image: np.ndarray, rows: slice, columns: slice, outside: float = 0.0) -> np.ndarray:
        """A map (S, S) of the window drawn into rows and columns of the photo, float32.

        Beyond the window it is `outside`.
        """
        scale, half = len(image) / self.side, len(image) / 2
        cos, sin = scale * math.cos(self.roll), scale * math.sin(self.roll)
        x, y = self.centre[0] - columns.start, self.centre[1] - rows.start
        transform = (cos, sin, half - cos * x - sin * y, -sin, cos, half + sin * x - cos * y)
        source = Image.fromarray(np.ascontiguousarray(image, np.float32))
        size = columns.stop - columns.start, rows.stop - rows.start
        method = Image.Resampling.BILINEAR
        return np.asarray(
            source.transform(size, Image.Transform.AFFINE, transform, method, fillcolor=outside)
        )

    def carried(self, image: np.ndarray, there: Window, outside: float = 0.0) -> np.ndarray:
        """A map (S, S) of this window as another window of the photo shows it, float32.

        Where that lies beyond this window it is `outside`.
        """
        size = len(image)
        corners = [self.to_window(*there.to_photo(x, y)) for x, y in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))]
        (x0, y0), (x1, y1), (x2, y2) = corners
        back, here = size / self.side, there.side / size
        a, b, d, e = (back * here * each for each in (x1 - x0, x2 - x0, y1 - y0, y2 - y0))
        middle = size / 2
        transform = (
            a, b, back * x0 + middle - (a + b) * middle, d, e, back * y0 + middle - (d + e) * middle
        )  # fmt: skip
        source = Image.fromarray(np.ascontiguousarray(image, np.float32))
        method = Image.Resampling.BILINEAR
        return np.asarray(
            source.transform((size, size), Image.Transform.AFFINE, transform, method, fillcolor=outside)
        )

    def tiles(self, width: int, height: int) -> Iterator[tuple[slice, slice]]:
        """The part of a photo that the window touches, as rows and columns of a few lines at a time."""
        half = self.side / 2 * (abs(math.cos(self.roll)) + abs(math.sin(self.roll)))
        left, right, top, bottom = (
            min(max(edge, 0), length)
            for edge, length in (
                (math.floor(self.centre[0] - half), width),
                (math.ceil(self.centre[0] + half), width),
                (math.floor(self.centre[1] - half), height),
                (math.ceil(self.centre[1] + half), height),
            )
        )
        if left < right:
            for line in range(top, bottom, LINES):
                yield slice(line, min(line + LINES, bottom)), slice(left, right)
