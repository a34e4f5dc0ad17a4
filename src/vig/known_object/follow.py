"""A known object from frame to frame: each pose by a search near where the frames before foretell it."""

from dataclasses import dataclass, field

import numpy as np

from vig.inference.settings import Fit
from vig.io.errors import UserError
from vig.known_object.fit import KnownObject
from vig.known_object.search import Stage
from vig.known_object.verdict import explained_share
from vig.photo import ImagePyramid, Intrinsics, Window

STEPS = (Stage(1, 32, 60, (0.05, 0.008, 0.02), 0.0), Stage(1, 48, 80, (-0.03, -0.003, -0.01), 0.0))
"""From frame to frame; the last pose and the foretold one begin it."""
SEEKING = (
    Stage(8, 24, 60, (0.1, 0.015, 0.03), np.inf),
    Stage(3, 32, 60, (-0.05, -0.008, -0.02), np.inf),
    STEPS[1],
)
"""Where the object was lost, from views about the last pose."""
LOST, FOUND = 0.45, 0.6
"""Shares of `PoseFollower.usual` below which the object is lost, and above which it is found again. In a
generated video true poses had .8 of it with a third hidden, wrong ones .4."""


@dataclass
class PoseFollower:
    """Follower of one known object.

    Attributes:
        known: The object.
        lens: Intrinsics of the camera.
        pose: (4, 4) camera_from_object in the last frame that showed it, metres.
        speed: (4, 4) by which a pose is multiplied from the left, from frame to frame.
        usual: How far its print explains frames that show it, see `explained_share`.
        missed: Frames since the last that did.
    """

    known: KnownObject
    lens: Intrinsics
    pose: np.ndarray
    usual: float
    speed: np.ndarray = field(default_factory=lambda: np.eye(4))
    missed: int = 0

    def step(self, pyramid: ImagePyramid) -> tuple[Window, Fit, float] | None:
        """Return window, fit and ratio of the next frame, as `KnownObject.explain`; None where the
        expected pose lies outside the camera's view.
        """
        lost = self.missed > 0
        expected = np.stack([self.speed @ self.pose, self.pose])[: 1 if lost else 2]
        stages = SEEKING if lost else STEPS
        try:
            window, fit, ratio, pose = self.known.follow(pyramid, expected, stages, self.lens, seek=lost)
        except UserError:
            self.missed, self.speed = self.missed + 1, np.eye(4)
            return None
        explained, usual = explained_share(fit), self.usual
        if explained < (FOUND if lost else LOST) * usual:
            self.missed, self.speed = self.missed + 1, np.eye(4)
        else:
            self.speed = np.eye(4) if lost else _slow_down(pose @ np.linalg.inv(self.pose))
            self.pose, self.missed, self.usual = pose, 0, 0.9 * usual + 0.1 * max(explained, usual / 2)
        return window, fit, ratio


def _slow_down(motion: np.ndarray) -> np.ndarray:
    """Return about 0.8 of a small motion (4, 4)."""
    slowed = np.eye(4) + 0.8 * (motion - np.eye(4))
    u, _, v = np.linalg.svd(slowed[:3, :3])
    slowed[:3, :3] = u @ v
    return slowed
