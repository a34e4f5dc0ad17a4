"""A user's hints on the object in a photo."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from vig.inference import PixelLabel, WindowHints
from vig.io.checks import number_of
from vig.io.errors import UserError
from vig.photo import Window
from vig.photo.masks import read_mask
from vig.recognition.find import LocationHints
from vig.scene import IMAGE_SIZE, ObjectClass
from vig.scene.camera import view_of as view_of
from vig.scene.functions import numpy_of_tensor


@dataclass(frozen=True)
class Stroke:
    """A stroke that a user painted with a `PixelLabel`, all in pixels of the photo.

    Attributes:
        x: Place where the brush was set down, to the right.
        y: The same, downwards.
        radius: Radius of the brush.
        said: Label of its pixels.
        path: Further places that it was moved along.
    """

    x: float
    y: float
    radius: float
    said: int
    path: tuple[tuple[float, float], ...] = ()

    def paint(self, marks: np.ndarray) -> None:
        """Set the pixels of marks (H, W) uint8 whose centres lie within."""
        places = [(self.x, self.y), *self.path]
        for start, end in zip(places, places[1:] or places, strict=False):
            (left, right), (top, bottom) = (
                (max(math.floor(min(pair) - self.radius), 0), max(math.ceil(max(pair) + self.radius), 0))
                for pair in zip(start, end, strict=True)
            )
            part = marks[top:bottom, left:right]
            rows, columns = np.ogrid[: part.shape[0], : part.shape[1]]
            x, y = columns + left + 0.5 - start[0], rows + top + 0.5 - start[1]
            across, down = end[0] - start[0], end[1] - start[1]
            along = ((x * across + y * down) / max(across**2 + down**2, 1e-9)).clip(0, 1)
            part[np.hypot(x - along * across, y - along * down) <= self.radius] = self.said


@dataclass(frozen=True, kw_only=True)
class PlainHints:
    """The hints that are plain values, as JSON holds them.

    Attributes:
        points: Places x, y in pixels of points that the class names, such as {"spout": (120, 80)}; hidden
            ones, too. Their standard deviation is `POINT_NOISE` of the window's side.
        strokes: Painted one after the other, over marks.
        visible: Nothing hides any of the object.
        azimuth_deg: Azimuth of the camera, to some 8 degrees; one of `Explanation.alternatives`, say.
        elevation_deg: Elevation of the camera; it is held.
        roll_deg: Clockwise roll of the photo; it is held.
    """

    points: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    strokes: tuple[Stroke, ...] = ()
    visible: bool = False
    azimuth_deg: float | None = None
    elevation_deg: float | None = None
    roll_deg: float | None = None

    @property
    def plain(self) -> dict[str, Any]:
        """Return the hints' values by name."""
        return {each.name: getattr(self, each.name) for each in fields(PlainHints)}


@dataclass(frozen=True, eq=False, kw_only=True)
class Hints(PlainHints):
    """A user's knowledge of the object in a photo of H x W pixels; unknown parts are left out.

    Attributes:
        mask: (H, W) bool, all pixels in which the object is visible.
        marks: (H, W) uint8, `PixelLabel` of each pixel, such as scribbles.
        pose: (4, 4) camera_from_object of another tool, with which the search begins; gives azimuth,
            elevation and roll that are not stated.
    """

    mask: np.ndarray | None = None
    marks: np.ndarray | None = None
    pose: np.ndarray | None = None

    def __bool__(self) -> bool:
        arrays = self.mask, self.marks, self.pose
        return self.plain != PlainHints().plain or any(array is not None for array in arrays)

    def check(self, width: int, height: int, object_class: ObjectClass) -> "Hints":
        """Return hints with arrays of their types; UserError where they do not suit the photo or class."""
        changed: dict[str, Any] = {}
        for name, kind in (("mask", bool), ("marks", np.uint8)):
            if (value := getattr(self, name)) is not None:
                if name == "mask" and isinstance(value, str | Path):
                    value = read_mask(value)
                try:
                    array = np.asarray(numpy_of_tensor(value))
                except ValueError:  # rows of several lengths
                    array = np.empty(0, object)
                if array.ndim == 3 and 1 in (array.shape[0], array.shape[2]):
                    array = array[..., 0] if array.shape[2] == 1 else array[0]
                if name == "mask" and array.dtype.kind in "iuf" and array.size and np.isfinite(array).all():
                    # 0 and another value, or shades of which half of the range is the edge.
                    most = 1.0 if array.max() <= 1 else 255.0
                    array = array > 0 if len(np.unique(array)) <= 2 else array > most / 2
                if array.shape != (height, width) or array.dtype not in (bool, np.uint8):
                    raise UserError(
                        f"expected {name} of {width} x {height} pixels, bool or uint8; got {array.dtype} of"
                        f" shape {array.shape}. Draw it on the photo itself."
                    )
                if name == "marks" and array.max(initial=0) > max(PixelLabel):
                    raise UserError(
                        f"expected marks of 0 to {max(PixelLabel):d}; got {array.max()}. See Hints."
                    )
                changed[name] = array.astype(kind)
        if self.strokes:
            changed["marks"] = self._paint_strokes(changed.get("marks"), width, height)
            changed["strokes"] = ()
        if self.mask is not None and not changed["mask"].any():
            raise UserError(
                "expected a mask with the object; got an empty one. Mark where the object is seen."
            )
        points: dict[str, tuple[float, float]] = {}
        # Photo's sides from its middle within which a named point must be: the object may reach beyond the
        # photo.
        beyond = 1.5
        for name, place in self.points.items():
            if name not in object_class.points:
                named = ", ".join(object_class.points) or "none"
                raise UserError(
                    f"expected points that the class '{object_class.name}' names ({named}); got '{name}'."
                    " Use these."
                )
            x, y = points[name] = _finite(f"the point '{name}'", place, 2)
            if abs(x - width / 2) > beyond * width or abs(y - height / 2) > beyond * height:
                raise UserError(
                    f"expected the point '{name}' on the photo or near it, 0 to {width}, 0 to {height}; got"
                    f" {x:g}, {y:g}. Choose another place."
                )
        changed["points"] = points
        for name, most in (("azimuth_deg", 1e6), ("elevation_deg", 90.0), ("roll_deg", 180.0)):
            if (value := getattr(self, name)) is not None:
                (number,) = _finite(name, (value,), 1)
                if abs(number) > most:
                    raise UserError(f"expected {name} within {most:g} degrees; got {number:g}. Give degrees.")
                changed[name] = number
        if self.pose is not None:
            changed["pose"] = check_pose(self.pose, object_class.viewing_distance)
        return replace(self, **changed)

    def _paint_strokes(self, marks: np.ndarray | None, width: int, height: int) -> np.ndarray:
        """Return marks (H, W) uint8 with the strokes."""
        marks = np.zeros((height, width), np.uint8) if marks is None else marks.copy()
        for stroke in self.strokes:
            reach = stroke.radius if 0 < stroke.radius <= width + height else math.nan
            inside = all(
                -reach < x < width + reach and -reach < y < height + reach
                for x, y in [(stroke.x, stroke.y), *stroke.path]
            )
            if not inside or stroke.said not in list(PixelLabel):
                raise UserError(
                    f"expected marks on the photo, 0 to {width}, 0 to {height}; got one at {stroke.x:g},"
                    f" {stroke.y:g}. Choose another place."
                )
            stroke.paint(marks)
        return marks

    def clues(self) -> LocationHints | None:
        """Return the hints that locate the object; None where none does."""
        seen = self.mask if self.marks is None else self.marks == PixelLabel.SEEN
        if self.mask is not None and self.marks is not None:
            seen = self.mask | (self.marks == PixelLabel.SEEN)
        seen = seen if seen is not None and seen.any() else None
        points = np.array(list(self.points.values()), float).reshape(-1, 2)
        return LocationHints(seen, points) if seen is not None or len(points) else None

    def to_plain(self) -> dict[str, Any]:
        """Return the hints in plain values: for masks and marks the number of pixels."""
        description: dict[str, Any] = {}
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, np.ndarray):
                description[one.name] = value.tolist() if one.name == "pose" else int(np.count_nonzero(value))
            elif value is not None and value is not False and value not in ({}, ()):
                description[one.name] = (
                    {n: list(p) for n, p in value.items()} if one.name == "points" else value
                )
        return description

    def views(self) -> tuple[float | None, float | None, float | None]:
        """Return azimuth, elevation and roll in radians as given, those of the pose where they are not."""
        angles = [self.azimuth_deg, self.elevation_deg, self.roll_deg]
        from_pose: tuple[float | None, ...] = (None, None, None) if self.pose is None else view_of(self.pose)
        azimuth, elevation, roll = (
            other if one is None else math.radians(one) for one, other in zip(angles, from_pose, strict=True)
        )
        return azimuth, elevation, roll

    def in_window(
        self, window: Window, object_class: ObjectClass, box: tuple[float, float, float, float] | None = None
    ) -> WindowHints:
        """Return the hints as the window shows them, with a box of the photo round the whole object."""
        labels = np.zeros((IMAGE_SIZE, IMAGE_SIZE), np.uint8)
        if self.mask is not None:
            visible_share = _share(self.mask, window)
            labels[visible_share > 0.9] = PixelLabel.SEEN
            labels[visible_share < 0.1] = PixelLabel.BACKGROUND if self.visible else PixelLabel.IN_FRONT
        if box is not None:
            labels[_beyond(box, window) & (labels != PixelLabel.SEEN)] = PixelLabel.BACKGROUND
            box = None if window.roll else window.box_within(box)
        if self.marks is not None:
            for kind in (PixelLabel.BACKGROUND, PixelLabel.IN_FRONT, PixelLabel.SEEN):
                labels[_share(self.marks == kind, window) > 0.2] = kind
        places = []
        for place in self.points.values():
            x, y = window.to_window(*place)
            places.append((x / window.side + 0.5, y / window.side + 0.5))
        azimuth, elevation, _ = self.views()
        held = {} if self.elevation_deg is None else {"elevation": math.radians(self.elevation_deg)}
        if self.roll_deg is not None:
            held["roll"] = 0.0  # the window is turned by it
        return WindowHints(
            labels,
            self.visible,
            np.array([object_class.points[name] for name in self.points], np.int64),
            np.array(places, np.float32).reshape(-1, 2),
            azimuth,
            elevation,
            held,
            box,
        )


def check_hints(hints: Any, mask: Any = None) -> Hints | None:
    """Return hints, with a mask that is given beside them. UserError for other objects, or a mask in both."""
    if hints is not None and not isinstance(hints, Hints):
        raise UserError(f"expected vig.Hints; got a {type(hints).__name__}. Name what you know in one.")
    if mask is None:
        return hints
    if hints is not None and hints.mask is not None:
        raise UserError("expected a mask, or hints with one; got both. Give one.")
    return replace(hints or Hints(), mask=mask)


def check_pose(value: Any, usual_distance: float) -> np.ndarray:
    """Return a pose (4, 4) camera_from_object of an object before the camera; UserError lists accepted forms.

    usual_distance: Metres at which a photo is taken of such an object.
    """
    try:
        pose = np.asarray(value, float)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape == (3, 4):
        pose = np.concatenate([pose, [[0.0, 0.0, 0.0, 1.0]]])
    received = None
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        received = (
            f"an array of shape {pose.shape}" if np.isfinite(pose).all() else "numbers that are not finite"
        )
    elif not np.allclose(pose[3], [0, 0, 0, 1], atol=1e-6):
        received = f"a last row of {pose[3].round(4).tolist()}; is it transposed (column by column)?"
    else:
        turn = pose[:3, :3]
        square = turn @ turn.T
        scale = math.sqrt(max(np.trace(square) / 3, 0.0))
        if not np.allclose(square, scale**2 * np.eye(3), atol=1e-3 * max(scale**2, 1e-9)):
            received = "a matrix whose upper left (3, 3) is no rotation"
        elif abs(scale - 1) > 1e-3:
            received = f"a rotation scaled by {scale:.4g}; divide its (3, 3) by that"
        elif np.linalg.det(turn) < 0:
            received = "a mirrored, left-handed frame; turn one axis over"
        # 100.0: usual distances beyond which an object is not: a pose in millimetres
        elif np.linalg.norm(pose[:3, 3]) > 100.0 * usual_distance:
            received = f"an object {np.linalg.norm(pose[:3, 3]):.4g} metres away; is that in millimetres?"
        elif pose[2, 3] <= 0:
            received = f"an object behind the camera, z = {pose[2, 3]:.4g}"
            received += "; of OpenGL or Blender? Multiply by diag(1, -1, -1, 1) from the left"
        elif np.hypot(*pose[:2, 3]) > 3 * pose[2, 3]:
            received = "an object far outside the camera's view; is it object_from_camera? Take the inverse"
    if received is not None:
        raise UserError(
            f"expected a pose as a rigid (4, 4) camera_from_object in metres, OpenCV axes; got {received}."
        )
    return pose


def _share(mask: np.ndarray, window: Window) -> np.ndarray:
    """Return the share (S, S) of the window's pixels that a mask (H, W) bool covers; 0 beyond the photo."""
    grey = np.repeat(mask[:, :, None].astype(np.float32), 3, axis=2)
    cut, inside = window.crop(grey)
    return np.asarray(cut[..., 0] * inside)


def _beyond(box: tuple[float, float, float, float], window: Window) -> np.ndarray:
    """Return the window's pixels (S, S) bool clearly outside a box of the photo."""
    middle = ((np.arange(IMAGE_SIZE) + 0.5) / IMAGE_SIZE - 0.5) * window.side
    x, y = window.to_photo(*np.meshgrid(middle, middle))
    # 0.03: the object may reach beyond a box drawn by hand by this share of its longer side
    margin = 0.03 * max(box[2:])
    off_x, off_y = abs(x - box[0] - box[2] / 2) - box[2] / 2, abs(y - box[1] - box[3] / 2) - box[3] / 2
    return np.asarray(np.maximum(off_x, off_y) > margin)


def _finite(what: str, value: Any, count: int) -> tuple[Any, ...]:
    try:
        numbers = tuple(map(number_of, value))
    except TypeError:
        numbers = ()
    if len(numbers) != count or not all(number is not None and math.isfinite(number) for number in numbers):
        raise UserError(
            f"expected {what} as {count} finite number(s); got {str(value)[:60]}. Give pixels or degrees."
        )
    return numbers
