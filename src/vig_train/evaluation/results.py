"""Results of a method on a dataset's images, and the same as one row per image."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vig.io.files import atomic_write
from vig.recognition import Prediction
from vig.scene import Latents, Symmetry, latent_layout, rotations_z
from vig_world.dataset import Dataset


@dataclass(frozen=True)
class MethodResult:
    """Results of one method on N images; None where a method has no such output."""

    errors: dict[str, np.ndarray]
    """Metric to (N,)."""
    verdicts: list[str]
    """N names, empty where a method gives no verdicts."""
    latents: Latents | None = None
    """Its explanations (N)."""
    deviation: np.ndarray | None = None
    """(N, P): predicted standard deviation of each latent, in their order."""
    masks: np.ndarray | None = None
    """(N, H, W) bool: the object's visible pixels as estimated."""
    symmetry: Symmetry = Symmetry.NONE
    """Symmetry of the class."""


def predicted_deviation(prediction: Prediction) -> np.ndarray:
    """Return standard deviations (N, P) of the latents about `Prediction.best`, in their order, world frame.

    Azimuth's is the root mean square of the differences between the best guess and all bins, so that a second
    hypothesis widens it. The light's is rotated from the heading frame by the best guess.
    """
    best = prediction.best().azimuth.astype(np.float64)
    bins, symmetry = prediction.azimuth.shape[1], prediction.symmetry
    centres = (np.arange(bins) + 0.5) * (2 * np.pi / bins) / max(symmetry.fold, 1)
    turns = symmetry.difference(centres, best[:, None])
    azimuth = np.sqrt((prediction.azimuth.astype(np.float64) * turns**2).sum(1))
    parts = prediction.layout.split(prediction.deviation.astype(np.float64))
    parts["light"] = np.sqrt((rotations_z(best) ** 2 @ parts["light"][:, :, None] ** 2)[:, :, 0])
    layout = latent_layout(prediction.layout.count("shape"))
    return layout.join(parts | {"azimuth": azimuth[:, None]})


def write_csv(path: Path, dataset: Dataset, results: dict[str, MethodResult]) -> None:
    """Write a row for each image and method: occlusion and cause, verdict, pose in degrees, every metric.

    Pose: the truth's azimuth and elevation and the estimate's, empty where a method gives none. The metric
    `azimuth_deg` is between views that look the same, their difference need not be.
    """
    metrics = sorted({metric for result in results.values() for metric in result.errors})
    truth = _pose_deg(Latents.from_vector(dataset.latents))
    pose = [f"{whose}_{angle}_deg" for whose in ("true", "estimated") for angle in ("azimuth", "elevation")]
    with atomic_write(path) as temporary, open(temporary, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["image", "occlusion", "cause", "method", "verdict", *pose, *metrics])
        for method, result in results.items():
            estimates = None if result.latents is None else _pose_deg(result.latents)
            for i in range(len(dataset)):
                start = [i, f"{dataset.occlusion[i]:.4f}", dataset.cause[i], method, result.verdicts[i]]
                poses = [*_text(truth[i]), *(["", ""] if estimates is None else _text(estimates[i]))]
                values = [f"{result.errors[m][i]:.6g}" if m in result.errors else "" for m in metrics]
                writer.writerow(start + poses + values)


def _pose_deg(latents: Latents) -> np.ndarray:
    """Return azimuth in [0, 360) and elevation (N, 2), degrees."""
    pose = np.stack([latents.azimuth % (2 * np.pi), latents.elevation], axis=1)
    return np.degrees(pose.astype(np.float64))


def _text(pose: np.ndarray) -> list[str]:
    return [f"{angle:.3f}" for angle in pose]
