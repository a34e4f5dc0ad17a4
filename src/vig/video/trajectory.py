"""Poses of frames, smoothed: azimuths that are likeliest together, angles and places that change smoothly."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vig.hints import Hints
from vig.photo import Window
from vig.photo.pinhole import turned_pose
from vig.scene import Camera
from vig.video.following import SLOWING, Sighting, window_at
from vig.video.smoothing import BINS, LikeliestPath, smooth

MAX_SPREAD = math.radians(12.0)  # standard deviation of azimuth about one view, at most
FAR = math.radians(25.0)  # a frame whose own view is farther from the chosen one is fitted again near that
TURN = math.radians(0.7)
"""Standard deviation of the change of the speed of azimuth from frame to frame, radians."""
TILT = math.radians(0.05)
"""Standard deviation of the change of the speed of elevation and roll, radians."""
SHIFT = 0.003  # standard deviation of that of place, in sides of the box, and log size
TILT_SPEED = math.radians(0.1)
"""Standard deviation of the speed of elevation and roll in the first frame: cameras are held still."""
PLACES = [2, 3, 4, 6, 7, 8]  # columns of `Trajectory.numbers` that are neither angles nor roll
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
    def of(sightings: Sequence[Sighting], path: np.ndarray, fold: int = 1) -> "Trajectory":
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
            off, spread = np.zeros(len(path)), np.full(len(path), MAX_SPREAD)
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
        numbers = smooth(values, np.where(lost, math.inf, noises), change, speed)
        if (gone := int(lost[::-1].argmin())) > 0:  # frames since the object was last seen
            numbers[:, PLACES, -gone:] = _slow_down(numbers[:, PLACES, -gone - 1 :])
        return Trajectory(numbers)

    def contradicts(self, number: int, sighting: Sighting, fold: int) -> bool:
        """Return whether a frame sees the object from another side or elsewhere than its neighbours."""
        off = sighting.place - self.place[number]
        away = max(math.hypot(*off[:2]) / math.exp(self.place[number, 2]), abs(off[2]))
        turned = abs(azimuth_off(sighting.azimuths[0], self.azimuth[0, number], fold))
        # 0.15: sides, or log size, by which a frame is off the smoothed place
        return sighting.lost or turned > FAR or away > 0.15

    def expected_window(self, number: int, hints: Hints | None = None) -> tuple[Window, Hints]:
        """Return the window that a frame is expected to show the object in, and hints on its view."""
        azimuth, elevation = np.degrees(self.numbers[0, :2, number]).tolist()
        window = window_at(self.place[number], float(self.numbers[0, 5, number]))
        return window, replace(hints or Hints(), azimuth_deg=azimuth % 360, elevation_deg=elevation)


def _slow_down(numbers: np.ndarray) -> np.ndarray:
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


def _spread(sighting: Sighting) -> float:
    """Return the standard deviation of a frame's azimuth about one view, radians."""
    # 2.0: A deviation of azimuth counts views from the other side, too: about one view it is so much smaller
    # math.radians(3.0): standard deviation of azimuth about one view, at least
    return min(max(sighting.azimuth_deviation / 2.0, math.radians(3.0)), MAX_SPREAD)


def azimuth_off(azimuth: float, other: float, fold: int) -> float:
    """Return azimuth - other of the two nearest views that look like these, radians."""
    circle = 2 * math.pi / fold
    return float((azimuth - other + circle / 2) % circle - circle / 2)
