"""explain(): a photo in, an explanation out. Recognition proposes, descents refine, evidence decides."""

from __future__ import annotations

from collections.abc import Iterator

import torch

from vig.inference.calibration import calibration_of
from vig.inference.fit import Fit
from vig.inference.judging import DISTINCT_AZIMUTH, judge
from vig.inference.posterior import objectives_of
from vig.inference.settings import ExplainSettings
from vig.inference.starts import starts, strewn_framing
from vig.likelihood import load_kernels
from vig.parallel.threads import map_on_threads, on_one_core
from vig.recognition import Prediction, Recognizer
from vig.scene import ObjectClass, angle_difference


def explain(
    photos: torch.Tensor,
    object_class: ObjectClass,
    recognizer: Recognizer,
    settings: ExplainSettings | None = None,
    known: torch.Tensor | None = None,
) -> Iterator[Fit]:
    """Explain photos (N, 150, 150, 3) linear RGB in their order, as many at once as torch has threads.

    known (N, 150, 150) bool: pixels that were photographed at all; others (padding) count for nothing.
    """
    chosen = settings or ExplainSettings()
    prediction = recognizer(photos)
    load_kernels(torch.float32, object_class.shape_model.modes)

    def one(index: int) -> Fit:
        here = None if known is None else known[index]
        return explain_one(photos[index], prediction[index : index + 1], object_class, chosen, here)

    yield from map_on_threads(one, range(len(photos)))


def explain_one(
    photo: torch.Tensor,
    prediction: Prediction,
    object_class: ObjectClass,
    settings: ExplainSettings,
    known: torch.Tensor | None = None,
) -> Fit:
    """Refine one photo's prediction (N = 1); see `explain`."""
    return on_one_core(lambda: _explain_one(photo, prediction, object_class, settings, known))


def _explain_one(
    photo: torch.Tensor,
    prediction: Prediction,
    object_class: ObjectClass,
    settings: ExplainSettings,
    known: torch.Tensor | None,
) -> Fit:
    scales = {stage.scale for stage in settings.stages} | {1.0}
    objectives = objectives_of(photo, prediction, object_class, settings, scales, known)
    objective = objectives[1.0]
    count = settings.stages[0].starts
    framing = strewn_framing(count) if settings.free_framing else None
    points = objective.point(starts(prediction, count), framing)
    scores = torch.zeros(len(points), dtype=torch.float64)
    evaluations = 0
    for stage in settings.stages:
        points = points[going_on(objective.latents(points).azimuth, scores, stage.starts)]
        descent = settings.optimizer(
            objectives[stage.scale],
            points,
            torch.zeros(len(points), dtype=torch.int32),
            settings.likelihood.sigma * stage.sigma,
            stage.budget,
        )
        points = descent.points
        support = prediction.log_mass(objective.latents(points).azimuth)
        scores = descent.value + settings.view_weight * stage.scale**2 * support
        evaluations += int(descent.evaluations.sum())
    # Learned of fits with outliers: without them the evidence means something else.
    calibrated = settings.calibrated and settings.likelihood.alpha < 1
    return judge(
        objective,
        points,
        descent.value,
        scores,
        prediction,
        settings,
        evaluations,
        (settings.calibration or calibration_of(object_class)) if calibrated else None,
    )


def going_on(azimuth: torch.Tensor, scores: torch.Tensor, count: int) -> torch.Tensor:
    """Indices of the `count` starts that go on: half by score alone, half the best of views not among them.

    A view is `DISTINCT_AZIMUTH` away from the others; where there are no more views, score alone decides. So
    the back of the object is not dropped before a fit at full size has compared it with the front.
    """
    order = scores.argsort(descending=True, stable=True).tolist()
    chosen = order[: (count + 1) // 2]
    for index in order:
        if (
            len(chosen) < count
            and (angle_difference(azimuth[chosen], azimuth[index]).abs() > DISTINCT_AZIMUTH).all()
        ):
            chosen.append(index)
    chosen += [index for index in order if index not in chosen][: count - len(chosen)]
    return torch.tensor(chosen)
