"""`vig class check`: a class on the user's own labelled photos."""

import contextlib
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from scipy.stats import binomtest

from vig import Explainer
from vig.explanation import Explanation
from vig.inference.calibration import CONFIDENCE_FEATURES, FILE, FitCalibration
from vig.io.checks import decode, read_json, reading
from vig.io.errors import UserError
from vig.io.printing import end
from vig.io.progress import Meter
from vig.photo.masks import read_mask
from vig.scene import ObjectClass, angle_difference
from vig.scene.object_class import PACKAGED
from vig_train.calibration.learning import PRECISION, lowest_threshold
from vig_train.cli.common import check_ranges, check_writable
from vig_train.cli.settings import CheckClass
from vig_train.evaluation.metrics import segmentation_iou
from vig_train.evaluation.statistics import expected_calibration_error
from vig_train.packs.card import replace_section, table_lines

HEADING = "## On photographs"  # heading of the card's section, which is replaced
SIDE = 30.0  # degrees about azimuths 0 and 180 that count as views from the right and the left


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
    """Errors on one photo: degrees, IoU of the outline and visible pixels; NaN without a label. Its verdict,
    and the confidence that its view is right.
    """

    photo: str
    shape: str
    side: str
    azimuth_deg: float
    elevation_deg: float
    outline_iou: float
    visible_iou: float
    verdict: str
    features: np.ndarray = field(default_factory=lambda: np.zeros(len(CONFIDENCE_FEATURES)))
    confidence: float = np.nan

    @property
    def view_deg(self) -> float:
        """Return the error of the view: of its elevation where any turn looks the same."""
        return self.elevation_deg if np.isnan(self.azimuth_deg) else self.azimuth_deg


CheckRow = dict[str, Any]  # a row of the table, of N photos; None where nothing is known, as JSON has no NaN


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
    if settings.calibrate and (pack is None or not (pack / FILE).exists() or len(labels) < 30):
        raise UserError(
            "expected 30 labels or more, and a calibrated pack that is not vig's own; got"
            f" {len(labels)} labels and '{settings.pack}'. Copy a packaged class to calibrate it."
        )
    with contextlib.redirect_stdout(sys.stderr) if settings.json else contextlib.nullcontext():
        errors = errors_on_photos(settings, object_class, labels)
    if settings.calibrate and len(errors) < 30:
        raise UserError(
            f"expected 30 labelled photos or more that can be used; got {len(errors)}. Label more."
        )
    groups = sorted({error.shape for error in errors if error.shape})
    rows = [row_of("all", errors, settings.tolerance)]
    rows += [row_of(g, [e for e in errors if e.shape == g], settings.tolerance) for g in groups]
    table, changes = table_of(rows, settings), None
    if settings.calibrate and pack is not None:
        changes = recalibrate(pack / FILE, errors, settings.tolerance)
        table += f"\n\n{changes}"
    if pack is not None:
        replace_section(pack, object_class, f"{HEADING}\n\n{table}\n")
    if settings.json:
        print(json.dumps({"rows": rows, "folder": pack and str(pack), "calibration": changes}, indent=2))
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


def errors_on_photos(
    settings: CheckClass, object_class: ObjectClass, labels: Sequence[PhotoLabel]
) -> list[PhotoErrors]:
    """Return errors on each photo that can be used; others are named. UserError where there is none."""
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
        used = (number for number in range(len(labels)) if number not in skipped)
        for explanation, number in zip(explanations, used, strict=False):
            try:
                errors.append(errors_of(explanation, labels[number], settings.photos, object_class))
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
        outline = float(segmentation_iou((explanation.amodal | explanation.mask)[None], whole[None])[0])
    if seen is not None:
        seen_mask = _mask_of(folder, label, seen, explanation)
        visible = float(segmentation_iou(explanation.mask[None], seen_mask[None])[0])
    front = abs((label.azimuth_deg + 180) % 360 - 180)
    side = "right" if front <= SIDE else "left" if 180 - front <= SIDE else "other"
    return PhotoErrors(
        label.photo,
        label.shape,
        side,
        float(azimuth),
        abs(explanation.elevation_deg - label.elevation_deg),
        outline,
        visible,
        str(explanation.verdict),
        explanation.fit.confidence_features,
        explanation.confidence,
    )


def _mask_of(folder: Path, label: PhotoLabel, name: str, explanation: Explanation) -> np.ndarray:
    """Return a mask (H, W) bool of a label; UserError where it is not as large as the photo."""
    mask = read_mask(folder / name)
    if mask.shape != explanation.mask.shape:
        raise UserError(f"expected a mask as large as '{label.photo}'; got '{name}'.")
    return mask


def row_of(name: str, errors: Sequence[PhotoErrors], tolerance: float) -> CheckRow:
    """Return a row of the table."""
    columns: dict[str, Any] = {
        key: np.array([vars(error)[key] for error in errors]) for key in vars(errors[0])
    }
    azimuth, side = columns["azimuth_deg"], columns["side"]
    view = np.array([error.view_deg for error in errors])
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
        "calibration_error": expected_calibration_error(columns["confidence"], view <= 15),
    }


def recalibrate(path: Path, errors: Sequence[PhotoErrors], tolerance: float) -> str:
    """Set temperature and threshold of a calibration's confidence in views by photos; returns what changed.

    The temperature divides the log odds that a view is right (Guo et al. 2017); the threshold falls where the
    photos show that it may, and rises where too many trusted views are wrong. Intervals hold 90 %.
    """
    before, right = FitCalibration.load(path), np.array([each.view_deg <= tolerance for each in errors])
    groups = np.unique([each.shape or each.photo for each in errors], return_inverse=True)[1]

    def confidence(calibration: FitCalibration) -> np.ndarray:
        return np.array([calibration.confidence(each.features) for each in errors])

    temperatures, cooled, values = np.geomspace(0.2, 5.0, 129), [], []
    for each in temperatures:
        weights, bias = before.view_weights / each, before.view_bias / each
        cooled.append(replace(before, view_weights=weights, view_bias=bias))
        stated = confidence(cooled[-1]).clip(1e-6, 1 - 1e-6)
        # 0.3: deviation, a priori, of the log of the temperature about that of 1
        prior = 0.5 * (np.log(each) / 0.3) ** 2
        values.append(np.log(np.where(right, stated, 1 - stated)).sum() - prior)
    # 1.353: half of the 90 % quantile of chi squared with one degree of freedom
    best, likely = int(np.argmax(values)), temperatures[np.array(values) >= max(values) - 1.353]
    stated, threshold = confidence(cooled[best]), before.threshold
    lowest = lowest_threshold(stated, right, np.ones(len(right)), groups)
    trusted = stated >= threshold
    if lowest < threshold or (trusted.any() and _interval(right[trusted])[1] < PRECISION):
        threshold = lowest
    after = replace(cooled[best], threshold=threshold)
    after.save(path)
    words = f"Confidence in views, set by {len(right)} photos: temperature {temperatures[best]:.2f}"
    words += f" ({likely[0]:.2f} to {likely[-1]:.2f})"
    for name, calibration in (("before", before), ("now", after)):
        trusted = confidence(calibration) >= calibration.threshold
        words += f"; {name} trusted from {calibration.threshold:.2f}, {trusted.mean():.0%} of them"
        if trusted.any():
            low, high = _interval(right[trusted])
            words += f", of which right {right[trusted].mean():.0%} ({low:.0%} to {high:.0%})"
    return words + "."


def _interval(right: np.ndarray) -> tuple[float, float]:
    """Return the 90 % interval (Wilson 1927) of the share of N fits that are right (N,) bool."""
    low, high = binomtest(int(right.sum()), len(right)).proportion_ci(0.9, "wilson")
    return float(low), float(high)


def _median_known(values: np.ndarray) -> float | None:
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else None


def table_of(rows: Sequence[CheckRow], settings: CheckClass) -> str:
    """Return the table in Markdown, with a line of explanation."""
    lines = [
        f"Labelled photos, {'found by vig' if settings.find else 'with their boxes'}; a trusted view is right"
        f" within {settings.tolerance:g} degrees; balanced: views from right, left, elsewhere count alike;"
        " ECE: expected calibration error of the confidence that the azimuth is right to 15.",
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
        "ECE": ("{:.2f}", "calibration_error"),
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
