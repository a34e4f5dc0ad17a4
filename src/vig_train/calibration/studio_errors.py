"""Errors of a class's network and fits on images of the studio."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vig.inference import ExplainSettings, resolve
from vig.recognition import Recognizer
from vig.scene import Latents, ObjectClass, layout_of_width, linear_from_srgb
from vig_train.calibration.samples import StudioPhotos
from vig_train.evaluation.fits import cache_key, fit_all
from vig_train.evaluation.metrics import segmentation_iou


def studio_errors(
    parts: Sequence[tuple[StudioPhotos, Recognizer]],
    object_class: ObjectClass,
    settings: ExplainSettings,
    workers: int,
    advance: Callable[[int], None] = lambda done: None,
    cache: Path | None = None,
) -> dict[str, Any]:
    """Return errors on photos that show the object, and the precision of the verdict "trusted".

    Args:
        parts: Photos, each with a network that has not seen their meshes.
        object_class: What they show.
        settings: Of the fits.
        workers: Processes.
        advance: Called with the number of fits made since the last call.
        cache: Folder that keeps fits, so that an interrupted run resumes.

    Returns:
        `photos`, `trusted`, `trusted_right` (None where none is trusted), and in `methods` for "network" and
        "fit" medians of errors, degrees, shares of views within 15 and 30 degrees and turned by more than
        150, and the mean IoU of the visible pixels. Where any turn looks the same there is no azimuth, and a
        view is right by its elevation.
    """
    chosen = resolve(settings, object_class, photo=True)
    symmetry = object_class.symmetry
    columns: dict[str, dict[str, list[np.ndarray]]] = {
        name: {"turn": [], "tilt": [], "iou": []} for name in ("network", "fit")
    }
    verdicts: list[str] = []
    for number, (photos, recognizer) in enumerate(parts):
        linear = linear_from_srgb(photos.images.astype(np.float32) / 255)
        predicted = recognizer(linear)
        key = cache_key(recognizer, object_class, chosen)
        folder = None if cache is None else cache / str(number)
        given = photos.images, linear, predicted, object_class, chosen, workers, advance, folder, key
        fits = fit_all(*given, processes=True)
        verdicts += fits.verdicts
        layout = layout_of_width(photos.latents.shape[1])
        true = Latents.from_vector(photos.latents)
        masks = {"network": predicted.mask.argmax(3) == 0, "fit": fits.masks}
        for name, found in {"network": predicted.best().to_vector(), "fit": fits.latents}.items():
            turn = np.degrees(np.abs(symmetry.difference(found[:, layout.at("azimuth")], true.azimuth)))
            tilt = np.degrees(np.abs(found[:, layout.at("elevation")] - true.elevation))
            iou = segmentation_iou(masks[name], photos.visible)
            for column, values in {"turn": turn, "tilt": tilt, "iou": iou}.items():
                columns[name][column].append(values)
    errors = {
        name: {column: np.concatenate(values) for column, values in of.items()}
        for name, of in columns.items()
    }
    methods = {}
    for name, of in errors.items():
        row = {"elevation_deg": float(np.median(of["tilt"])), "visible_iou": float(of["iou"].mean())}
        if symmetry.fold:
            row["azimuth_deg"] = float(np.median(of["turn"]))
            row |= {f"within_{most}": float((of["turn"] <= most).mean()) for most in (15, 30)}
            row["turned"] = float((of["turn"] > 150).mean())
        methods[name] = row
    trusted = np.array([verdict == "trusted" for verdict in verdicts])
    right = errors["fit"]["turn" if symmetry.fold else "tilt"][trusted] <= 15
    return {
        "photos": len(trusted),
        "methods": methods,
        "trusted": float(trusted.mean()),
        "trusted_right": float(right.mean()) if trusted.any() else None,
    }
