"""Deviations of positions learned on photos whose true poses are known."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from vig.explainer import Explainer
from vig.explanation import Explanation
from vig.inference import ExplainSettings, FitCalibration, Verdict
from vig.inference.calibration import WITHIN_90
from vig.likelihood import SPATIAL
from vig.photo.pinhole import sight_axes
from vig.recognition import Recognizer
from vig.scene import ObjectClass
from vig_train.calibration.learning import MIN_GROUP
from vig_train.calibration.samples import StudioPhotos
from vig_train.evaluation.fits import box_of_silhouette
from vig_world.dataset import Dataset
from vig_world.raster.view import View

POSITION_PHOTOS = 300  # photos of a dataset on which positions are calibrated, at most


def calibrate_positions(
    calibration: FitCalibration,
    datasets: Sequence[Dataset | StudioPhotos],
    object_class: ObjectClass,
    recognizer: Recognizer,
    advance: Callable[[int], None] = lambda done: None,
) -> FitCalibration:
    """Return the calibration with `position` learned on photographs whose cameras are known, boxes given.

    Args:
        calibration: Decides which fits are trusted.
        datasets: Those of other worlds than the paper's are used, `POSITION_PHOTOS` of each at most; without
            one the calibration stays as it is.
        object_class: Class that they show.
        recognizer: Its network, calibrated.
        advance: Called with 1 for each photo.
    """
    photographs = [each for each in datasets if isinstance(each, Dataset) and each.world != "paper"]
    if not photographs:
        return calibration
    settings = ExplainSettings(replace(SPATIAL, density=calibration.density), calibration=calibration)
    explainer = Explainer(object_class, settings, recognizer=recognizer)
    explained = [
        posed
        for dataset in photographs
        for posed in _explained_photos(dataset.first(POSITION_PHOTOS), object_class, explainer, advance)
    ]
    if len(explained) < MIN_GROUP:
        return calibration
    errors, stated = np.array([position_error(*posed) for posed in explained]).transpose(1, 0, 2)
    trusted = np.array([explanation.verdict is Verdict.TRUSTED for explanation, _ in explained])
    position = np.empty((2, 3))
    for row, group in enumerate((trusted, ~trusted)):
        chosen = group if group.sum() >= MIN_GROUP else np.ones_like(group)
        # The variance to add to the curvature's so that 90 % of errors lie within the 90 % interval.
        missing = (errors[chosen] / WITHIN_90) ** 2 - stated[chosen] ** 2
        position[row] = np.sqrt(np.quantile(missing, 0.9, axis=0).clip(0.0))
    return replace(calibration, position=position)


def _explained_photos(
    dataset: Dataset, object_class: ObjectClass, explainer: Explainer, advance: Callable[[int], None]
) -> Iterator[tuple[Explanation, np.ndarray]]:
    """Yield explanations of photos with boxes and cameras given, and the true poses (4, 4)."""
    for image, silhouette, spec in zip(dataset.images, dataset.amodal, dataset.specs(), strict=True):
        view = View.of_scene(spec, object_class)
        camera = view.camera.focal, view.camera.focal, view.camera.cx, view.camera.cy
        true = np.eye(4)
        true[:3, :3], true[:3, 3] = view.rotation, view.translation
        advance(1)
        if (box := box_of_silhouette(silhouette)) is not None:
            yield explainer.explain(image, box, K=camera), true


def position_error(explanation: Explanation, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return errors (3,) of a position in units of `FitCalibration.position`, and the curvature's deviations.

    true: (4, 4) camera_from_object.
    """
    _, pose, covariance = explanation.pinhole_pose()
    axes, units = sight_axes(pose), explanation.position_units
    widened = np.square(explanation.fit.position_deviation * units)
    variance = np.diag(axes.T @ covariance[:3, :3] @ axes) - widened
    return np.abs(axes.T @ (pose[:3, 3] - true[:3, 3])) / units, np.sqrt(variance.clip(0.0)) / units
