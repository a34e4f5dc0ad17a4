"""A known object found in a whole photo: by keypoints, of whose poses the surface's likelihood chooses."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vig.inference.settings import Fit
from vig.io.errors import UserError
from vig.known_object.fit import KnownObject
from vig.known_object.keypoints import Keypoints, MatchedPose, Matches
from vig.known_object.picture import WEIGHTS
from vig.known_object.search import Stage
from vig.photo import ImagePyramid, Intrinsics, Window
from vig.scene.functions import sigmoid

RANKING = (Stage(1, 80, 0, (0.0, 0.0, 0.0), math.inf),)
"""Compares poses as they are: without an outline a search makes those of keypoints no better."""
ODDS = (-0.16, 1.82, 0.53)
"""Log odds that a detection is the object: constant, per log weight of its keypoints, per score. Fitted to
photos of HOPE under two of its lights."""


@dataclass(frozen=True)
class Found:
    """An object found in a photo: window, fit and ratio as of `KnownObject.explain`.

    Attributes:
        present: Probability that it is there.
        pose: (4, 4) camera_from_object, metres.
    """

    window: Window
    fit: Fit
    ratio: float
    present: float
    pose: np.ndarray


@dataclass(frozen=True, eq=False)
class WholePhoto:
    """A photo (H, W, 3), as `coded_photo` gives it, in which known objects are sought."""

    picture: np.ndarray

    @cached_property
    def pyramid(self) -> ImagePyramid:
        """Return it in several sizes."""
        return ImagePyramid(self.picture)

    @cached_property
    def keypoints(self) -> Keypoints:
        """Return its keypoints; UserError without OpenCV."""
        return Keypoints.of(self.picture)


def find(known: KnownObject, photo: WholePhoto, lens: Intrinsics, most: int) -> list[Found]:
    """Return up to `most` places of an object in a photo, the likeliest first."""
    back = np.eye(4)
    back[:3, 3] = -known.surface.middle
    found = []
    poses = Matches.of(photo.keypoints, known.keypoints, lens).poses()
    # 6: places that are judged at most; those with less weight mostly show something else
    for group in _places(poses, known.keypoints.radius)[: min(most + 1, 6)]:
        expected = np.stack([each.pose @ back for each in group[:6]])
        try:
            window, fit, ratio, pose = known.follow(photo.pyramid, expected, RANKING, lens)
        except UserError:  # it would be beside the photo
            continue
        # 0.3: share that must be seen: of HOPE's objects 3 % showed less, of other things a third
        if not fit.visible.sum() > 0.3 * fit.coverage.sum():
            continue
        score = fit.evidence / WEIGHTS.pixels
        odds = ODDS[0] + ODDS[1] * math.log(group[0].weight) + ODDS[2] * score
        found.append(Found(window, fit, ratio, float(sigmoid(np.array(odds))), pose))
    return sorted(found, key=lambda each: -each.present)[:most]


def _places(poses: list[MatchedPose], radius: float) -> list[list[MatchedPose]]:
    """Return poses of one place each, those of the likeliest first."""
    places: list[list[MatchedPose]] = []
    for each in poses:
        if each.weight < 0.5:
            continue
        for place in places:
            apart = np.linalg.norm(
                place[0].pose[:2, 3] / place[0].pose[2, 3] - each.pose[:2, 3] / each.pose[2, 3]
            )
            if apart < 0.8 * radius / each.pose[2, 3]:
                place.append(each)
                break
        else:
            places.append([each])
    return places
