"""Photos by a rolled camera, turned upright as the network sees them, as `Explainer.explain` does.

    python -m benchmarks.rolled --dataset D [--split test] [--count 200] [--json FILE]
    python -m benchmarks.rolled --boxes boxes.json [--class NAME] [--json FILE]

Of the first `--count` photos of a dataset those with an elevation below 50 degrees are fitted: from above, a
roll equals a change of azimuth. Corners are filled with the mirrored photo.

With boxes, {photo: [x, y, w, h]}, of photos beside the file on which objects stand upright: how much of a
roll is left after windows were turned. A window that is itself turned sees a rolled photo.
"""

import argparse
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measuring import metric, report, write
from vig.inference import Verdict, explain
from vig.parallel import thread_count
from vig.photo import Window
from vig.photo.images import coded_photo
from vig.recognition import Recognizer
from vig.recognition.find import upright
from vig.scene import ObjectClass, layout_of_width, linear_from_srgb
from vig_train.calibration.samples import low_views, roll_photos
from vig_train.evaluation.metrics import angle_error_deg
from vig_train.evaluation.statistics import NEAR_DEG
from vig_world.dataset import Dataset, read_dataset

ANGLES = (0, 5, 10, 20, 30, 45, 90, 135, 180)


def main() -> None:
    """Fit, print a line for each angle, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    inputs = parser.add_mutually_exclusive_group(required=True)
    inputs.add_argument("--dataset", type=Path)
    inputs.add_argument("--boxes", type=Path, help="all of its photos, whatever --split and --count")
    parser.add_argument("--split", default="test")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--class", dest="object_class", default="teapot")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    object_class = ObjectClass.load(arguments.object_class)
    recognizer = Recognizer.of_class(object_class)
    if arguments.boxes:
        metrics = left_of_rolls(arguments.boxes, recognizer)
    else:
        dataset = read_dataset(arguments.dataset, arguments.split).first(arguments.count)
        metrics = wrong_views(dataset, object_class, recognizer)
    if arguments.json:
        write(report(metrics, threads=thread_count()), arguments.json)


def wrong_views(dataset: Dataset, object_class: ObjectClass, recognizer: Recognizer) -> list[dict[str, Any]]:
    """Fit, and print a line for each angle."""
    chosen = low_views(dataset)
    truth = dataset.latents[chosen, layout_of_width(dataset.latents.shape[1]).at("azimuth")]
    print(
        f"{len(chosen)} photos\n roll  trusted  within {NEAR_DEG:.0f} degrees of azimuth: all, of the trusted"
    )
    metrics = []
    for angle in ANGLES:
        images = roll_photos(dataset.images[chosen], np.full(len(chosen), angle))
        cut = [turned(linear_from_srgb(image.astype(np.float32) / 255), recognizer) for image in images]
        photos, known = (np.stack(column) for column in zip(*cut, strict=True))
        fits = list(explain(photos, object_class, recognizer, valid=known))
        azimuth = np.concatenate([fit.latents.azimuth for fit in fits])
        near = angle_error_deg(azimuth, truth) < NEAR_DEG
        trusted = np.array([fit.verdict is Verdict.TRUSTED for fit in fits])
        of_trusted = f"{near[trusted].mean():.1%}" if trusted.any() else "-"
        print(f"{angle:5d}  {trusted.mean():7.1%}  {near.mean():.1%}, {of_trusted}", flush=True)
        metrics.append(metric(f"wrongly_trusted_rolled_{angle}", [100 * (trusted & ~near).mean()], "%"))
    return metrics


def left_of_rolls(boxes: Path, recognizer: Recognizer) -> list[dict[str, Any]]:
    """Turn windows of real photos upright, and print a line for each angle."""
    objects = [
        (coded_photo(boxes.parent / name), Window.round_box(tuple(box)))
        for name, box in json.loads(boxes.read_text()).items()
    ]
    print(f"{len(objects)} photos\n roll  left, degrees: median  within {NEAR_DEG:.0f}")
    metrics = []
    for angle in (sign * size for size in ANGLES[:6] for sign in ((1, -1) if size else (1,))):
        turned_windows = (
            upright(photo, replace(window, roll=math.radians(angle)), recognizer) for photo, window in objects
        )
        left = np.degrees([abs(math.remainder(window.roll, math.tau)) for window in turned_windows])
        print(f"{angle:5d}  {np.median(left):21.1f}  {(left < NEAR_DEG).mean():.1%}", flush=True)
        metrics.append(metric(f"roll_left_{angle}", left.tolist(), "degrees"))
    return metrics


def turned(photo: np.ndarray, recognizer: Recognizer) -> tuple[np.ndarray, np.ndarray]:
    """A photo (S, S, 3) linear RGB as the network sees it upright, and where that is known (S, S) bool."""
    height, width = photo.shape[:2]
    return upright(photo, Window.of(width, height), recognizer).crop(photo)


if __name__ == "__main__":
    main()
