"""Several objects in one photo, explained together: occlusion order, one light, exclusive masks.

Each object is explained alone first. Which hides which follows from the network's probabilities of the pixels
that two silhouettes share, and by which object ends lower in the photo. Then each is fitted again, given
the others:

- pixels that an object before it covers show that object, not this one: they are no evidence of its outline;
- pixels in which objects behind or beside it are visible are not its own;
- its view is that of the fit alone; but of an object with others before it the network is asked twice, with
  the photo as it is and with the others painted out: a view that both find clearly likelier is taken;
- light, in the camera's frame, and the camera's height above the horizon are those of the others, as
    Gaussians beside the network's.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vig.explainer import Explainer
from vig.explanation import Explanation
from vig.inference import PixelLabel, WindowHints, explain_one, resolve
from vig.inference.hints import MIN_VIEW
from vig.inference.refinement import DISTINCT_AZIMUTH
from vig.photo import ImagePyramid
from vig.photo.filters import dilation, gaussian_filter
from vig.recognition import Prediction
from vig.recognition.prediction import bin_centres
from vig.scene.camera import FOCAL_OVER_WIDTH
from vig.several.scene import SceneExplanation, heading_light

GROUND_ORDER_WEIGHT = 50.0
"""Nats for the object that ends lower in the photo, per difference over the less tall one's height."""


def fit_jointly(alone: Sequence[Explanation], explainers: Sequence[Explainer]) -> SceneExplanation:
    """Return the joint explanation of one photo from explanations of each object alone."""
    if len(alone) < 2:
        return SceneExplanation(tuple(alone), np.zeros((len(alone), len(alone)), bool))
    pyramid = ImagePyramid(alone[0].picture)
    cuts = [each.window.crop(pyramid) for each in alone]
    predictions = [
        explainer.recognizer(cut[None]) for explainer, (cut, _) in zip(explainers, cuts, strict=True)
    ]
    occludes = order(alone, predictions)
    refitted = [
        _Refit(alone, occludes, index).fit_object(explainer, cut, valid, prediction)
        for index, (explainer, (cut, valid), prediction) in enumerate(
            zip(explainers, cuts, predictions, strict=True)
        )
    ]
    return SceneExplanation(tuple(exclusive(refitted, occludes)), occludes)


def order(alone: Sequence[Explanation], predictions: Sequence[Prediction]) -> np.ndarray:
    """Return whether object i is before object j (N, N) bool, of pairs whose silhouettes overlap or touch.

    By the sum, over the M pixels that both cover, of the difference of their predicted log odds of being
    visible, over the root of M; and, as things stand on one ground, by which of them ends lower
    in the photo, `GROUND_ORDER_WEIGHT` times the difference over the less tall one's height.
    """
    gains: dict[tuple[int, int], float] = {}
    count, odds = len(alone), []
    for prediction in predictions:
        # 0.02: floor of the probabilities whose odds give the order
        logs = np.log(np.maximum(prediction.mask[0], 0.02))
        odds.append(logs[..., 0] - logs[..., 1])
    touching = 0.3  # coverage from which two objects may hide one another
    for i in range(count):
        for j in range(i + 1, count):
            here, there = alone[i].window, alone[j].window
            mine, other = alone[i].fit.coverage, there.warp_to(alone[j].fit.coverage, here)
            if not ((mine > touching) & (other > touching)).any():
                continue
            both = (mine > 0.5) & (other > 0.5)
            gain = float((odds[i] - there.warp_to(odds[j], here))[both].sum()) / math.sqrt(max(1, both.sum()))
            gains[i, j] = gain
            if (one := alone[i].box) is not None and (two := alone[j].box) is not None:
                lower = (one[1] + one[3] - two[1] - two[3]) / min(one[3], two[3])
                gains[i, j] += GROUND_ORDER_WEIGHT * lower
    return _without_cycles(gains, count)


def _without_cycles(gains: Mapping[tuple[int, int], float], count: int) -> np.ndarray:
    """Return whether i is before j (N, N) bool, from gains above 0 where i is; the surest pairs decide
    first.
    """
    direct, behind = np.zeros((2, count, count), bool)  # directly, and by way of others
    for (i, j), gain in sorted(gains.items(), key=lambda item: -abs(item[1])):
        first, second = (i, j) if gain > 0 else (j, i)
        if behind[second, first]:
            first, second = second, first
        direct[first, second] = True
        front, rear = (
            behind[:, first] | (np.arange(count) == first),
            behind[second] | (np.arange(count) == second),
        )
        behind |= front[:, None] & rear
    return direct


def _focal_of(alone: Sequence[Explanation]) -> float:
    """Return the focal length in pixels of the photo, the vertical one of a lens."""
    if (lens := alone[0].window.lens) is not None:
        return lens.fy
    standard = [FOCAL_OVER_WIDTH * each.window.side for each in alone]
    if alone[0].focal_from == "assumed":
        # 2.0: focal length of a photo of several things that does not state its own, over those of the
        # windows' standard cameras: each thing is smaller in it than in a photo of its own
        return 2.0 * float(np.mean(standard))
    return float(
        np.mean([each.camera_distance_ratio * own for each, own in zip(alone, standard, strict=True)])
    )


@dataclass(frozen=True)
class _Refit:
    """One object's fit that knows of the others."""

    alone: Sequence[Explanation]
    occludes: np.ndarray
    index: int

    def fit_object(
        self, explainer: Explainer, cut: np.ndarray, valid: np.ndarray, prediction: Prediction
    ) -> Explanation:
        alone = self.alone[self.index]
        infront, elsewhere = self._others()
        view = alone.latents.azimuth[0]
        if infront.any():
            rival = explainer.recognizer(_without(cut, infront, elsewhere)[None])
            prediction = _combine_predictions(prediction, rival)
            asked = np.stack([prediction.best().azimuth[0], view])
            likeliest, own = prediction.log_mass(asked).tolist()
            # 1.0: nats by which another view must be likelier than that of the fit alone
            view = asked[0] if likeliest - own > 1.0 else view
        window = alone.window
        distance_ratio = window.camera_distance_ratio(window.focal or _focal_of(self.alone))
        settings = replace(
            resolve(explainer.settings, explainer.object_class, photo=True),
            camera_distance_ratio=distance_ratio,
        )
        prediction = self._level(self._share_light(prediction, settings.appearance_weight))
        labels = np.zeros(cut.shape[:2], np.uint8)
        labels[elsewhere] = PixelLabel.BACKGROUND
        labels[infront] = PixelLabel.IN_FRONT
        hints = WindowHints(
            labels, False, np.zeros(0, np.int64), np.zeros((0, 2), np.float32), None, None, {}
        )
        turned = _of_view(prediction, view)
        fit = explain_one(cut, turned, alone.object_class, settings, valid, hints, prediction)
        return replace(alone, fit=fit, camera_distance_ratio=distance_ratio)

    def _others(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the window's pixels (S, S) bool that objects before this one cover; those of visible
        others.
        """
        here = self.alone[self.index].window
        covered = self.alone[self.index].fit.coverage > 0.5
        # 4: pixels of a window within which an object's outline may be wrong: its pixels are left undecided
        # there
        own = dilation(covered, 4)
        infront, elsewhere = np.zeros(own.shape, bool), np.zeros(own.shape, bool)
        for index, other in enumerate(self.alone):
            if index == self.index:
                continue
            if self.occludes[index, self.index]:
                infront |= other.window.warp_to(other.fit.coverage, here) > 0.5
            else:
                elsewhere |= other.window.warp_to(other.fit.visible, here) > 0.5
        return infront, elsewhere & ~own & ~infront

    def _level(self, prediction: Prediction) -> Prediction:
        """Return the prediction with the others' elevation as a second Gaussian: all stand
        upright.
        """
        focal = _focal_of(self.alone)
        lens = self.alone[0].window.lens
        middle = self.alone[0].picture.shape[0] / 2 if lens is None else lens.cy
        below = [math.atan((each.window.centre[1] - middle) / focal) for each in self.alone]
        elevations = [
            float(each.latents.elevation[0]) + below[self.index] - below[index]
            for index, each in enumerate(self.alone)
            if index != self.index
        ]
        # math.radians(5.0): standard deviation of an elevation that follows from another object
        precision = len(elevations) / math.radians(5.0) ** 2
        return _with_gaussian(prediction, "elevation", np.mean(elevations), precision)

    def _share_light(self, prediction: Prediction, power: float) -> Prediction:
        """Return the prediction with the other objects' light as a second Gaussian; `power` is the first
        one's.
        """
        others = [heading_light(each) for index, each in enumerate(self.alone) if index != self.index]
        # 2.0: precision of each other object's light, per coefficient: things near a lamp are lit by it more
        return _with_gaussian(prediction, "light", np.mean(others, axis=0), 2.0 * len(others), power)


def _with_gaussian(
    prediction: Prediction, block: str, mean: Any, precision: float, power: float = 1.0
) -> Prediction:
    """Return a prediction times a second Gaussian of a block; `power` is that of the first one."""
    place = prediction.layout[block]
    numbers, deviation = prediction.numbers.copy(), prediction.deviation.copy()
    own = power / deviation[:, place] ** 2
    numbers[:, place] = (own * numbers[:, place] + precision * mean) / (own + precision)
    deviation[:, place] = np.sqrt(power / (own + precision))
    return replace(prediction, numbers=numbers, deviation=deviation)


def _combine_predictions(one: Prediction, other: Prediction) -> Prediction:
    """Combine two predictions of one photo: geometric mean of azimuth, mean of all else."""
    azimuth = np.sqrt(np.maximum(one.azimuth, 1e-6) * np.maximum(other.azimuth, 1e-6))
    return replace(
        one,
        azimuth=azimuth / azimuth.sum(1, keepdims=True),
        numbers=(one.numbers + other.numbers) / 2,
        deviation=(one.deviation + other.deviation) / 2,
        mask=(one.mask + other.mask) / 2,
    )


def _of_view(prediction: Prediction, azimuth: np.floating[Any]) -> Prediction:
    """Return the prediction with one view only: the independent fit has compared it with the others."""
    fold, bins = prediction.symmetry.fold, prediction.azimuth.shape[1]
    if not fold:
        return prediction
    off = prediction.symmetry.difference(bin_centres(bins, fold), azimuth)
    near = np.where(np.abs(off) <= DISTINCT_AZIMUTH, prediction.azimuth + MIN_VIEW, np.float32(0))
    return replace(prediction, azimuth=near / near.sum(1, keepdims=True))


def _without(cut: np.ndarray, infront: np.ndarray, elsewhere: np.ndarray) -> np.ndarray:
    """Return a window (S, S, 3) without other objects: grey where one is before this, else the colours round
    them.
    """
    painted, holes = cut.copy(), dilation(elsewhere, 2)
    filled = ~holes
    for width in (2, 4, 8, 16, 32, 64):
        if filled.all():
            break
        weight = gaussian_filter((~holes).astype(np.float32), width, "symmetric")
        colours = gaussian_filter(np.where(holes[..., None], 0, cut), width, "symmetric")
        colour_known = ~filled & (weight > 0.05)
        painted[colour_known] = colours[colour_known] / weight[colour_known, None]
        filled |= colour_known
    # 0.18: linear grey of things before an object when the network is asked without them
    painted[infront] = 0.18
    return painted


def exclusive(explanations: Sequence[Explanation], occludes: np.ndarray) -> list[Explanation]:
    """Return explanations with masks that exclude each other: a pixel of two is that of the one before."""
    masks = [each.mask for each in explanations]
    result = []
    for index, each in enumerate(explanations):
        others = np.zeros(masks[0].shape, bool)
        for other, mask in enumerate(masks):
            if other != index and (occludes[other, index] or (other < index and not occludes[index, other])):
                others |= mask
        result.append(replace(each, others=others))
    return result
