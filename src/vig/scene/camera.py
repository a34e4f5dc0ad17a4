"""A pinhole camera on a sphere round the object's axis."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vig.scene.latents import Latents
from vig_renderer.arrays import Array, like, namespace


def angle_difference(a: Array, b: Array) -> Array:
    """Return a - b round the circle, in [-pi, pi) radians; arrays that broadcast."""
    return (a - b + math.pi) % (2 * math.pi) - math.pi


FOCAL_OVER_WIDTH = 1.12  # focal length over the image's width of the paper's camera
DISTANCE = 0.4  # metres of the paper's camera, which suits things of a teapot's size
IMAGE_SIZE = 150  # pixels a side of the images that are fitted, as in the paper
MAX_SIDE = 16_384  # a side of an image


@dataclass(frozen=True)
class Camera:
    """Intrinsics in pixels and the sphere on which the camera moves, in metres.

    The camera is `distance` from the point (0, 0, target_height) and looks at it; the image's up is the
    world's, turned clockwise by `roll` radians. OpenCV axes (x right, y down, z forward); pixel centres at
    half-integers.

    A lens whose pixels are oblong has another vertical focal length, `focal_y`. A camera that does not look
    at that point has a `mount`: the rigid motion (4, 4), rows of it, from the axes of the one that does.
    """

    width: int
    height: int
    focal: float
    cx: float
    cy: float
    distance: float = DISTANCE
    target_height: float = 0.0
    roll: float = 0.0
    focal_y: float | None = None
    mount: tuple[tuple[float, ...], ...] | None = None

    def __post_init__(self) -> None:
        for side in (self.width, self.height):
            if not _real(side) or side != int(side) or not 1 <= side <= MAX_SIDE:
                raise ValueError(
                    f"a camera's image must have 1 to {MAX_SIDE} whole pixels a side;"
                    f" got {self.width} x {self.height}. Give the photo's size."
                )
        vertical = self.focal if self.focal_y is None else self.focal_y
        if not all(_real(number) and number > 0 for number in (self.focal, vertical, self.distance)):
            raise ValueError(
                f"focal (pixels) and distance (metres) must be positive and finite;"
                f" got {self.focal} and {self.distance}. Give both in these units."
            )
        if not all(map(_real, (self.cx, self.cy, self.target_height, self.roll))):
            raise ValueError(
                f"cx, cy (pixels), target_height (metres) and roll (radians) must be finite numbers; got"
                f" {self.cx}, {self.cy}, {self.target_height} and {self.roll}. Give all in these units."
            )

    @staticmethod
    def standard(
        size: int = IMAGE_SIZE,
        target_height: float = 0.0,
        camera_distance_ratio: float = 1.0,
        distance: float = DISTANCE,
    ) -> "Camera":
        """Return the paper's camera for a square image of `size` pixels: f = 1.12 x width, at 0.4 m or
        another distance; or both `camera_distance_ratio` times as much, the same with less perspective.
        """
        focal, middle = camera_distance_ratio * FOCAL_OVER_WIDTH * size, size / 2
        return Camera(size, size, focal, middle, middle, camera_distance_ratio * distance, target_height)

    def scale(self, factor: float) -> "Camera":
        """Return the same camera for an image `factor` times as wide and high."""
        return replace(
            self,
            width=round(self.width * factor),
            height=round(self.height * factor),
            focal=self.focal * factor,
            cx=self.cx * factor,
            cy=self.cy * factor,
            focal_y=self.focal_y and self.focal_y * factor,
        )

    def apply_framing(self, shift_x: float, shift_y: float, log_scale: float, roll: float = 0.0) -> "Camera":
        """Return this camera with its image shifted (in widths, right and down), and magnified and turned
        about its principal point (clockwise, radians).
        """
        return replace(
            self,
            focal=self.focal * math.exp(log_scale),
            cx=self.cx + shift_x * self.width,
            cy=self.cy + shift_y * self.width,
            roll=self.roll + roll,
        )

    @property
    def K(self) -> np.ndarray:  # noqa: N802
        """Return intrinsic matrix (3, 3) in pixels: K @ a camera-frame point is z times (column, row, 1)."""
        vertical = self.focal_y or self.focal
        return np.array([[self.focal, 0.0, self.cx], [0.0, vertical, self.cy], [0.0, 0.0, 1.0]])

    def camera_from_world(self, azimuth: float, elevation: float) -> np.ndarray:
        """Return the pose (4, 4) at an azimuth and elevation in radians, metres; float64."""
        sa, ca, se, ce = math.sin(azimuth), math.cos(azimuth), math.sin(elevation), math.cos(elevation)
        pose, (sin, cos) = np.eye(4), (math.sin(self.roll), math.cos(self.roll))
        pose[:3, :3] = [[ca, sa, 0.0], [se * sa, -se * ca, -ce], [-ce * sa, ce * ca, -se]]  # camera_rotation
        pose[:2, :3] = [[cos, -sin], [sin, cos]] @ pose[:2, :3]
        pose[:3, 3] = -self.target_height * pose[:3, 2]
        pose[2, 3] += self.distance
        return pose if self.mount is None else np.array(self.mount) @ pose

    def camera_from_object(self, latents: Latents) -> np.ndarray:
        """Return the pose (4, 4) of one set of latents (B = 1), metres; float64."""
        return self.camera_from_world(float(latents.azimuth[0]), float(latents.elevation[0]))

    def pose(self, azimuth: Array, elevation: Array) -> tuple[Array, Array]:
        """Return camera_from_world rotation (B, 3, 3) and translation (B, 3), metres.

        azimuth, elevation: (B,) radians. Azimuth 0 puts the camera on -Y, counter-clockwise about +Z.
        """
        rotation = camera_rotation(azimuth, elevation)
        if self.roll:
            cos, sin = math.cos(self.roll), math.sin(self.roll)
            turn = like(rotation, [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
            rotation = turn @ rotation
        translation = -(rotation[..., 2] * self.target_height)
        translation[..., 2] += self.distance
        if self.mount is not None:
            mount = like(rotation, self.mount)
            rotation, translation = mount[:3, :3] @ rotation, translation @ mount[:3, :3].T + mount[:3, 3]
        return rotation, translation


def view_of(pose: np.ndarray) -> tuple[Any, Any, Any]:
    """Return the azimuth, elevation and roll, radians, of poses camera_from_object (4, 4, ...), or rotations
    (3, 3, ...): each (...).
    """
    forward, up = pose[2, :3], pose[:3, 2]  # the optical axis in the object's frame; its Z in the camera's
    elevation = np.arcsin(np.clip(-forward[2], -1, 1))
    return np.arctan2(-forward[0], forward[1]), elevation, np.arctan2(up[0], -up[1])


def _real(number: object) -> bool:
    return isinstance(number, int | float | np.number) and math.isfinite(number)


def camera_rotation(azimuth: Array, elevation: Array) -> Array:
    """Return camera_from_world of a camera that looks at the vertical axis: (...) radians to (..., 3, 3)."""
    functions = namespace(azimuth)
    sin, cos, stack = functions.sin, functions.cos, functions.stack
    sa, ca, se, ce = sin(azimuth), cos(azimuth), sin(elevation), cos(elevation)
    right = stack([ca, sa, functions.zeros_like(sa)], axis=-1)
    down = stack([se * sa, -se * ca, -ce], axis=-1)
    forward = stack([-ce * sa, ce * ca, -se], axis=-1)
    return stack([right, down, forward], axis=-2)
