"""How far a pose of a known object can be trusted, and how far its print explains a photo."""

import math
from collections.abc import Sequence

import numpy as np

from vig.inference.settings import Fit, Verdict
from vig.known_object.picture import MIN_COLOUR, Picture
from vig.known_object.search import Poses
from vig.known_object.surface import Surface
from vig.scene.functions import sigmoid

DISTINCT = math.radians(25.0)  # angle from which poses are different
ODDS, BOX_ODDS = (-1.75, 0.19, 0.66, 1.05), (-3.33, 0.04, -0.01, 1.28)
"""Log odds that a pose is right, its points a tenth of the diameter off at most: constant, per score, per
lead over every other pose, per log of 1 + keypoints; with a mask, and without. Fitted to photos of HOPE under
two of its lights."""
TRUSTED = 0.91  # probability from which a pose with a mask is trusted: .53 of these were, .95 of them right


def judge(
    scores: np.ndarray, rivals: Sequence[int], keypoints: int | None, outlined: bool, one_colour: bool
) -> tuple[Verdict, str, float]:
    """Return the verdict on the first of some poses, why, and the probability that it is right, see `ODDS`;
    NaN where its keypoints were not counted. `scores` (N,) are of all; `rivals` as of `rivals_of`.
    """
    if one_colour:
        return Verdict.AMBIGUOUS, "a mesh of one colour tells too little to trust a pose", math.nan
    if len(scores) == 1:
        return Verdict.AMBIGUOUS, "only the pose that was given, or that its print told, was tried", math.nan
    if keypoints is None:
        return Verdict.AMBIGUOUS, 'its print was not compared: pip install "vig[match]"', math.nan
    # A lead of 4 counts at most, and is that of a pose without a rival.
    lead = min(float(scores[0] - scores[rivals[0]]) if rivals else math.inf, 4.0)
    known = np.array([1.0, scores[0], lead, math.log1p(keypoints)])
    right = float(sigmoid(known @ (ODDS if outlined else BOX_ODDS)))
    if not outlined:
        return Verdict.AMBIGUOUS, "without a mask no pose of a known object is trusted", right
    if right >= TRUSTED:
        return Verdict.TRUSTED, "the surface explains the photo, and no other pose does as well", right
    reason = "another pose explains the photo about as well"
    if lead >= 0.5:
        reason = "much of the photo at this place is not explained by the surface"
    return Verdict.AMBIGUOUS, reason, right


def rivals_of(poses: Poses, surface: Surface) -> list[int]:
    """Return numbers of poses that differ from the first and look different, too, the likeliest first."""
    turns = poses.rotations[0].T @ poses.rotations
    apart = np.flatnonzero((np.trace(turns, axis1=1, axis2=2) - 1) / 2 < math.cos(DISTINCT))
    differing = [number for number in apart.tolist() if not surface.looks_same(turns[number])]
    return sorted(differing, key=lambda number: -poses.scores[number])


def print_explained(picture: Picture, coverage: np.ndarray, colour: np.ndarray, inlier: np.ndarray) -> float:
    """Return the share of the covered pixels that have the surface's colours, times the correlation of these
    pixels' log colours with the surface's, at least 0: one colour over all explains none of its print.
    """
    covered = coverage >= 0.5
    alike = covered & (inlier > 0.5)
    if alike.sum() < 10:
        return 0.0
    photo, texture = (
        np.log(each[alike].astype(np.float64).clip(0, None) + MIN_COLOUR).mean(1)
        for each in (picture.colour * picture.exposure, colour)
    )
    photo, texture = photo - photo.mean(), texture - texture.mean()
    correlation = (photo * texture).sum() / math.sqrt((photo**2).sum() * (texture**2).sum() + 1e-6)
    return float(alike.sum() / covered.sum() * max(0.0, correlation))


def explained_share(fit: Fit) -> float:
    """Return `print_explained` of a fit of a known object, whose only confidence feature it is."""
    return float(fit.confidence_features[0])
