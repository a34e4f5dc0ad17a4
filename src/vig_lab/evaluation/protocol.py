"""Running methods over a dataset and measuring them: one row per image, method and metric."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from vig.dataset import Dataset
from vig.dataset.metrics import (
    angle_error_deg,
    appearance_ab,
    appearance_error,
    illumination_error,
    illumination_relative,
    segmentation_iou,
    shape_error_mm,
    shape_paper,
)
from vig.errors import UserError
from vig.inference import ExplainSettings
from vig.likelihood import GAUSSIAN, ROBUST, SPATIAL
from vig.recognition import MASK_CLASSES, Recognizer
from vig.scene import EXPOSURE_L00, Latents, ObjectClass, layout_of_width, linear_from_srgb
from vig.scene.designs import shape_vertices
from vig_lab.evaluation.fits import Fits, fit_all, key_of
from vig_lab.evaluation.rendering import silhouettes
from vig_lab.evaluation.results import MethodResult, stated_deviation
from vig_lab.evaluation.table import BASELINE

LIKELIHOODS = {"gaussian": GAUSSIAN, "robust": ROBUST, "spatial": SPATIAL}
SHARED = {"robust": "spatial"}
"""Methods whose fits are those of another: only its mask heeds the neighbours."""

METHODS = (BASELINE, "rm", "gaussian", "robust", "spatial")

MASK_HEAD = "rm mask head"
"""What "rm" is shown beside: the network's own word on the visible pixels, no silhouette."""

_MEAN_ELEVATION = np.pi / 4
_MEAN_ALBEDO = 0.5


def fitted(methods: Iterable[str]) -> list[str]:
    """What has to be fitted for methods, each once."""
    return sorted({SHARED.get(method, method) for method in methods if method in LIKELIHOODS})


def evaluate(
    dataset: Dataset,
    object_class: ObjectClass,
    recognizer: Recognizer,
    methods: tuple[str, ...] = METHODS,
    settings: ExplainSettings | None = None,
    workers: int | None = None,
    advance: Callable[[int], None] = lambda done: None,
    cache: Path | None = None,
    processes: bool = False,
) -> dict[str, MethodResult]:
    """Run methods over all images, `workers` fits at a time, one per CPU by default.

    `advance` is told how many were fitted since the last call. cache: a folder that keeps fits, so that they
    are not made again; fits of other photos, weights, settings or class there are replaced. Those of other
    code are not told apart: remove the folder after a change of it. processes: workers may be processes in
    place of threads, see `fit_all`; a script must then guard what it runs by `if __name__ == "__main__"`.

    "baseline" answers every image alike, "rm" is the recognition model's best guess with its whole
    silhouette as mask (as in the paper; the mask that it predicts is listed as a method of its own),
    "gaussian", "robust" and "spatial" the fits from it, under each pixel model. Raises UserError for an
    unknown method, for none, and for a dataset of another class.
    """
    if not methods:
        raise UserError(f"expected at least one method among {', '.join(METHODS)}; got none")
    modes, found = object_class.shape_model.modes, layout_of_width(dataset.latents.shape[1]).count("shape")
    if found != modes:
        raise UserError(
            f"expected a dataset of class '{object_class.name}' with {modes} shape components;"
            f" '{dataset.folder}' has {found}. Name its class with --class."
        )
    unknown = [method for method in methods if method not in METHODS]
    if unknown:
        raise UserError(f"expected methods among {', '.join(METHODS)}; got {', '.join(unknown)}")
    settings = settings or ExplainSettings()
    workers = workers or os.cpu_count() or 1
    truth = Truth.of(dataset, object_class)
    photos = torch.from_numpy(linear_from_srgb(dataset.images.astype(np.float32) / 255)).float()
    prediction = recognizer(photos)
    nothing = [""] * len(dataset)
    results, done = {}, dict[str, Fits]()
    for method in methods:
        if method == BASELINE:
            latents = _mean_latents(object_class, len(dataset))
            results[method] = MethodResult(_errors(latents, truth, object_class), nothing, latents)
        elif method == "rm":
            latents = prediction.best()
            masks = silhouettes(latents, object_class)
            errors = _errors(latents, truth, object_class) | _segmentation(masks, dataset)
            results[method] = MethodResult(errors, nothing, latents, stated_deviation(prediction), masks)
            said = (prediction.mask.argmax(-1) == MASK_CLASSES.index("visible")).numpy()
            results[MASK_HEAD] = MethodResult(_segmentation(said, dataset), nothing, masks=said)
        else:
            same = SHARED.get(method, method)
            chosen = replace(settings, likelihood=LIKELIHOODS[same])
            folder = None if cache is None else cache / same
            key = key_of(recognizer, object_class, chosen)
            if same not in done:
                done[same] = fit_all(
                    dataset.images,
                    photos,
                    prediction,
                    object_class,
                    chosen,
                    workers,
                    advance,
                    folder,
                    key,
                    processes,
                )
            fits = done[same]
            masks = fits.masks_by_pixel if method == "robust" else fits.masks
            latents = Latents.from_vector(torch.from_numpy(fits.latents))
            errors = _errors(latents, truth, object_class) | _segmentation(masks, dataset)
            results[method] = MethodResult(errors, list(fits.verdicts), latents, fits.deviation, masks)
    return results


def _mean_latents(object_class: ObjectClass, count: int) -> Latents:
    """The middle of what training draws: the answer that looks at no photo."""
    light = torch.from_numpy(object_class.light_prior_mean).float()
    light = light * (EXPOSURE_L00 / light[0])
    return Latents(
        torch.zeros(count, object_class.shape_model.modes),
        torch.zeros(count),
        torch.full((count,), _MEAN_ELEVATION),
        torch.full((count, 3), _MEAN_ALBEDO),
        light.expand(count, -1),
    )


@dataclass(frozen=True)
class Truth:
    """What is right of N images: latents, and vertices (N, V, 3), which no latents need to reach."""

    latents: Latents
    vertices: torch.Tensor

    @staticmethod
    def of(dataset: Dataset, object_class: ObjectClass) -> Truth:
        """The truth of a dataset, whose objects may be designs that the model cannot quite take on."""
        latents = Latents.from_vector(torch.from_numpy(dataset.latents))
        shapes = zip(latents.shape.numpy(), dataset.design.tolist(), strict=True)
        vertices = [shape_vertices(shape, design, object_class) for shape, design in shapes]
        return Truth(latents, torch.from_numpy(np.stack(vertices)))


def _errors(latents: Latents, truth: Truth, object_class: ObjectClass) -> dict[str, np.ndarray]:
    right, vertices = truth.latents, object_class.shape_model.vertices(latents.shape)
    return {
        "azimuth_deg": angle_error_deg(latents.azimuth, right.azimuth),
        "elevation_deg": angle_error_deg(latents.elevation, right.elevation),
        "appearance": appearance_error(latents.albedo, right.albedo),
        "illumination": illumination_error(latents.light, right.light),
        "shape_mm": shape_error_mm(vertices, truth.vertices),
        "shape_paper": shape_paper(vertices, truth.vertices),
        "appearance_ab": appearance_ab(latents.albedo, right.albedo),
        "illumination_relative": illumination_relative(latents.light, right.light),
    }


def _segmentation(masks: np.ndarray, dataset: Dataset) -> dict[str, np.ndarray]:
    return {"segmentation_iou": segmentation_iou(masks, dataset.visible)}
