"""How far confidences in views hold on labelled photos.

    python -m benchmarks.confidence mug=PHOTOS PACK=PHOTOS ... [--find] [--tolerance 15]

PHOTOS is a folder with labels.json, see `vig class check`. Prints, for each folder and for all together, the
expected calibration error (ten bins, Naeini et al. 2015), and for each bin the photos in it, the mean
confidence stated, and the share of views right within the tolerance, which is what the confidence states.
"""

import argparse
from pathlib import Path

import numpy as np

from vig.scene import ObjectClass
from vig_train.cli.class_check import errors_on_photos, read_labels
from vig_train.cli.settings import CheckClass
from vig_train.evaluation.statistics import expected_calibration_error


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("photos", nargs="+", metavar="CLASS=PHOTOS")
    parser.add_argument("--find", action="store_true", help="without the labels' boxes")
    parser.add_argument("--tolerance", type=float, default=15.0)
    arguments = parser.parse_args()
    parts = []
    if wrong := [each for each in arguments.photos if "=" not in each]:
        parser.error(f"expected CLASS=PHOTOS; got '{wrong[0]}'")
    for name, folder in (each.split("=", 1) for each in arguments.photos):
        settings = CheckClass(name, Path(folder), find=arguments.find)
        labels = read_labels(settings.photos, settings.photos / "labels.json")
        errors = errors_on_photos(settings, ObjectClass.load(name), labels)
        errors = [each for each in errors if np.isfinite(each.confidence)]
        if not errors:
            parser.error(f"expected a class that was calibrated; '{name}' has no confidences")
        stated = np.array([each.confidence for each in errors])
        parts.append((stated, np.array([each.view_deg <= arguments.tolerance for each in errors])))
        print(f"{name} {folder}: {describe(*parts[-1])}", flush=True)
    stated, right = (np.concatenate(each) for each in zip(*parts, strict=True))
    print(f"all: {describe(stated, right)}\n\n| confidence | photos | stated | right |\n|---|---|---|---|")
    tenth = np.minimum(10 * stated, 9).astype(int)
    for number in np.unique(tenth):
        in_bin = tenth == number
        shown = f"{stated[in_bin].mean():.2f} | {right[in_bin].mean():.2f}"
        print(f"| {number / 10:.1f} | {in_bin.sum()} | {shown} |")


def describe(stated: np.ndarray, right: np.ndarray) -> str:
    """Return a line on confidences (N,) and whether these views are right (N,)."""
    error = expected_calibration_error(stated, right)
    return f"{len(stated)} photos, {stated.mean():.2f} stated, {right.mean():.2f} right, ECE {error:.3f}"


if __name__ == "__main__":
    main()
