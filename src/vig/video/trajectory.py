"""The frames of a video explained together: one object that moves and turns smoothly."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vig.explainer import Box, Explainer, Photo
from vig.explanation import Explanation
from vig.hints import Hints
from vig.inference.settings import UNIFORM_TURN
from vig.io.errors import UserError
from vig.photo import Window
from vig.photo.pinhole import turned_pose
from vig.scene import Camera, ObjectClass
from vig.scene.functions import numpy_of_tensor
from vig.video.following import SLOWING, Follower, Sighting, window_at
from vig.video.smoothing import BINS, LikeliestPath, smoothed
from vig_renderer.defaults import with_default_settings

MOST_SPREAD = math.radians(12.0)
"""Standard deviation of azimuth about one view, at most."""
FAR = math.radians(25.0)
"""A frame whose own view is farther from the chosen one is fitted again near that."""
ALIKE = 2.0, 3.0
"""Factors of the smoothed deviations of azimuth and elevation, as neighbouring frames err alike: so that 90 %
intervals held on videos of the validation split."""
TURN = math.radians(0.7)
"""Standard deviation of the change of the speed of azimuth from frame to frame, radians."""
TILT = math.radians(0.05)
"""Standard deviation of the change of the speed of elevation and roll, radians."""
SHIFT = 0.003
"""Standard deviation of that of place, in sides of the box, and log size."""
TILT_SPEED = math.radians(0.1)
"""Standard deviation of the speed of elevation and roll in the first frame: cameras are held still."""
PLACES = [2, 3, 4, 6, 7, 8]
"""Columns of `Trajectory.numbers` that are neither angles nor roll."""
PLACE_NOISE = (0.02, 0.3)
"""Deviations of one frame's place and log size when all is visible, and their increase when all is hidden."""
ANGLE_NOISE = (math.radians(3.0), math.radians(30.0))
"""Deviations of elevation and roll when all is visible, radians, and their increase when all is hidden."""


@dataclass(frozen=True)
class FramePose:
    """The object's pose in one frame; angles in degrees.

    Attributes:
        number: Number of the frame, from 0.
        azimuth_deg: Azimuth of the camera, in [0, 360).
        azimuth_deviation_deg: Its standard deviation.
        elevation_deg: Elevation of the camera above the object's horizon.
        elevation_deviation_deg: Its standard deviation.
        camera: Camera of the whole frame.
        hidden_fraction: Share hidden in the frame's fit; None where it shows nothing of the object.
        lost: Whether the frame does not locate the object: place and view are those of other frames.
    """

    number: int
    azimuth_deg: float
    azimuth_deviation_deg: float
    elevation_deg: float
    elevation_deviation_deg: float
    camera: Camera
    hidden_fraction: float | None
    lost: bool

    @property
    def camera_from_object(self) -> np.ndarray:
        """Return the pose (4, 4) float64, metres, as that of `Explanation`."""
        return self.camera.camera_from_world(math.radians(self.azimuth_deg), math.radians(self.elevation_deg))


@dataclass(frozen=True)
class TrackedFrame(FramePose):
    """A frame's pose by the whole video: smoothed numbers; the focal length is the same in all frames.

    Attributes:
        alone_azimuth_deg: Azimuth of the frame's own fit.
        alone_elevation_deg: Elevation of the frame's own fit.
        refitted: Whether its neighbours gave another view or place, so that it was fitted again.
    """

    alone_azimuth_deg: float
    alone_elevation_deg: float
    refitted: bool


@dataclass(frozen=True)
class Track:
    """A video's explanation of its object.

    Attributes:
        frames: Poses of all frames.
        shape: (K,) coefficients, the mean of the frames', weighted by visible share and confidence.
        albedo: (3,) linear RGB, the same mean.
    """

    frames: tuple[TrackedFrame, ...]
    shape: np.ndarray
    albedo: np.ndarray


@dataclass(frozen=True)
class Trajectory:
    """Smoothed numbers of T frames, radians and pixels.

    Attributes:
        numbers: (2, 9, T) means and deviations of azimuth, unwrapped, and elevation; x and y of the cameras'
            principal point, log of focal length over distance, roll; `Sighting.place`.
    """

    numbers: np.ndarray

    @property
    def azimuth(self) -> np.ndarray:
        """Return (2, T) means and deviations."""
        return self.numbers[:, 0]

    @property
    def elevation(self) -> np.ndarray:
        """Return (2, T) means and deviations."""
        return self.numbers[:, 1]

    @property
    def place(self) -> np.ndarray:
        """Return (T, 3) means of `Sighting.place`."""
        return self.numbers[0, 6:].T

    @staticmethod
    def of(sightings: Sequence[Sighting], path: np.ndarray, fold: int = 1) -> Trajectory:
        """Smooth sightings, whose azimuths count where they are near the chosen ones `path` (T,)."""
        lost = np.array([each.lost for each in sightings])
        hidden = np.array([1 - each.visible_share for each in sightings]) ** 2
        cameras = [each.camera for each in sightings]
        places = np.stack([each.place for each in sightings])
        side = math.exp(float(np.median(places[~lost, 2])))

        off = np.array(
            [azimuth_off(each.azimuths[0], at, fold) for each, at in zip(sightings, path, strict=True)]
        )
        spread = np.where(np.abs(off) > FAR, math.inf, [_spread(each) for each in sightings])
        if not np.isfinite(spread[~lost]).any():
            off, spread = np.zeros(len(path)), np.full(len(path), MOST_SPREAD)
        angle = ANGLE_NOISE[0] + ANGLE_NOISE[1] * hidden
        noise = PLACE_NOISE[0] + PLACE_NOISE[1] * hidden
        shifts = side * noise, side * SHIFT, math.inf
        rows = [  # values, their noise, change of their speed, and its first deviation
            (path + off, spread, TURN, math.inf),
            ([each.elevation for each in sightings], angle, TILT, TILT_SPEED),
            ([c.cx for c in cameras], *shifts),
            ([c.cy for c in cameras], *shifts),
            ([math.log(c.focal / c.distance) for c in cameras], noise, SHIFT, math.inf),
            ([c.roll for c in cameras], angle, TILT, TILT_SPEED),
            (places[:, 0], *shifts),
            (places[:, 1], *shifts),
            (places[:, 2], noise, SHIFT, math.inf),
        ]
        values, noises, change, speed = map(np.array, zip(*rows, strict=True))
        numbers = smoothed(values, np.where(lost, math.inf, noises), change, speed)
        if (gone := int(lost[::-1].argmin())) > 0:  # frames since the object was last seen
            numbers[:, PLACES, -gone:] = _slowed(numbers[:, PLACES, -gone - 1 :])
        return Trajectory(numbers)

    def contradicts(self, number: int, sighting: Sighting, fold: int) -> bool:
        """Return whether a frame sees the object from another side or elsewhere than its neighbours."""
        off = sighting.place - self.place[number]
        away = max(math.hypot(*off[:2]) / math.exp(self.place[number, 2]), abs(off[2]))
        turned = abs(azimuth_off(sighting.azimuths[0], self.azimuth[0, number], fold))
        # 0.15: sides, or log size, by which a frame is off the smoothed place
        return sighting.lost or turned > FAR or away > 0.15

    def expected(self, number: int, hints: Hints | None = None) -> tuple[Window, Hints]:
        """Return the window that a frame is expected to show the object in, and hints on its view."""
        azimuth, elevation = np.degrees(self.numbers[0, :2, number]).tolist()
        window = window_at(self.place[number], float(self.numbers[0, 5, number]))
        return window, replace(hints or Hints(), azimuth_deg=azimuth % 360, elevation_deg=elevation)


def _listed(frames: Iterable[Photo]) -> Sequence[Photo]:
    """Return frames as a sequence; UserError where there are fewer than two, or something else."""
    frames = numpy_of_tensor(frames)
    one = isinstance(frames, Photo) and not (getattr(frames, "ndim", None) == 4)
    if not one and not isinstance(frames, Iterable):
        raise UserError(f"expected the frames of a video; got {str(frames)[:60]}. Pass a list of them.")
    listed: Sequence[Any] = [frames] if one else frames if isinstance(frames, Sequence) else list(frames)
    if len(listed) < 2:
        raise UserError(
            f"expected two or more frames of a video; got {'one' if listed else 'none'}. Explain one as a"
            " photo, and pass a list of the frames of a folder or video."
        )
    return listed


@with_default_settings
def track(
    frames: Iterable[Photo],
    explainer: Explainer | str | Path | ObjectClass,
    box: Box | None = None,
    focal: float | None = None,
    hints: Hints | None = None,
    on_frame: Callable[[int, Explanation], None] | None = None,
    camera: Any = None,
) -> Track:
    """Explain the frames of a video as one object that moves and turns smoothly.

    Each frame is explained where the object is expected; things elsewhere, of another size or colour are not
    the object. Its view and the others that fit are then chosen together for all frames, frames that had
    chosen otherwise are fitted again, and angles and place are smoothed.

    Args:
        frames: Two or more of one size, in order. Those of a list are read one at a time, some of them twice;
            an iterator is exhausted first, and an array (T, H, W, 3) is T frames.
        explainer: Explainer of the object's class, or the class, as `Explainer` takes it.
        box: x, y, width, height in pixels round the whole object in the first frame; else it is sought.
        focal: Focal length in pixels of all frames; see `Explainer.explain`.
        hints: Prior knowledge in all frames.
        on_frame: Called with the number and the explanation of each frame, and of those fitted again.
        camera: Intrinsics of all frames in place of a focal length, see `Explainer.explain`; poses are then
            in the frame of this camera.

    Raises:
        UserError: There are fewer than two frames, one cannot be read or is of another size, the object is
            seen in none; see also `Explainer.explain`.
    """
    frames = _listed(frames)
    if not isinstance(explainer, Explainer):
        explainer = Explainer(explainer)
    follower = Follower(explainer, focal, hints, camera)
    alone: list[Sighting] = []
    for number, frame in enumerate(frames):
        explanation, sighting = follower.explain(frame, box if number == 0 else None)
        size, first = (
            (each.camera.width, each.camera.height) for each in (sighting, alone[0] if alone else sighting)
        )
        if size != first:
            name = f"{number}, '{frame}'" if isinstance(frame, str | Path) else str(number)
            raise UserError(
                f"expected frames of one size, {first[0]} x {first[1]}; got {size[0]} x {size[1]} in frame"
                f" {name}. Track one video at a time."
            )
        alone.append(sighting)
        if on_frame is not None:
            on_frame(number, explanation)
    _check_seen(alone, explainer, box)
    fold = max(explainer.object_class.symmetry.fold, 1)
    path = views_of(alone, fold)
    trajectory, again = Trajectory.of(alone, path, fold), list(alone)
    for number, sighting in enumerate(alone):
        if trajectory.contradicts(number, sighting, fold):
            window, frame_hints = trajectory.expected(number, hints)
            explanation = explainer.explain_followed(frames[number], window, focal, frame_hints, camera)
            again[number] = Sighting.of(explanation)
            if on_frame is not None:
                on_frame(number, explanation)
    _check_seen(again, explainer, box)
    weight = [0.0 if each.lost else each.visible_share**2 * each.probabilities[0] for each in alone]
    shape, albedo = (
        np.average([getattr(each, name) for each in alone], axis=0, weights=np.array(weight) + 1e-9)
        for name in ("shape", "albedo")
    )
    lens = alone[0].window.lens  # None but where a camera is given
    smooth, matrix = Trajectory.of(again, path, fold), None if lens is None else lens.K
    return Track(tuple(_frames(alone, again, smooth, fold, matrix)), shape, albedo)


def _check_seen(sightings: Sequence[Sighting], explainer: Explainer, box: Box | None) -> None:
    """Raise UserError where the object is lost in all frames."""
    if all(sighting.lost for sighting in sightings):
        given = "Give its box" if box is None else f"Check that the box {tuple(box)} is round it"
        raise UserError(
            f"expected a {explainer.object_class.name} in the frames; found none. {given} in the first frame."
        )


def _slowed(numbers: np.ndarray) -> np.ndarray:
    """Return slowed numbers (2, N, G) from (2, N, 1 + G): seen in the first frame and extrapolated after.

    The object may keep its speed, or stand: the way that it would move is added to the deviations.
    """
    count = np.arange(1, numbers.shape[-1])
    way = numbers[0, :, 1:] - numbers[0, :, :1]
    share = SLOWING * (1 - SLOWING**count) / (1 - SLOWING) / count
    return np.stack([numbers[0, :, :1] + share * way, np.hypot(numbers[1, :, 1:], way)])


def camera_before(
    matrix: np.ndarray, size: tuple[int, int], target_height: float, numbers: np.ndarray
) -> tuple[Camera, np.ndarray]:
    """Return the camera with intrinsics (3, 3) that took a frame, and the pose (4, 4) before it.

    size: width, height; numbers: (6,) the first of `Trajectory`, for this matrix's focal length.
    """
    focal = math.sqrt(matrix[0, 0] * matrix[1, 1])
    azimuth, elevation, cx, cy, scale, roll = numbers.tolist()
    straight = Camera(*size, focal, cx, cy, focal / math.exp(scale), target_height, roll)
    level = straight.camera_from_world(azimuth, elevation)
    pose = turned_pose(straight, level, matrix)
    mount = tuple(map(tuple, (pose @ np.linalg.inv(level)).tolist()))
    fx, fy, (cx, cy) = float(matrix[0, 0]), float(matrix[1, 1]), matrix[:2, 2].tolist()
    return replace(straight, focal=fx, focal_y=fy, cx=cx, cy=cy, mount=mount), pose


def views_of(sightings: Sequence[Sighting], fold: int = 1) -> np.ndarray:
    """Return the likeliest azimuths (T,) of all frames together, radians, unwrapped.

    fold: Number of views of the circle that look the same.
    """
    path = LikeliestPath()
    for sighting in sightings:
        path.add(view_evidence(sighting, fold))
    return path.angles() / fold


def view_evidence(sighting: Sighting, fold: int = 1) -> np.ndarray:
    """Return the log likelihood (BINS,) of a frame's views, of the circle's part in which they differ."""
    if sighting.lost:
        return np.zeros(BINS)
    centres = (np.arange(BINS) + 0.5) * (2 * math.pi / BINS)
    rest = max(0.0, 1 - float(sighting.probabilities.sum()))
    off = (fold * sighting.azimuths[:, None] - centres + math.pi) % (2 * math.pi) - math.pi
    spread = fold * _spread(sighting)
    density = np.exp(-0.5 * (off / spread) ** 2) / (spread * math.sqrt(2 * math.pi))
    uniform = 1 / (2 * math.pi)
    elsewhere: Any = uniform
    if (seen := sighting.network) is not None:
        bins = (np.arange(len(seen)) + 0.5) * (2 * math.pi / len(seen))
        elsewhere = np.interp(centres, bins, seen * len(seen) * uniform, period=2 * math.pi)
    # 0.05: probability that a view is none of a frame's, in addition to its confidence's rest
    evidence: np.ndarray = np.log(sighting.probabilities @ density + rest * elsewhere + 0.05 * uniform)
    return evidence


def _frames(
    alone: Sequence[Sighting],
    again: Sequence[Sighting],
    trajectory: Trajectory,
    fold: int,
    matrix: np.ndarray | None,
) -> list[TrackedFrame]:
    """Return a pose for each frame; matrix: K (3, 3) of the camera that took them, where it is known."""
    focal = float(np.median([each.camera.focal for each in again if not each.lost]))
    azimuth, elevation = np.degrees(trajectory.azimuth), np.degrees(trajectory.elevation)
    cx, cy, scale, roll = trajectory.numbers[0, 2:6].tolist()

    def camera_of(number: int, straight: Camera) -> Camera:
        if matrix is not None:
            size, height = (straight.width, straight.height), straight.target_height
            return camera_before(matrix, size, height, trajectory.numbers[0, :6, number])[0]
        return replace(
            straight,
            focal=focal,
            cx=cx[number],
            cy=cy[number],
            distance=focal / math.exp(scale[number]),
            roll=roll[number],
        )

    return [
        TrackedFrame(
            number=number,
            azimuth_deg=float(azimuth[0, number]) % (360 / fold),
            azimuth_deviation_deg=min(
                ALIKE[0] * float(azimuth[1, number]), math.degrees(UNIFORM_TURN) / fold
            ),
            elevation_deg=float(elevation[0, number]),
            elevation_deviation_deg=ALIKE[1] * float(elevation[1, number]),
            alone_azimuth_deg=math.degrees(first.azimuths[0]),
            alone_elevation_deg=math.degrees(first.elevation),
            camera=camera_of(number, second.camera),
            hidden_fraction=second.hidden,
            lost=first.lost or second.lost,
            refitted=second is not first,
        )
        for number, (first, second) in enumerate(zip(alone, again, strict=True))
    ]


def _spread(sighting: Sighting) -> float:
    """Return the standard deviation of a frame's azimuth about one view, radians."""
    # 2.0: A deviation of azimuth counts views from the other side, too: about one view it is so much smaller
    # math.radians(3.0): standard deviation of azimuth about one view, at least
    return min(max(sighting.azimuth_deviation / 2.0, math.radians(3.0)), MOST_SPREAD)


def azimuth_off(azimuth: float, other: float, fold: int) -> float:
    """Return azimuth - other of the two nearest views that look like these, radians."""
    circle = 2 * math.pi / fold
    return float((azimuth - other + circle / 2) % circle - circle / 2)
