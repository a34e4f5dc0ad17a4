"""`vig class check`: a class on the user's own labelled photos."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
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
    """Errors on one photo: degrees, IoU of the whole outline and of visible pixels, verdict; NaN where
    nothing is labelled.
    """

    photo: str
    shape: str
    side: str
    azimuth_deg: float
    elevation_deg: float
    outline_iou: float
    visible_iou: float
    verdict: str


@dataclass(frozen=True)
class CheckRow:
    """A row of the table, of N photos. Balanced shares count views from each side alike."""

    photos: str
    count: int
    azimuth_deg: float
    within_15: float
    within_30: float
    balanced_15: float
    balanced_30: float
    turned: float
    elevation_deg: float
    outline_iou: float
    visible_iou: float
    trusted: int
    trusted_right: float


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
    plain = [{name: _known(value) for name, value in asdict(row).items()} for row in rows]
    if settings.json:
        print(json.dumps({"rows": plain, "folder": pack and str(pack)}, indent=2))
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
    azimuth = np.array([error.azimuth_deg for error in errors])
    elevation = np.array([error.elevation_deg for error in errors])
    view = np.where(np.isnan(azimuth), elevation, azimuth)
    sides = np.array([error.side for error in errors])

    def balanced(most: float) -> float:
        return float(np.mean([(view[sides == side] <= most).mean() for side in np.unique(sides)]))

    trusted = np.array([error.verdict == "trusted" for error in errors])
    return CheckRow(
        name,
        len(errors),
        float(np.median(azimuth)),
        float((view <= 15).mean()),
        float((view <= 30).mean()),
        balanced(15),
        balanced(30),
        float((view > 150).mean()),
        float(np.median(elevation)),
        _median([error.outline_iou for error in errors]),
        _median([error.visible_iou for error in errors]),
        int(trusted.sum()),
        float((view[trusted] <= tolerance).mean()) if trusted.any() else float("nan"),
    )


def _median(values: Sequence[float]) -> float:
    known = [value for value in values if not np.isnan(value)]
    return float(np.median(known)) if known else float("nan")


def table_of(rows: Sequence[CheckRow], settings: CheckClass) -> str:
    """Return the table in Markdown, with a line of explanation."""
    lines = [
        f"Labelled photos, {'found by vig' if settings.find else 'with their boxes'}; a trusted view is right"
        f" within {settings.tolerance:g} degrees; balanced: views from right, left, elsewhere count alike.",
        "",
    ]
    table = []
    for row in rows:
        shares = ((row.within_15, row.within_30), (row.balanced_15, row.balanced_30))
        cells = [row.photos, str(row.count), _cell(row.azimuth_deg, 1)]
        cells += [" / ".join(_cell(share) for share in pair) for pair in shares]
        cells += [_cell(row.turned), _cell(row.elevation_deg, 1), _cell(row.outline_iou)]
        cells += [_cell(row.visible_iou), str(row.trusted), _cell(row.trusted_right)]
        table.append(cells)
    columns = ["photos", "count", "azimuth, median", "within 15 / 30", "balanced", "turned by more than 150"]
    columns += ["elevation", "outline IoU", "visible IoU", "trusted", "right"]
    return "\n".join(lines + table_lines(columns, table))


def _known(value: Any) -> Any:
    """Return a value for JSON, which has no NaN: None in its place."""
    return None if isinstance(value, float) and np.isnan(value) else value


def _cell(value: float, digits: int = 2) -> str:
    return "-" if np.isnan(value) else f"{value:.{digits}f}"
