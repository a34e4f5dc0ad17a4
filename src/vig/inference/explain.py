"""explain(): a photo in, an explanation out. Recognition proposes, descents refine, evidence decides."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import torch

from vig.inference.explanation import Explanation
from vig.inference.judging import judge
from vig.inference.levenberg_marquardt import LevenbergMarquardt
from vig.inference.optimizer import Optimizer
from vig.inference.posterior import objective_of
from vig.inference.settings import ExplainSettings
from vig.inference.starts import starts
from vig.recognition import Prediction, Recognizer
from vig.scene import ObjectClass


def explain(
    photos: torch.Tensor,
    object_class: ObjectClass,
    recognizer: Recognizer,
    settings: ExplainSettings | None = None,
    known: torch.Tensor | None = None,
) -> Iterator[Explanation]:
    """Explain photos (N, 150, 150, 3) linear RGB, one after the other.

    known (N, 150, 150) bool: pixels that were photographed at all; others (padding) count for nothing.
    """
    settings = settings or ExplainSettings()
    prediction = recognizer(photos)
    for index in range(len(photos)):
        here = None if known is None else known[index]
        yield explain_one(photos[index], prediction[index : index + 1], object_class, settings, here)


def explain_one(
    photo: torch.Tensor,
    prediction: Prediction,
    object_class: ObjectClass,
    settings: ExplainSettings,
    known: torch.Tensor | None = None,
) -> Explanation:
    """Refine one photo's prediction (N = 1); see `explain`."""
    objectives = {
        scale: objective_of(photo, prediction, object_class, settings, known, scale)
        for scale in {stage.scale for stage in settings.stages} | {1.0}
    }
    objective = objectives[1.0]
    points = objective.point(starts(prediction, settings.stages[0].starts))
    values = torch.zeros(len(points), dtype=torch.float64)
    evaluations = 0
    for stage in settings.stages:
        points = points[values.topk(min(stage.starts, len(values))).indices]
        descent = _with_budget(settings.optimizer, stage.iterations)(
            objectives[stage.scale],
            points,
            torch.zeros(len(points), dtype=torch.int32),
            settings.likelihood.sigma * stage.sigma,
        )
        points, values = descent.points, descent.value
        evaluations += int(descent.evaluations.sum())
    guess = objective.point(prediction.best())
    return judge(objective, points, values, guess, settings, evaluations)


def _with_budget(optimizer: Optimizer, iterations: int) -> Optimizer:
    if isinstance(optimizer, LevenbergMarquardt):
        return replace(optimizer, iterations=iterations)
    return optimizer
