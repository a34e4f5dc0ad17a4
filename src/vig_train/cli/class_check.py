"""`vig class check`: a class on the user's own labelled photos."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from vig import Explainer
from vig.explanation import Explanation
from vig.io.checks import decode, read_json, reading
from vig.io.errors import UserError
from vig.io.printing import end
from vig.io.progress import Meter
from vig.photo.masks import read_mask
from vig.scene import ObjectClass, angle_difference
from vig.scene.object_class import PACKAGED
from vig_train.cli.common import check_ranges, check_writable
from vig_train.cli.settings import CheckClass
from vig_train.packs.card import replace_section, table_lines

HEADING = "## On photographs"
"""Heading of the card's section, which is replaced."""
SIDE = 30.0
"""Degrees about azimuths 0 and 180 that count as views from the right and the left."""


class PhotoLabel(msgspec.Struct, frozen=True):
    """Truth about a photo, an entry of labels.json.

    Attributes:
        photo: File name within the folder.
        azimuth_deg: Azimuth of the view; elevation_deg likewise.
        box: x, y, width, height round the whole object, pixels; None where it is to be found.
        silhouette: File of the object's whole outline, None where there is none.
        visible: File of its visible pixels; None where nothing is before the object.
        shape: Group of photos that gets a row of its own.
    """

    photo: str
    azimuth_deg: float
    elevation_deg: float
    box: tuple[float, float, float, float] | None = None
    silhouette: str | None = None
    visible: str | None = None
    shape: str = ""


@dataclass(frozen=True)
class PhotoErrors:
    """Errors on one photo: degrees, IoU of the outline and visible pixels, verdict; NaN without a label."""

    photo: str
    shape: str
    side: str
    azimuth_deg: float
    elevation_deg: float
    outline_iou: float
    visible_iou: float
    verdict: str


CheckRow = dict[str, Any]
"""A row of the table, of N photos; None where nothing is known, as JSON has no NaN."""


def check_class(settings: CheckClass) -> int:
    """Run `vig class check`."""
    object_class = ObjectClass.load(settings.pack)
    labels = read_labels(settings.photos, settings.labels or settings.photos / "labels.json")
    check_ranges(settings, workers=(1, inf), tolerance=(0.1, 180))
    pack = object_class.folder
    if pack is not None and pack.parent == PACKAGED:
        pack = None  # its card is not the user's
    if pack is not None:
        check_writable(pack)
    with contextlib.redirect_stdout(sys.stderr) if settings.json else contextlib.nullcontext():
        errors = _errors(settings, object_class, labels)
    groups = sorted({error.shape for error in errors if error.shape})
    rows = [row_of("all", errors, settings.tolerance)]
    rows += [row_of(g, [e for e in errors if e.shape == g], settings.tolerance) for g in groups]
    table = table_of(rows, settings)
    if pack is not None:
        replace_section(pack, object_class, f"{HEADING}\n\n{table}\n")
    if settings.json:
        print(json.dumps({"rows": rows, "folder": pack and str(pack)}, indent=2))
        return 0
    print(table)
    if pack is not None:
        end(pack, f"checked: the table is in {pack / 'card.md'}, too")
    return 0


def read_labels(folder: Path, path: Path) -> list[PhotoLabel]:
    """Return labels of photos in a folder; UserError when damaged, or of files that are not there."""
    if not folder.is_dir():
        raise UserError(f"expected a folder of photos; got '{folder}'.")
    with reading(path, "labels of photos", "See `vig class check --help`."):
        names = PhotoLabel.__struct_fields__  # others are the user's own
        labels = [
            decode(PhotoLabel, {name: value for name, value in entry.items() if name in names})
            for entry in decode(list[dict[str, Any]], read_json(path))
        ]
    if not labels:
        raise UserError(f"expected labels of one photo or more; '{path}' has none.")
    for label in labels:
        for name in (label.photo, label.silhouette, label.visible):
            if name is not None and not (folder / name).is_file():
                raise UserError(f"expected '{name}' of '{path}' in '{folder}'; it is not there.")
        if not -90 <= label.elevation_deg <= 90 or not np.isfinite(label.azimuth_deg):
            raise UserError(
                f"expected an elevation from -90 to 90 degrees and a finite azimuth of '{label.photo}' in"
                f" '{path}'; got {label.elevation_deg:g} and {label.azimuth_deg:g}."
            )
    return labels


def _errors(
    settings: CheckClass, object_class: ObjectClass, labels: Sequence[PhotoLabel]
) -> list[PhotoErrors]:
    explainer = Explainer(object_class)
    skipped: dict[int, UserError] = {}
    boxes = [None if settings.find else label.box for label in labels]
    errors = []
    with Meter(len(labels), 0, unit="photos") as meter:
        explanations = explainer.explain_many(
            [settings.photos / label.photo for label in labels],
            boxes,
            workers=settings.workers or 1,
            skip=skipped.__setitem__,
        )
        remaining = iter(enumerate(labels))
        for explanation in explanations:
            number, label = next(remaining)
            while number in skipped:
                number, label = next(remaining)
            try:
                errors.append(errors_of(explanation, label, settings.photos, object_class))
            except UserError as error:  # a silhouette that cannot be used
                skipped[number] = error
            meter.advance(1)
    for number, reason in skipped.items():
        print(f"left out {labels[number].photo}: {reason}", file=sys.stderr)
    if not errors:
        first = skipped[min(skipped)]
        raise UserError(f"expected labelled photos that can be used; none of {len(labels)} can. {first}")
    return errors


def errors_of(
    explanation: Explanation, label: PhotoLabel, folder: Path, object_class: ObjectClass
) -> PhotoErrors:
    """Return how far an explanation is off."""
    fold = object_class.symmetry.fold
    turn = np.radians(explanation.azimuth_deg - label.azimuth_deg)
    azimuth = np.degrees(abs(angle_difference(turn * fold, 0.0))) / fold if fold else np.nan
    outline = visible = np.nan
    seen = label.visible or label.silhouette
    if label.silhouette is not None:
        whole = _mask_of(folder, label, label.silhouette, explanation)
        outline = _iou(explanation.amodal | explanation.mask, whole)
    if seen is not None:
        visible = _iou(explanation.mask, _mask_of(folder, label, seen, explanation))
    side = "other"
    for name, middle in (("right", 0.0), ("left", 180.0)):
        if abs((label.azimuth_deg - middle + 180) % 360 - 180) <= SIDE:
            side = name
    return PhotoErrors(
        label.photo,
        label.shape,
        side,
        float(azimuth),
        abs(explanation.elevation_deg - label.elevation_deg),
        outline,
        visible,
        str(explanation.verdict),
    )


def _mask_of(folder: Path, label: PhotoLabel, name: str, explanation: Explanation) -> np.ndarray:
    """Return a mask (H, W) bool of a label; UserError where it is not as large as the photo."""
    mask = read_mask(folder / name)
    if mask.shape != explanation.mask.shape:
        raise UserError(f"expected a mask as large as '{label.photo}'; got '{name}'.")
    return mask


def _iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / max((a | b).sum(), 1))


def row_of(name: str, errors: Sequence[PhotoErrors], tolerance: float) -> CheckRow:
    """Return a row of the table. Where any turn looks the same a view is right by its elevation."""
    columns: dict[str, Any] = {
        key: np.array([vars(error)[key] for error in errors]) for key in vars(errors[0])
    }
    azimuth, elevation, side = (columns[key] for key in ("azimuth_deg", "elevation_deg", "side"))
    view = np.where(np.isnan(azimuth), elevation, azimuth)
    trusted = columns["verdict"] == "trusted"
    row: CheckRow = {"photos": name, "count": len(errors), "azimuth_deg": _median_known(azimuth)}
    for most in (15, 30):
        row[f"within_{most}"] = float((view <= most).mean())
        # Views from each side count alike.
        row[f"balanced_{most}"] = float(np.mean([(view[side == each] <= most).mean() for each in set(side)]))
    return row | {
        "turned": float((view > 150).mean()),
        **{key: _median_known(columns[key]) for key in ("elevation_deg", "outline_iou", "visible_iou")},
        "trusted": int(trusted.sum()),
        "trusted_right": float((view[trusted] <= tolerance).mean()) if trusted.any() else None,
    }


def _median_known(values: np.ndarray) -> float | None:
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else None


def table_of(rows: Sequence[CheckRow], settings: CheckClass) -> str:
    """Return the table in Markdown, with a line of explanation."""
    lines = [
        f"Labelled photos, {'found by vig' if settings.find else 'with their boxes'}; a trusted view is right"
        f" within {settings.tolerance:g} degrees; balanced: views from right, left, elsewhere count alike.",
        "",
    ]
    columns = {
        "azimuth, median": ("{:.1f}", "azimuth_deg"),
        "within 15 / 30": ("{:.2f} / {:.2f}", "within_15", "within_30"),
        "balanced": ("{:.2f} / {:.2f}", "balanced_15", "balanced_30"),
        "turned by more than 150": ("{:.2f}", "turned"),
        "elevation": ("{:.1f}", "elevation_deg"),
        "outline IoU": ("{:.2f}", "outline_iou"),
        "visible IoU": ("{:.2f}", "visible_iou"),
        "trusted": ("{}", "trusted"),
        "right": ("{:.2f}", "trusted_right"),
    }
    table = [
        [row["photos"], str(row["count"])]
        + [
            "-" if row[keys[0]] is None else text.format(*map(row.get, keys))
            for text, *keys in columns.values()
        ]
        for row in rows
    ]
    return "\n".join(lines + table_lines(["photos", "count", *columns], table))
