"""Methods run over a dataset, and their errors for each image and metric."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from vig.inference import ExplainSettings
from vig.io.errors import UserError
from vig.likelihood import LIKELIHOODS
from vig.recognition import MASK_CLASSES, Prediction, Recognizer
from vig.scene import EXPOSURE_L00, Latents, ObjectClass, layout_of_width, linear_from_srgb
from vig_train import METHODS
from vig_train.evaluation.fits import FitRun, Fits, fit_settings, frame_images
from vig_train.evaluation.metrics import (
    angle_error_deg,
    appearance_error,
    illumination_error,
    segmentation_iou,
    shape_error_mm,
)
from vig_train.evaluation.results import MethodResult, predicted_deviation
from vig_train.evaluation.table import BASELINE
from vig_world.assets.target import standing_vertices
from vig_world.dataset import Dataset
from vig_world.raster.rasterize import rasterize

FITTED_AS = {"robust": "spatial"}
"""Methods that share another method's fits: they differ only in the mask, which "spatial" alone smooths."""

MASK_HEAD = "rm mask head"
"""Reported beside "rm": the visible pixels as the network itself predicts them, without a silhouette."""


def fitted_likelihoods(methods: Iterable[str]) -> list[str]:
    """Return the likelihoods under which photos must be fitted for methods, each once."""
    needed = {FITTED_AS.get(method, method) for method in methods}
    return [name for name in LIKELIHOODS if name in needed]


def evaluate(
    dataset: Dataset,
    recognizer: Recognizer,
    run: FitRun,
    methods: tuple[str, ...] = METHODS,
    settings: ExplainSettings | None = None,
) -> dict[str, MethodResult]:
    """Run methods over all images.

    Args:
        dataset: Dataset of the run's class.
        recognizer: Its prediction is where fits start.
        run: How fits are made. Those of other code in its cache are not recognised: remove the folder after a
            change of it.
        methods: "baseline" predicts the same for every image. "rm" is the recognition model's best guess with
            its whole silhouette as mask, as in the paper; its predicted mask is reported as `MASK_HEAD`.
            "gaussian", "robust" and "spatial" are the fits under each likelihood.
        settings: Settings of the fits, but for the likelihood.

    Raises:
        UserError: An unknown method, no method, or a dataset of another class.
    """
    object_class, settings = run.object_class, settings or ExplainSettings()
    _check(dataset, object_class, methods)
    images, visible = frame_images(dataset, recognizer)
    truth = Truth.of(dataset, object_class, visible)
    prediction = recognizer(linear_from_srgb(images.astype(np.float32) / 255))
    fits: dict[str, Fits] = {}
    for name in fitted_likelihoods(methods):
        chosen = fit_settings(replace(settings, likelihood=LIKELIHOODS[name]), object_class, dataset)
        fits[name] = run.fit(images, recognizer, chosen, name, prediction)
    results = {}
    for method in methods:
        if method == BASELINE:
            results[method] = _baseline(truth, object_class)
        elif method == "rm":
            results |= _recognition(prediction, truth, object_class)
        else:
            results[method] = _fit(method, fits[FITTED_AS.get(method, method)], truth, object_class)
    return results


def silhouettes(latents: Latents, object_class: ObjectClass) -> np.ndarray:
    """Return whole silhouettes (N, H, W) bool of N explanations: pixels whose centre the object covers."""
    camera = object_class.camera()
    model = object_class.shape_model
    rotations, translations = camera.pose(
        latents.azimuth.astype(np.float64), latents.elevation.astype(np.float64)
    )
    shapes = zip(model.vertices(latents.shape), rotations, translations, strict=True)
    return np.stack([rasterize(v, model.faces, r, t, camera, cull=True).face >= 0 for v, r, t in shapes])


@dataclass(frozen=True)
class Truth:
    """Ground truth of N images."""

    latents: Latents
    vertices: np.ndarray
    """(N, V, 3): objects may be held-out designs, which the shape model cannot represent exactly."""
    visible: np.ndarray
    """(N, H, W) bool: the object's visible pixels."""

    @staticmethod
    def of(dataset: Dataset, object_class: ObjectClass, visible: np.ndarray) -> "Truth":
        """Return the truth of a dataset, whose images show the object at the pixels (N, H, W) bool."""
        latents = Latents.from_vector(dataset.latents)
        shapes = zip(latents.shape, dataset.design.tolist(), strict=True)
        vertices = [standing_vertices(shape, design, object_class) for shape, design in shapes]
        return Truth(latents, np.stack(vertices), visible)


def _check(dataset: Dataset, object_class: ObjectClass, methods: tuple[str, ...]) -> None:
    """Refuse unknown methods, none, and a dataset of another class."""
    if not methods:
        raise UserError(f"expected at least one method among {', '.join(METHODS)}; got none")
    unknown = [method for method in methods if method not in METHODS]
    if unknown:
        raise UserError(f"expected methods among {', '.join(METHODS)}; got {', '.join(unknown)}")
    check_class(dataset, object_class)


def check_class(dataset: Dataset, object_class: ObjectClass) -> None:
    """Raise UserError where a dataset has other shape components than a class."""
    modes = object_class.shape_model.modes
    dataset_modes = layout_of_width(dataset.latents.shape[1]).count("shape")
    if dataset_modes != modes:
        raise UserError(
            f"expected a dataset of class '{object_class.name}' with {modes} shape components;"
            f" '{dataset.folder}' has {dataset_modes}. Name its class with --class."
        )


def _baseline(truth: Truth, object_class: ObjectClass) -> MethodResult:
    """Return the mean of the training distribution, whatever the photo."""
    count = len(truth.vertices)
    light = object_class.light_prior_mean.astype(np.float32)
    light = light * (EXPOSURE_L00 / light[0])
    latents = Latents(
        np.zeros((count, object_class.shape_model.modes), np.float32),
        np.zeros(count, np.float32),
        np.full(count, (np.pi / 4), np.float32),
        np.full((count, 3), 0.5, np.float32),
        np.tile(light, (count, 1)),
    )
    errors = _errors(latents, truth, object_class)
    return MethodResult(errors, [""] * count, latents, symmetry=object_class.symmetry)


def _recognition(prediction: Prediction, truth: Truth, object_class: ObjectClass) -> dict[str, MethodResult]:
    """Return the recognition model's best guess, and the mask that it predicts."""
    latents, none = prediction.best(), [""] * len(truth.vertices)
    masks = silhouettes(latents, object_class)
    errors = _errors(latents, truth, object_class) | _segmentation(masks, truth)
    predicted = prediction.mask.argmax(-1) == MASK_CLASSES.index("visible")
    return {
        "rm": MethodResult(
            errors, none, latents, predicted_deviation(prediction), masks, object_class.symmetry
        ),
        MASK_HEAD: MethodResult(_segmentation(predicted, truth), none, masks=predicted),
    }


def _fit(method: str, fits: Fits, truth: Truth, object_class: ObjectClass) -> MethodResult:
    masks = fits.masks_by_pixel if method == "robust" else fits.masks
    latents = Latents.from_vector(fits.latents)
    errors = _errors(latents, truth, object_class) | _segmentation(masks, truth)
    verdicts, symmetry = list(fits.verdicts), object_class.symmetry
    return MethodResult(errors, verdicts, latents, fits.deviation, masks, symmetry)


def _errors(latents: Latents, truth: Truth, object_class: ObjectClass) -> dict[str, np.ndarray]:
    true = object_class.symmetry.nearest(truth.latents, latents.azimuth)
    vertices = object_class.shape_model.vertices(latents.shape)
    return {
        "azimuth_deg": angle_error_deg(latents.azimuth, true.azimuth),
        "elevation_deg": angle_error_deg(latents.elevation, true.elevation),
        "appearance": appearance_error(latents.albedo, true.albedo),
        "illumination": illumination_error(latents.light, true.light),
        "shape_mm": shape_error_mm(vertices, truth.vertices),
    }


def _segmentation(masks: np.ndarray, truth: Truth) -> dict[str, np.ndarray]:
    return {"segmentation_iou": segmentation_iou(masks, truth.visible)}
