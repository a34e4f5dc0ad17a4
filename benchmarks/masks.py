"""The mask of what is visible, pixel by pixel and with neighbours that agree, on the same fits.

`python -m benchmarks.masks --dataset D --count N --seed S [--json FILE] [--sheet FILE]` draws N images from
those of a training split that training holds out for validation (or from `--among FIRST END`), fits each
once, and makes all masks from that fit. "wide tails" is the spatial model without its coupling, "mean field"
the spatial model without its graph cut, "best possible" the fit's silhouette with the true occlusion.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from vig.dataset import read_dataset
from vig.dataset.metrics import angle_error_deg, illumination_error, segmentation_iou, shape_error_mm
from vig.inference import ExplainSettings, explain_one, objective_of
from vig.likelihood import NEVER, ROBUST, SPATIAL, spatial_posterior, visible_share
from vig.likelihood.spatial import links, mean_field, visible_log_odds
from vig.recognition import Recognizer
from vig.scene import Latents, ObjectClass, linear_from_srgb

HELD_OUT = 1000
"""The last samples of a training split, which `vig train` validates on."""

BANDS = ((0.0, 0.25), (0.25, 0.5), (0.5, 0.75), (0.75, 0.9))
PAIRS = (("spatial", "pixelwise"), ("spatial", "wide tails"), ("spatial", "mean field"))
RESAMPLES = 2000
COLD_SWEEPS = 30


@dataclass(frozen=True)
class Fitted:
    """One fit: photo, rendered, log_prior (1, H, W, 3), covered (1, H, W), its mask pixelwise (H, W)."""

    latents: Latents
    photo: torch.Tensor
    rendered: torch.Tensor
    log_prior: torch.Tensor
    covered: torch.Tensor
    pixelwise: np.ndarray


def fitted(photo: torch.Tensor, prediction, teapot: ObjectClass, settings: ExplainSettings) -> Fitted:
    """Explain a photo (H, W, 3) and render the fit."""
    found = explain_one(photo, prediction, teapot, settings)
    objective = objective_of(photo, prediction, teapot, settings)
    zero, sigma = torch.zeros(1, dtype=torch.int32), torch.tensor([settings.likelihood.sigma])
    point = objective.point(found.latents, found.framing[None])
    seen = objective(point, zero, sigma, derivatives=False).evaluation
    rendered = seen.irradiance[..., None] * found.latents.albedo[:, None, None]
    prior = objective.likelihood.log_prior.view(rendered.shape)
    return Fitted(found.latents, photo[None], rendered, prior, seen.coverage >= 0.5, found.mask.numpy())


def spatial_mask(fit: Fitted, coupled: bool = True) -> np.ndarray:
    """The spatial model's mask (H, W); not coupled, the same likelihood of each pixel by itself."""
    model = SPATIAL if coupled else replace(SPATIAL, coupling=0.0, rim=0.0)
    return (spatial_posterior(fit.photo, fit.rendered, fit.log_prior, fit.covered, model)[0] > 0.5).numpy()


def cold_mask(fit: Fitted) -> np.ndarray:
    """The mask (H, W) of a mean field that starts at each pixel's own posterior, not at the cut."""
    known = fit.log_prior[..., 0] > NEVER / 2
    odds = visible_log_odds(fit.photo, fit.rendered, fit.log_prior)
    weights = links(fit.photo, fit.covered, known, SPATIAL)
    field = mean_field(odds.sigmoid(), odds, fit.covered, weights, COLD_SWEEPS)
    return (field[0] > 0.5).numpy()


def fit_errors(fits: list[Fitted], truth: Latents, teapot: ObjectClass) -> dict[str, np.ndarray]:
    """Errors (N,) of the fits, to compare one alpha with another."""
    found = Latents.from_vector(torch.cat([fit.latents.to_vector() for fit in fits]))
    vertices = teapot.shape_model.vertices
    return {
        "azimuth_deg": angle_error_deg(found.azimuth, truth.azimuth),
        "elevation_deg": angle_error_deg(found.elevation, truth.elevation),
        "illumination": illumination_error(found.light, truth.light),
        "shape_mm": shape_error_mm(vertices(found.shape), vertices(truth.shape)),
    }


def compared(one: np.ndarray, other: np.ndarray, rng: np.random.Generator) -> dict[str, float | list[float]]:
    """How much better `one` is than `other`, image by image: mean, median, 95 % intervals, share better."""
    gain = one - other
    drawn = rng.integers(0, len(gain), (RESAMPLES, len(gain)))
    return {
        "mean_gain": float(gain.mean()),
        "mean_gain_ci95": np.percentile(gain[drawn].mean(1), [2.5, 97.5]).tolist(),
        "median_gain": float(np.median(gain)),
        "share_better": float((gain > 0).mean()),
        "share_worse": float((gain < 0).mean()),
    }


def sheet(photos: np.ndarray, truth: np.ndarray, pairs: list[np.ndarray], worst: np.ndarray) -> Image.Image:
    """Photo and masks in a row each: green is right, red wrongly taken as visible, blue wrongly as hidden."""
    rows = []
    for index in worst:
        tiles = [photos[index]]
        for masks in pairs:
            mask, seen = masks[index], truth[index]
            paint = np.stack([mask & ~seen, mask & seen, seen & ~mask], axis=-1) * 255
            tiles.append((0.4 * photos[index] + 0.6 * paint).astype(np.uint8))
        rows.append(np.concatenate(tiles, axis=1))
    half = (len(rows) + 1) // 2
    columns = [np.concatenate(part, axis=0) for part in (rows[:half], rows[half:]) if part]
    tall = max(len(column) for column in columns)
    return Image.fromarray(
        np.concatenate([np.pad(c, ((0, tall - len(c)), (0, 0), (0, 0))) for c in columns], axis=1)
    )


def main() -> None:
    """Fit, compare, print, and write JSON and a contact sheet of the worst where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dataset", type=Path, required=True)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--among", type=int, nargs=2, metavar=("FIRST", "END"), help="samples to draw from")
    parser.add_argument("--alpha", type=float, default=SPATIAL.alpha, help="the fits' prior of being visible")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--sheet", type=Path)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    rng = np.random.default_rng(arguments.seed)
    dataset = read_dataset(arguments.dataset, "train")
    first, end = arguments.among or (max(len(dataset) - HELD_OUT, 0), len(dataset))
    held_out = np.arange(first, end)
    held_out = held_out[dataset.occlusion[held_out] <= BANDS[-1][1]]
    chosen = np.sort(rng.choice(held_out, min(arguments.count, len(held_out)), replace=False))
    teapot = ObjectClass.load("teapot")
    photos8 = dataset.read("rgb", chosen)
    photos = torch.from_numpy(linear_from_srgb(photos8.astype(np.float32) / 255)).float()
    truth, occlusion = dataset.read("mask_visib", chosen), dataset.occlusion[chosen]
    prediction = Recognizer.of_class(teapot)(photos)
    settings = ExplainSettings(replace(ROBUST, alpha=arguments.alpha))
    fits = [fitted(photos[i], prediction[i : i + 1], teapot, settings) for i in range(len(photos))]
    errors = fit_errors(fits, Latents.from_vector(torch.from_numpy(dataset.latents[chosen])), teapot)
    masks = {"pixelwise": [fit.pixelwise for fit in fits]}
    masks["wide tails"] = [spatial_mask(fit, coupled=False) for fit in fits]
    seconds = {}
    for name, make in (("mean field", cold_mask), ("spatial", spatial_mask)):
        durations = []
        masks[name] = []
        for fit in fits:
            started = time.perf_counter()
            masks[name].append(make(fit))
            durations.append(time.perf_counter() - started)
        seconds[name] = float(np.median(durations))
    masks["best possible"] = [fit.covered[0].numpy() & seen for fit, seen in zip(fits, truth, strict=True)]
    stacked = {name: np.stack(given) for name, given in masks.items()}
    iou = {name: segmentation_iou(given, truth) for name, given in stacked.items()}
    silhouettes = torch.stack([fit.covered[0] for fit in fits])
    report: dict = {
        "count": len(chosen),
        "seed": arguments.seed,
        "ms": {k: 1000 * v for k, v in seconds.items()},
    }
    report["errors"] = {
        k: {"median": float(np.median(e)), "mean": float(e.mean())} for k, e in errors.items()
    }
    for name, error in errors.items():
        print(f"the fits' {name}: median {np.median(error):.4f}, mean {error.mean():.4f}")
    report["posterior_alpha"] = visible_share(torch.from_numpy(stacked["spatial"]), silhouettes)
    for low, high in ((0.0, BANDS[-1][1]), *BANDS):
        within = (occlusion >= low) & (occlusion <= high)
        if not within.any():
            continue
        print(f"\n{low:.0%} to {high:.0%} hidden, {within.sum()} images: median IoU, mean IoU")
        rows = report[f"{low}-{high}"] = {}
        for name, values in iou.items():
            rows[name] = {"median": float(np.median(values[within])), "mean": float(values[within].mean())}
            print(f"  {name:14s} {rows[name]['median']:.4f}  {rows[name]['mean']:.4f}")
        for one, other in PAIRS:
            gain = rows[f"{one} - {other}"] = compared(iou[one][within], iou[other][within], rng)
            print(
                f"  {one} - {other}: mean {gain['mean_gain']:+.4f} [{gain['mean_gain_ci95'][0]:+.4f},"
                f" {gain['mean_gain_ci95'][1]:+.4f}], median {gain['median_gain']:+.4f},"
                f" better on {gain['share_better']:.0%}, worse on {gain['share_worse']:.0%}"
            )
    print("\n" + ", ".join(f"{name}: {value:.1f} ms" for name, value in report["ms"].items()))
    if arguments.sheet:
        worst = np.argsort(iou["spatial"] - iou["pixelwise"])[:16]
        sheet(photos8, truth, [stacked["pixelwise"], stacked["spatial"]], worst).save(arguments.sheet)
    if arguments.json:
        arguments.json.write_text(json.dumps(report, indent=2) + "\n")


if __name__ == "__main__":
    main()
