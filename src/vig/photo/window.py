"""The object's square window in a photo of any size: cutting it out and mapping results back."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from PIL import Image

from vig.io.errors import UserError
from vig.photo.images import linear_photo, linear_planes
from vig.photo.lens import MIN_COSINE, Intrinsics
from vig.photo.masks import box_of
from vig.scene import IMAGE_SIZE, Camera
from vig.scene.camera import FOCAL_OVER_WIDTH

WINDOW_OVER_BOX = 1.4
"""Side of the window over the longer side of the object's box, as in training images (median)."""

BOX_BELOW_CENTRE = 0.033
"""Distance of the box's centre below the window's, in sides of the window (median of training images)."""

SMALLEST_BOX = 8  # pixels of a box's shorter side, at least
PREFILTER_PIXELS = 4
"""Pixels of the halved photo per pixel of its window, at least: with 2, fits turn by a degree or two."""
LINES = 256  # lines of a photo that are drawn at a time
STRIP = 32  # lines of a half that are made at a time
DISTANCE_RATIO_BOUNDS = (0.75, 25.0)
"""Bounds: a camera just outside the object, and one so far away that perspective does not show."""


BESIDE = 4  # pixels beside a window that its resampling may read

Place = TypeVar("Place", float, np.ndarray)


class ImagePyramid:
    """A photo (H, W, 3) as `coded_photo` gives it, and its halves, linear RGB, made as they are needed."""

    def __init__(self, photo: np.ndarray):
        self._levels, self.shape = [photo], photo.shape
        self.latest: tuple[tuple[Window, int], tuple[np.ndarray, np.ndarray]] | None = None
        """The last window that was cut out, its size, and its crop: windows are turned, then fitted."""

    def level(self, reduction: float) -> tuple[np.ndarray, int]:
        """Return the photo at 1/scale of its size, and scale, a power of 2 that `PREFILTER_PIXELS` bounds."""
        number = max(0, math.floor(math.log2(reduction / PREFILTER_PIXELS)))
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

    It is turned about its centre, clockwise by `roll` radians, so that its content stands upright. With a
    `lens` it is the picture of a camera that is turned towards its centre, see `Intrinsics.turned_to`: the
    photo as that lens would have taken it had it looked straight at the object.
    """

    left: float
    top: float
    side: float
    roll: float = 0.0
    lens: Intrinsics | None = None

    @staticmethod
    def of(width: int, height: int, box: tuple[float, float, float, float] | None = None) -> "Window":
        """Return the window of a box (x, y, w, h) round the whole object, or of the whole photo.

        The box may leave the photo, as one round an object that the photo cuts off does.

        Raises:
            UserError: The box is too small, or hardly any of it is in the photo.
        """
        if box is None:
            side = float(max(width, height))
            return Window((width - side) / 2, (height - side) / 2, side)
        x, y, w, h = box
        shown_w, shown_h = min(x + w, width) - max(x, 0.0), min(y + h, height) - max(y, 0.0)
        sized = all(map(math.isfinite, box)) and min(w, h) >= SMALLEST_BOX
        # 0.25: share of a box that must be in the photo
        large_enough = min(shown_w, shown_h) >= SMALLEST_BOX and shown_w * shown_h >= 0.25 * w * h
        if not sized or not large_enough:
            numbers = ",".join(f"{number:.12g}" for number in box)
            raise UserError(
                f"expected a box x,y,w,h of at least {SMALLEST_BOX} pixels a side, most of it in the photo of"
                f" {width} x {height}; got {numbers}. w and h are width and height, not another corner."
            )
        return Window.round_box(box)

    @staticmethod
    def round_box(box: tuple[float, float, float, float], roll: float = 0.0) -> "Window":
        """Return the window of a box (x, y, w, h) wherever it lies."""
        x, y, w, h = box
        side = WINDOW_OVER_BOX * max(w, h)
        # The box's centre lies below the window's, down the window's own vertical.
        below = BOX_BELOW_CENTRE * side
        centre = x + w / 2 + below * math.sin(roll), y + h / 2 - below * math.cos(roll)
        return Window(centre[0] - side / 2, centre[1] - side / 2, side, roll)

    def crop(self, photo: np.ndarray | ImagePyramid, size: int = IMAGE_SIZE) -> tuple[np.ndarray, np.ndarray]:
        """Return the resampled window: linear RGB (size, size, 3) float32, and (size, size) bool, where it
        lies in the photo. photo (H, W, 3) as `coded_photo`. Beyond the photo its border is continued.
        """
        if isinstance(photo, ImagePyramid):
            if photo.latest is None or photo.latest[0] != (self, size):
                level, scale = photo.level(self.side / size)
                photo.latest = (self, size), self.scale(1 / scale).crop(level, size)
            return photo.latest[1]
        if self.roll or self.lens is not None:
            return self._crop_level(photo, size)
        height, width = photo.shape[:2]
        whole = self.left == 0 and self.top == 0 and self.side == width == height == size
        if whole:
            return linear_photo(photo), np.ones((size, size), bool)
        right, bottom = self.left + self.side, self.top + self.side
        # Only pixels that the resampling reads are made linear: the window, and the bicubic's margin.
        margin = math.ceil(max(0, -self.left, -self.top, right - width, bottom - height))
        (x0, x1), (y0, y1) = (
            (max(math.floor(low) - BESIDE, -margin), min(math.ceil(high) + BESIDE, length + margin))
            for low, high, length in ((self.left, right, width), (self.top, bottom, height))
        )
        method = Image.Resampling.BOX if self.side > size else Image.Resampling.BICUBIC
        area = (self.left - x0, self.top - y0, right - x0, bottom - y0)
        cut = [
            np.asarray(plane.resize((size, size), method, area))
            for plane in linear_planes(_continue_border(photo, (y0, y1), (x0, x1)))
        ]
        shown = [
            Image.fromarray(((places >= 0) & (places < length)).astype(np.float32)[None]).resize(
                (size, 1), method, (start, 0, end, 1)
            )
            for places, length, start, end in (
                (np.arange(y0, y1), height, area[1], area[3]), (np.arange(x0, x1), width, area[0], area[2]),
            )
        ]  # fmt: skip
        return np.clip(np.stack(cut, axis=-1), 0, 1), np.outer(*map(np.asarray, shown)) > 0.5

    def _crop_level(self, photo: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
        """Crop the upright window about this one's corners, and resample that by the homography between."""
        left, right, top, bottom = self._bounds()
        side = max(right - left, bottom - top)
        wide = math.ceil(size * side / self.side)
        side = self.side * wide / size if self.lens is None else side  # a turn alone keeps the scale
        level = Window((left + right - side) / 2, (top + bottom - side) / 2, side)
        image, inside = level.crop(photo, wide)
        to_level = np.array([[1, 0, -level.left], [0, 1, -level.top], [0, 0, side / wide]]) * wide / side
        from_pixel = np.array([[1, 0, -size / 2], [0, 1, -size / 2], [0, 0, size / self.side]])
        transform = to_level @ self.photo_from_window @ from_pixel
        whole = bool(inside.all())
        cut = [
            _warp(channel, transform, (size, size), 0.0, Image.Resampling.BICUBIC)
            for channel in (*np.moveaxis(image, 2, 0), *[inside] * (not whole))
        ]
        shown = np.ones((size, size), bool) if whole else cut[3] > 0.5
        return np.clip(np.stack(cut[:3], axis=-1), 0, 1), shown

    @cached_property
    def focal(self) -> float | None:
        """Return the focal length of the camera that shows it, in the photo's pixels; None without a lens."""
        return None if self.lens is None else self.lens.turned_to(*self.centre)[1]

    @cached_property
    def turn(self) -> np.ndarray:
        """Return the rotation (3, 3) to the axes of the window's camera from the photo's camera's."""
        cos, sin = math.cos(self.roll), math.sin(self.roll)
        roll = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return roll if self.lens is None else roll @ self.lens.turned_to(*self.centre)[0]

    @cached_property
    def photo_from_window(self) -> np.ndarray:
        """Return homography (3, 3) to the photo from the window, in pixels of the photo about its middle."""
        if self.lens is None or self.focal is None:
            cos, sin = math.cos(self.roll), math.sin(self.roll)
            return np.array([[cos, -sin, self.centre[0]], [sin, cos, self.centre[1]], [0.0, 0.0, 1.0]])
        matrix: np.ndarray = self.lens.K @ self.turn.T @ np.diag([1 / self.focal, 1 / self.focal, 1.0])
        half = self.side / 2
        depth = matrix[2] @ [[-half, half, -half, half], [-half, -half, half, half], [1, 1, 1, 1]]
        if depth.min() < MIN_COSINE:
            raise UserError(
                f"expected an object that the lens sees less than 80 degrees off its axis; got a window of"
                f" {self.side:.0f} pixels about {self.centre[0]:.0f}, {self.centre[1]:.0f}. Check the camera."
            )
        return matrix

    def scale(self, factor: float) -> "Window":
        """Return the same window of the photo `factor` times as wide and high."""
        lens = self.lens and self.lens.scale(factor)
        return Window(self.left * factor, self.top * factor, self.side * factor, self.roll, lens)

    def camera_distance_ratio(self, focal: float) -> float:
        """Return the ratio of a photo's focal length in pixels to that of the window's standard
        camera, within `DISTANCE_RATIO_BOUNDS`.
        """
        return min(max(self.ratio(focal), DISTANCE_RATIO_BOUNDS[0]), DISTANCE_RATIO_BOUNDS[1])

    def ratio(self, focal: float) -> float:
        """Return `camera_distance_ratio` without limits."""
        return focal / (FOCAL_OVER_WIDTH * self.side)

    @property
    def centre(self) -> tuple[float, float]:
        """Return the window's middle in the photo's pixels."""
        return self.left + self.side / 2, self.top + self.side / 2

    def to_photo(self, x: Place, y: Place) -> tuple[Place, Place]:
        """Return a point of the photo from its place in the window: pixels of the photo from the middle."""
        return _map(self.photo_from_window, x, y)

    def to_window(self, x: Place, y: Place) -> tuple[Place, Place]:
        """Return the place in the window of a point of the photo: pixels of the photo from the middle."""
        return _map(np.linalg.inv(self.photo_from_window), x, y)

    def box_within(self, box: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        """Return a box (x, y, w, h) of the photo in sides of the window, which is not turned.

        Through a lens sides become slanted lines; their middles, near which objects touch them, are taken.
        """
        left, top, w, h = box
        right, bottom, middle = left + w, top + h, (left + w / 2, top + h / 2)
        x, y = self.to_window(
            np.array([left, right, middle[0], middle[0]]), np.array([middle[1], middle[1], top, bottom])
        )
        x, y = x / self.side + 0.5, y / self.side + 0.5
        return float(x[0]), float(y[2]), float(x[1] - x[0]), float(y[3] - y[2])

    def camera(self, camera: Camera, width: int, height: int) -> Camera:
        """Return the camera of a whole photo of width x height from that of its window, which has no lens."""
        scale = self.side / camera.width
        at = ((camera.cx - camera.width / 2) * scale, (camera.cy - camera.height / 2) * scale)
        cx, cy = self.to_photo(*at)
        camera = camera.scale(scale)
        return replace(camera, width=width, height=height, cx=cx, cy=cy, roll=camera.roll + self.roll)

    def paste(self, image: np.ndarray, rows: slice, columns: slice, outside: float = 0.0) -> np.ndarray:
        """Return a map (S, S) of the window drawn into rows and columns of the photo, float32.

        Beyond the window it is `outside`.
        """
        scale, half = len(image) / self.side, len(image) / 2
        if self.roll or self.lens is not None:
            to_pixel = np.array([[scale, 0, half], [0, scale, half], [0, 0, 1]])
            from_tile = np.array([[1, 0, columns.start], [0, 1, rows.start], [0, 0, 1]])
            transform = to_pixel @ np.linalg.inv(self.photo_from_window) @ from_tile
            size = columns.stop - columns.start, rows.stop - rows.start
            return _warp(image, transform, size, outside)
        across = scale * (np.arange(columns.start, columns.stop) + 0.5 - self.left)
        down = scale * (np.arange(rows.start, rows.stop) + 0.5 - self.top)
        drawn = _between(_between(np.asarray(image, np.float32), down, 0), across, 1)
        drawn[(down < 0) | (down >= len(image))] = outside
        drawn[:, (across < 0) | (across >= len(image))] = outside
        return drawn

    def warp_to(self, image: np.ndarray, there: "Window", outside: float = 0.0) -> np.ndarray:
        """Return a map (S, S) of this window as another window of the photo shows it, float32.

        Where that lies beyond this window it is `outside`.
        """
        size = len(image)
        here, other = size / self.side, there.side / size
        to_pixel = np.array([[here, 0, size / 2], [0, here, size / 2], [0, 0, 1]])
        from_pixel = np.array([[other, 0, -there.side / 2], [0, other, -there.side / 2], [0, 0, 1]])
        transform = np.linalg.inv(self.photo_from_window) @ there.photo_from_window
        return _warp(image, to_pixel @ transform @ from_pixel, (size, size), outside)

    def tiles(
        self, width: int, height: int, around: np.ndarray | None = None
    ) -> Iterator[tuple[slice, slice]]:
        """Yield the part of a photo that the window touches, as rows and columns of a few lines at a time.

        around: (S, S) bool, a map of the window; only its box is needed.
        """
        if around is None:
            bounds = self._bounds()
        elif (box := box_of(around)) is None:
            return
        else:
            left, top, wide, high = (self.side / len(around) * number for number in box)
            bounds = self._bounds((left, top, left + wide, top + high))
        ends = ((math.floor, width), (math.ceil, width), (math.floor, height), (math.ceil, height))
        left, right, top, bottom = (
            min(max(end(edge), 0), length) for edge, (end, length) in zip(bounds, ends, strict=True)
        )
        if left < right:
            for line in range(top, bottom, LINES):
                yield slice(line, min(line + LINES, bottom)), slice(left, right)

    def _bounds(
        self, part: tuple[float, float, float, float] | None = None
    ) -> tuple[float, float, float, float]:
        """Return left, right, top and bottom in the photo of the window, or of a part of it.

        part: left, top, right, bottom in pixels of the photo from the window's corner.
        """
        x0, y0, x1, y1 = (edge - self.side / 2 for edge in part or (0.0, 0.0, self.side, self.side))
        corners = [self.to_photo(x, y) for x in (x0, x1) for y in (y0, y1)]
        (left, top), (right, bottom) = np.min(corners, 0), np.max(corners, 0)
        return float(left), float(right), float(top), float(bottom)


def _continue_border(photo: np.ndarray, rows: tuple[int, int], columns: tuple[int, int]) -> np.ndarray:
    """Return rows and columns, from and to, of a photo (H, W, 3) whose border is continued beyond it."""
    within, beyond = [], []
    for (start, end), length in zip((rows, columns), photo.shape[:2], strict=True):
        first = min(max(start, 0), length - 1)
        last = max(min(end, length), first + 1)
        before = min(max(first - start, 0), end - start - 1)
        within.append(slice(first, last))
        beyond.append((before, end - start - before - (last - first)))
    part = photo[tuple(within)]
    return np.pad(part, (*beyond, (0, 0)), "edge") if np.any(beyond) else part


def _between(image: np.ndarray, places: np.ndarray, axis: int) -> np.ndarray:
    """Return values of a map at places along an axis, from the middles of two pixels; a new array."""
    first = np.floor(places - 0.5).astype(int)
    share = (places - 0.5 - first).astype(np.float32)
    last = image.shape[axis] - 1
    here, there = (image.take((first + step).clip(0, last), axis) for step in (0, 1))
    there -= here
    there *= np.expand_dims(share, 1 - axis)
    there += here
    return there


def _map(homography: np.ndarray, x: Place, y: Place) -> tuple[Place, Place]:
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in homography.tolist())
    return u / w, v / w


def _warp(
    image: np.ndarray,
    source: np.ndarray,
    size: tuple[int, int],
    outside: float,
    method: Image.Resampling = Image.Resampling.BILINEAR,
) -> np.ndarray:
    """Return a map (S, S) drawn at `size` (width, height), float32; `source` (3, 3) maps to its points."""
    picture = Image.fromarray(np.ascontiguousarray(image, np.float32))
    numbers = (source / source[2, 2]).ravel()[:8].tolist()
    return np.asarray(
        picture.transform(size, Image.Transform.PERSPECTIVE, numbers, method, fillcolor=outside)
    )
