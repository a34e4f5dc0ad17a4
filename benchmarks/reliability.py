"""Confidences of views of several classes out of sample, and whether these views were right.

    python -m benchmarks.reliability teapot mug car/ fourleg/ [--out FILE]

A packaged class is fitted on photos of its validation designs, a pack of `vig class train` on photos
of its meshes, each by the member of the network that has not seen it. Prints, for each class, the precision
of the views that are trusted. The file, written with `--out`, is
`vig_train.calibration.learning.RELIABILITY_FILE`.
"""

import argparse
from pathlib import Path

import numpy as np
from safetensors.numpy import save_file

from vig.recognition import Recognizer
from vig.scene import ObjectClass
from vig_train.calibration.learning import MIN_THRESHOLD, CalibrationSamples, out_of_fold, pooled_threshold
from vig_train.calibration.samples import StudioPhotos, calibrate_fits
from vig_train.class_training.steps import CALIBRATION_SEED, FOLDS, PHOTOS
from vig_train.evaluation.fits import FitRun
from vig_train.training.class_heads import keep_member


def main() -> None:
    """Print a line for each class and write the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("packs", nargs="+")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    columns: dict[str, list[np.ndarray]] = {"confidence": [], "right": [], "weight": [], "model": []}
    for number, pack in enumerate(arguments.packs):
        samples = samples_of_pack(pack, arguments.workers)
        confidence, _, _ = out_of_fold(samples)
        threshold = pooled_threshold(confidence, samples.right, samples.weight, samples.model)
        trusted = confidence >= threshold
        print(
            f"{pack}: {len(trusted)} views, {samples.right.mean():.2f} right; from {threshold:.3f} on"
            f" {trusted.mean():.2f} are trusted, {samples.right[trusted].mean():.3f} of these right",
            flush=True,
        )
        used = confidence >= MIN_THRESHOLD  # lower ones change no threshold
        weight = np.full(len(used), 1 / len(used) / len(arguments.packs))
        rows = confidence, samples.right, weight, samples.model + 1000 * number
        for name, kind, row in zip(columns, (np.float32, np.uint8, np.float32, np.int16), rows, strict=True):
            columns[name].append(row[used].astype(kind))
    if arguments.out is not None:
        save_file({name: np.concatenate(rows) for name, rows in columns.items()}, arguments.out)


def samples_of_pack(pack: str, workers: int) -> CalibrationSamples:
    """Return the calibration samples of a packaged class or of one that `vig class train` made."""
    object_class = ObjectClass.load(pack)
    recognizer, run = Recognizer.of_class(object_class), FitRun(object_class, workers, processes=True)
    if not Path(pack).is_dir():
        photos = [StudioPhotos.draw(object_class, "validation", PHOTOS // 2, CALIBRATION_SEED)[0]]
        return calibrate_fits(photos, recognizer, run)[1]
    photos = [
        StudioPhotos.draw(
            object_class, "train", PHOTOS // FOLDS, CALIBRATION_SEED, (fold, FOLDS), things="validation"
        )[0]
        for fold in range(FOLDS)
    ]
    members = [keep_member(recognizer, fold) for fold in range(FOLDS)]
    return calibrate_fits(photos, members, run)[1]


if __name__ == "__main__":
    main()
