"""Errors of a class's network and fits on images of the studio."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from vig.inference import ExplainSettings, resolve
from vig.recognition import Recognizer
from vig.scene import Latents, ObjectClass, layout_of_width, linear_from_srgb
from vig_train.calibration import StudioPhotos
from vig_train.evaluation.fits import cache_key, fit_all
from vig_train.evaluation.metrics import segmentation_iou


def studio_errors(
    photos: StudioPhotos,
    object_class: ObjectClass,
    recognizer: Recognizer,
    settings: ExplainSettings,
    workers: int,
    advance: Callable[[int], None] = lambda done: None,
    cache: Path | None = None,
) -> dict[str, Any]:
    """Errors on photos that show the object, and the precision of the verdict "trusted".

    Returns:
        `photos`, `trusted`, `trusted_right` (None where none is trusted), and in `methods` for "network" and
        "fit" medians of errors, degrees, shares of views within 15 and 30 degrees and turned by more than
        150, and the mean IoU of the visible pixels. Where any turn looks the same there is no azimuth, and a
        view is right by its elevation.
    """
    linear = torch.from_numpy(linear_from_srgb(photos.images.astype(np.float32) / 255)).float()
    predicted = recognizer(linear)
    chosen = resolve(settings, object_class, photo=True)
    key = cache_key(recognizer, object_class, chosen)
    fits = fit_all(
        photos.images, linear, predicted, object_class, chosen, workers, advance, cache, key, processes=True
    )
    layout = layout_of_width(photos.latents.shape[1])
    symmetry, true = object_class.symmetry, Latents.from_vector(torch.from_numpy(photos.latents))
    masks = {"network": (predicted.mask.argmax(3) == 0).numpy(), "fit": fits.masks}
    latents = {"network": predicted.best().to_vector().numpy(), "fit": fits.latents}
    methods, errors = {}, {}
    for name, found in latents.items():
        at = torch.from_numpy(found[:, layout.at("azimuth")])
        turn = symmetry.difference(at, true.azimuth).abs().rad2deg().numpy()
        tilt = np.degrees(np.abs(found[:, layout.at("elevation")] - true.elevation.numpy()))
        errors[name] = turn if symmetry.fold else tilt
        iou = segmentation_iou(masks[name], photos.visible)
        row = {"elevation_deg": float(np.median(tilt)), "visible_iou": float(iou.mean())}
        if symmetry.fold:
            row["azimuth_deg"] = float(np.median(turn))
            row |= {f"within_{most}": float((turn <= most).mean()) for most in (15, 30)}
            row["turned"] = float((turn > 150).mean())
        methods[name] = row
    trusted = np.array([verdict == "trusted" for verdict in fits.verdicts])
    right = errors["fit"][trusted] <= 15
    return {
        "photos": len(trusted),
        "methods": methods,
        "trusted": float(trusted.mean()),
        "trusted_right": float(right.mean()) if trusted.any() else None,
    }
