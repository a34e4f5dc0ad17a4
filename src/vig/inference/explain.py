"""Fits of photos: starts, refinement, selection, confidence."""

from collections.abc import Iterator

import numpy as np

from vig.inference.confidence import make_fit
from vig.inference.hints import WindowHints
from vig.inference.posterior import objectives_of
from vig.inference.refinement import ExpectedStart, refine, select
from vig.inference.settings import ExplainSettings, Fit, resolve
from vig.inference.shading_gain import with_shading_gain
from vig.parallel.threads import map_on_threads, on_one_core
from vig.recognition import Prediction, Recognizer
from vig.scene import ObjectClass


def explain(
    photos: np.ndarray,
    object_class: ObjectClass,
    recognizer: Recognizer,
    settings: ExplainSettings | None = None,
    valid: np.ndarray | None = None,
    hints: WindowHints | None = None,
    expected: ExpectedStart | None = None,
) -> Iterator[Fit]:
    """Explain photos (N, 150, 150, 3), linear RGB, in their order, as many at once as there are threads.

    Pixels outside `valid` (N, 150, 150) bool are padding and do not count; hints are of all photos. A start
    that is `expected` is of one photo.
    """
    chosen = resolve(settings or ExplainSettings(), object_class)
    prediction = recognizer(photos) if expected is None else expected.predict(photos)

    def one(index: int) -> Fit:
        here = None if valid is None else valid[index]
        of_one = photos[index], prediction[index : index + 1]
        return explain_one(*of_one, object_class, chosen, here, hints, expected=expected)

    yield from map_on_threads(one, range(len(photos)))


def explain_one(
    photo: np.ndarray,
    prediction: Prediction,
    object_class: ObjectClass,
    settings: ExplainSettings,
    valid: np.ndarray | None = None,
    hints: WindowHints | None = None,
    confidence_prediction: Prediction | None = None,
    expected: ExpectedStart | None = None,
) -> Fit:
    """Fit one photo (150, 150, 3) from its prediction (N = 1); see `explain`.

    confidence_prediction: Prediction that confidence is computed from, if not `prediction`, in which views
        were ruled out.
    """
    chosen = resolve(settings, object_class)
    if hints is not None:
        unit = object_class.at_unit_scale
        prediction = hints.correct_prediction(
            prediction, unit, unit.camera(photo.shape[1], chosen.camera_distance_ratio)
        )

    def fit() -> Fit:
        scales = {stage.scale for stage in chosen.stages} | {1.0}
        coarse = prediction.round_for_search()  # so that searches are the same on every processor
        objectives = objectives_of(photo, coarse, object_class, chosen, scales, valid, hints)
        ends = refine(objectives, coarse, chosen, expected)
        objective = objectives[1.0]
        selection = select(objective, ends, coarse.best(), chosen.likelihood.sigma, chosen.informed)
        if chosen.gain_deviation and chosen.likelihood.alpha < 1 and not selection.reverted:
            objective, selection = with_shading_gain(objective, selection, chosen)
        calibration = chosen.calibration_for(object_class)
        return make_fit(objective, selection, prediction, chosen, calibration, confidence_prediction, hints)

    return on_one_core(fit)
