"""Running methods over a dataset and measuring them: one row per image, method and metric."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from vig.dataset import Dataset
from vig.errors import UserError
from vig.evaluation.metrics import (
    angle_error_deg,
    appearance_error,
    illumination_error,
    segmentation_iou,
    shape_error_mm,
)
from vig.evaluation.table import BASELINE
from vig.files import atomic_write
from vig.inference import ExplainSettings, Explanation, explain_one, geometry_of
from vig.likelihood import GAUSSIAN, ROBUST, SPATIAL, Likelihood, Photos, load_kernels
from vig.recognition import MASK_CLASSES, Prediction, Recognizer
from vig.render import map_on_threads
from vig.scene import EXPOSURE_L00, Camera, Latents, ObjectClass, linear_from_srgb
from vig.synthesis.target import shape_vertices

LIKELIHOODS = {"gaussian": GAUSSIAN, "robust": ROBUST, "spatial": SPATIAL}
METHODS = (BASELINE, "rm", "gaussian", "robust", "spatial")

MASK_HEAD = "rm mask head"
"""What "rm" is shown beside: the network's own word on the visible pixels, no silhouette."""

_MEAN_ELEVATION = np.pi / 4
_MEAN_ALBEDO = 0.5


@dataclass(frozen=True)
class MethodResult:
    """What one method said of N images. errors: metric to (N,). verdicts: (N,) names, empty where none."""

    errors: dict[str, np.ndarray]
    verdicts: list[str]


def evaluate(
    dataset: Dataset,
    object_class: ObjectClass,
    recognizer: Recognizer,
    methods: tuple[str, ...] = METHODS,
    settings: ExplainSettings | None = None,
    threads: int | None = None,
    advance: Callable[[int], None] = lambda done: None,
) -> dict[str, MethodResult]:
    """Run methods over all images, `threads` fits at a time, one per CPU by default.

    `advance` is told how many were fitted since the last call.

    "baseline" answers every image alike, "rm" is the recognition model's best guess with its whole
    silhouette as mask (as in the paper; the mask that it predicts is listed as a method of its own),
    "gaussian", "robust" and "spatial" the fits from it, under each pixel model. Raises UserError for an
    unknown method, for none, and for a dataset of another class.
    """
    if not methods:
        raise UserError(f"expected at least one method among {', '.join(METHODS)}; got none")
    modes, found = object_class.shape_model.modes, dataset.latents.shape[1] - 14
    if found != modes:
        raise UserError(
            f"expected a dataset of class '{object_class.name}' with {modes} shape components;"
            f" '{dataset.folder}' has {found}. Name its class with --class."
        )
    unknown = [method for method in methods if method not in METHODS]
    if unknown:
        raise UserError(f"expected methods among {', '.join(METHODS)}; got {', '.join(unknown)}")
    settings = settings or ExplainSettings()
    threads = threads or os.cpu_count() or 1
    truth = Truth.of(dataset, object_class)
    photos = torch.from_numpy(linear_from_srgb(dataset.images.astype(np.float32) / 255)).float()
    results = {}
    prediction = recognizer(photos)
    for method in methods:
        if method == BASELINE:
            latents = _mean_latents(object_class, len(dataset))
            results[method] = MethodResult(_errors(latents, truth, object_class), [""] * len(dataset))
        elif method == "rm":
            latents = prediction.best()
            masks = silhouettes(latents, object_class)
            errors = _errors(latents, truth, object_class) | {
                "segmentation_iou": segmentation_iou(masks, dataset.visible)
            }
            results[method] = MethodResult(errors, [""] * len(dataset))
            said = (prediction.mask.argmax(-1) == MASK_CLASSES.index("visible")).numpy()
            head = {"segmentation_iou": segmentation_iou(said, dataset.visible)}
            results[MASK_HEAD] = MethodResult(head, [""] * len(dataset))
        else:
            chosen = replace(settings, likelihood=LIKELIHOODS[method])
            fits = list(_fits(photos, prediction, object_class, chosen, threads, advance))
            latents = Latents.from_vector(torch.cat([fit.latents.to_vector() for fit in fits]))
            # The Gaussian model has no outliers: its mask is the whole silhouette, as in the paper.
            masks = np.stack([(fit.amodal if method == "gaussian" else fit.mask).numpy() for fit in fits])
            errors = _errors(latents, truth, object_class) | {
                "segmentation_iou": segmentation_iou(masks, dataset.visible)
            }
            results[method] = MethodResult(errors, [fit.verdict.name.lower() for fit in fits])
    return results


def silhouettes(latents: Latents, object_class: ObjectClass) -> np.ndarray:
    """Whole silhouettes (N, H, W) bool of latents in the standard camera."""
    camera = Camera.standard(target_height=object_class.target_height)
    blank = torch.zeros(1, camera.height, camera.width, 3)
    log_prior = ROBUST.log_prior(camera.height, camera.width)[None]
    likelihood = Likelihood(geometry_of(object_class), camera, Photos(blank, log_prior))
    masks = []
    for part in latents.to_vector().split(16):
        count = len(part)
        valued = likelihood(
            Latents.from_vector(part),
            torch.zeros(count, 3),
            torch.zeros(count, dtype=torch.int32),
            torch.full((count,), ROBUST.sigma),
            derivatives=False,
        )
        assert valued.coverage is not None
        masks.append((valued.coverage >= 0.5).numpy())
    return np.concatenate(masks)


def write_csv(path: Path, dataset: Dataset, results: dict[str, MethodResult]) -> None:
    """One row per image and method: index, occlusion, cause, method, verdict, every metric."""
    metrics = sorted({metric for result in results.values() for metric in result.errors})
    with atomic_write(path) as temporary, open(temporary, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["image", "occlusion", "cause", "method", "verdict", *metrics])
        for method, result in results.items():
            for i in range(len(dataset)):
                values = [f"{result.errors[m][i]:.6g}" if m in result.errors else "" for m in metrics]
                start = [i, f"{dataset.occlusion[i]:.4f}", dataset.cause[i], method, result.verdicts[i]]
                writer.writerow(start + values)


def _fits(
    photos: torch.Tensor,
    prediction: Prediction,
    object_class: ObjectClass,
    settings: ExplainSettings,
    threads: int,
    advance: Callable[[int], None],
) -> Iterator[Explanation]:
    """Fit every photo, `threads` at a time; after Ctrl-C nobody waits for fits that were not begun."""
    load_kernels(torch.float32, object_class.shape_model.modes)

    def one(index: int) -> Explanation:
        return explain_one(photos[index], prediction[index : index + 1], object_class, settings)

    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        for fit in map_on_threads(one, range(len(photos))):
            advance(1)
            yield fit
    finally:
        torch.set_num_threads(before)


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
    }
