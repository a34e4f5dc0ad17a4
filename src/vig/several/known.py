"""Several known objects in one photo: found, or at boxes; nearer ones hide those behind."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vig.explainer import Box, Explainer, Lens
from vig.explanation import Explanation
from vig.hints import Hints
from vig.inference.hints import PixelLabel
from vig.inference.presence import MIN_PRESENT
from vig.known_object import WholePhoto
from vig.several.joint import exclusive
from vig.several.scene import SceneExplanation


def find_known_together(
    photo: np.ndarray, explainers: Sequence[Explainer], most: int, lens: Lens | None
) -> SceneExplanation | None:
    """Return the explanation of known objects that are found in a photo, as `coded_photo` gives it, the
    likeliest first; None where none is. Of two at one place the likelier is taken.
    """
    whole = WholePhoto(photo)
    seen = [each for one in explainers for each in one.find_and_explain(whole, lens, most)]
    chosen: list[Explanation] = []
    for each in sorted(seen, key=lambda each: -each.present):
        if each.present < MIN_PRESENT or len(chosen) == most:
            break
        if all(_overlap(each.amodal, other.amodal) < 0.5 for other in chosen):
            chosen.append(each)
    return in_depth(chosen, lambda index, hidden: chosen[index]) if chosen else None


def fit_known_jointly(
    alone: Sequence[Explanation], explainers: Sequence[Explainer], boxes: Sequence[Box]
) -> SceneExplanation:
    """Return the joint explanation of known objects from explanations of each at its box alone."""

    def again(index: int, hidden: np.ndarray) -> Explanation:
        one = alone[index]
        marks = np.zeros(hidden.shape, np.uint8)
        marks[hidden] = PixelLabel.IN_FRONT
        told = replace(one.hints or Hints(), marks=marks)
        explained = explainers[index].explain(one.picture, boxes[index], hints=told, K=one.window.lens)
        return replace(explained, focal_from=one.focal_from, hints=one.hints)

    return in_depth(alone, again)


def in_depth(
    alone: Sequence[Explanation], again: Callable[[int, np.ndarray], Explanation]
) -> SceneExplanation:
    """Return the joint explanation of objects of which the nearer hides the other where both lie.

    again: Function that explains one of them once more, given the pixels (H, W) that nearer ones cover.
    """
    away = [float(np.linalg.norm(each.camera_from_object[:3, 3])) for each in alone]
    before = np.zeros((len(alone), len(alone)), bool)
    for one in range(len(alone)):
        for other in range(len(alone)):
            if away[one] < away[other]:
                before[one, other] = (alone[one].amodal & alone[other].amodal).any()
    objects = list(alone)
    for index in np.nonzero(before.any(0))[0].tolist():
        nearer = np.nonzero(before[:, index])[0].tolist()
        objects[index] = again(index, np.any([alone[each].amodal for each in nearer], axis=0))
    return SceneExplanation(tuple(exclusive(objects, before)), before)


def _overlap(one: np.ndarray, other: np.ndarray) -> float:
    """Return the intersection over union of two masks."""
    return float((one & other).sum() / max(1, (one | other).sum()))
