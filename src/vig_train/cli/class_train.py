"""`vig class train`: recognition weights for a class pack, from photos to the card."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from vig import __version__
from vig.inference import ExplainSettings, FitCalibration
from vig.inference.calibration import FILE
from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig.io.machine import machine
from vig.io.progress import Meter
from vig.recognition import Recognizer
from vig.recognition.network import RecognitionNetwork
from vig.scene import ObjectClass, Symmetry
from vig.scene.object_class import PACKAGED
from vig_train.cli.calibrate import calibrate
from vig_train.cli.common import check_workers, check_writable
from vig_train.cli.settings import Calibrate, Train, TrainClass
from vig_train.cli.train import train
from vig_train.evaluation import evaluate as run_methods
from vig_train.evaluation.protocol import MASK_HEAD, fitted_likelihoods
from vig_train.evaluation.results import MethodResult
from vig_train.record import Record, read_record
from vig_train.training.calibration import MIN_IMAGES
from vig_train.training.training import TrainingSettings, load_start_weights
from vig_world.dataset import read_dataset
from vig_world.dataset.spec import Split
from vig_world.generation.show import contact_sheet
from vig_world.generation.write import make_dataset, remove_split

WEIGHTS_FILE, RELIABILITY_FILE = "recognition.safetensors", "reliability.png"
METHOD_NAMES = {"rm": "network", "spatial": "fit"}
"""What the card compares, and their names there."""
MASK_METHOD = {"rm": MASK_HEAD}
"""The method whose mask is reported, where it is not the method's own."""
HEADING = "## Recognition"
"""Heading of the card's section on the network, which is replaced."""
_PHOTO_SETTINGS, _TRAINING_SETTINGS = (
    {"photos", "seed", "shapes"},
    {"images", "epochs", "studio", "level", "seed", "start", "shapes"},
)
STEP_SETTINGS: dict[str, set[str]] = {
    "training photos": {"images", "seed", "shapes"},
    "validation photos": _PHOTO_SETTINGS,
    "test photos": _PHOTO_SETTINGS,
    "training": _TRAINING_SETTINGS,
    "calibration": _TRAINING_SETTINGS | _PHOTO_SETTINGS,
    "test": _TRAINING_SETTINGS | _PHOTO_SETTINGS,
}
"""The steps in order, and the settings that each depends on: a step is done again when one changes."""
SHEET_PHOTOS = 48
"""Photos of the contact sheet."""
STUDIO_SHARE = 1.25
"""Studio photos for the calibration per photo of the dataset; about half of them show the object."""
STUDIO_SHARE_OF_MISSING = 2.5
"""Further studio photos per photo that the dataset lacks of `MIN_IMAGES`."""


def train_class(settings: TrainClass) -> int:
    """`vig class train`."""
    if not settings.pack.is_dir():
        raise UserError(
            f"expected the folder of a class pack; got '{settings.pack}'. `vig class build` makes one."
        )
    object_class = ObjectClass.load(settings.pack)
    _check(settings)
    check_writable(settings.pack)
    with contextlib.redirect_stdout(sys.stderr) if settings.json else contextlib.nullcontext():
        training = ClassTraining(settings, object_class)
        errors = training.run()
    if settings.json:
        print(json.dumps({"folder": str(settings.pack), "steps": training.record.data["steps"]} | errors))
    else:
        print(settings.pack)
    return 0


def _check(settings: TrainClass) -> None:
    least = 2 * TrainingSettings.batch
    if settings.images < least:
        raise UserError(f"expected --images of at least {least}; got {settings.images}.")
    for name in ("epochs", "photos"):
        if getattr(settings, name) < 1:
            raise UserError(f"expected --{name} of at least 1; got {getattr(settings, name)}.")
    if settings.studio < 0 or settings.seed < 0:
        raise UserError("expected --studio and --seed of at least 0.")
    if not 0 <= settings.level <= 1:
        raise UserError(f"expected --level as a share from 0 to 1; got {settings.level:g}.")
    check_workers(settings.workers)
    if settings.start is not None:
        load_start_weights(RecognitionNetwork(TrainingSettings.network), settings.start, trunk_only=True)


@dataclass(frozen=True)
class _ClassTrainingSettings:
    """Settings that must be the same when a training resumes."""

    values: dict[str, Any]

    def to_json(self) -> dict[str, Any]:
        return self.values


class ClassTraining:
    """The steps of `vig class train`, each done once; PACK/training keeps what they leave.

    Args:
        settings: Of the verb.
        object_class: Of the pack.
    """

    def __init__(self, settings: TrainClass, object_class: ObjectClass) -> None:
        self.settings, self.object_class = settings, object_class
        self.folder = settings.pack / "training"
        self.weights = self.folder / "run" / WEIGHTS_FILE
        names = ("images", "epochs", "studio", "level", "photos", "seed")
        settings_now = {name: getattr(settings, name) for name in names} | {
            "shapes": object_class.fingerprint
        }
        settings_now["start"] = None if settings.start is None else str(settings.start)
        path = self.folder / "run.json"
        if path.exists():
            self._renew(Record(path, read_record(path)), settings_now)
        self.record = Record.open(
            path, _ClassTrainingSettings(settings_now), machine(), f"vig {__version__} class train"
        )

    def _renew(self, record: Record, settings_now: dict[str, Any]) -> None:
        """Remove the results of earlier steps that depend on settings that have changed."""
        before = record.data["settings"]
        changed = {
            name for name, value in settings_now.items() if name not in before or before[name] != value
        }
        stale = [step for step, names in STEP_SETTINGS.items() if names & changed]
        if not changed:
            return
        print(f"other {', '.join(sorted(changed))} than before; done anew: {', '.join(stale)}", flush=True)
        record.forget(stale)
        for step in stale:
            split, photos, _ = step.partition(" photos")
            if photos:
                remove_split(self.folder / "photos", {"training": "train"}.get(split, split))
        if "training" in stale:
            shutil.rmtree(self.weights.parent, ignore_errors=True)
        record.renew(_ClassTrainingSettings(settings_now), stale)

    def run(self) -> dict[str, Any]:
        """Do the steps that are not yet done; return the errors on the test photos."""
        steps: list[Callable[[], object]] = [
            partial(self._photos, "train", self.settings.images),
            partial(self._photos, "validation", self.settings.photos),
            partial(self._photos, "test", self.settings.photos),
            self._train,
            self._calibrate,
            self._test,
        ]
        for number, (name, work) in enumerate(zip(STEP_SETTINGS, steps, strict=True), 1):
            if self.record.complete(name):
                print(f"{number}/{len(steps)} {name}: done in {self.record.seconds(name) / 60:.1f} min")
                continue
            print(f"{number}/{len(steps)} {name}", flush=True)
            with self.record.timed(name):
                work()
        return self._finish()

    def _photos(self, split: Split, count: int) -> None:
        make_dataset(
            self.folder / "photos",
            count,
            self.settings.seed,
            split=split,
            workers=self.settings.workers,
            object_class=self.object_class,
            photo=True,
        )

    def _train(self) -> None:
        settings = self.settings
        train(
            Train(
                (self.folder / "photos",),
                self.weights.parent,
                str(settings.pack),
                settings.start or PACKAGED / "teapot" / WEIGHTS_FILE,
                settings.studio,
                settings.level,
                max(1, (settings.workers or os.cpu_count() or 1) // 2),
                epochs=settings.epochs,
                seed=settings.seed,
            )
        )

    def _calibrate(self) -> None:
        photos = self.settings.photos
        lacking = max(0, MIN_IMAGES - photos)
        calibrate(
            Calibrate(
                (self.folder / "photos",),
                self.weights,
                studio=round(STUDIO_SHARE * photos + STUDIO_SHARE_OF_MISSING * lacking),
                object_class=str(self.settings.pack),
                workers=self.settings.workers,
            )
        )

    def _test(self) -> None:
        dataset = read_dataset(self.folder / "photos", "test")
        calibration = FitCalibration.load(self.weights.with_name(FILE))
        with Meter(len(dataset) * len(fitted_likelihoods(METHOD_NAMES)), 0, unit="fits") as meter:
            results = run_methods(
                dataset,
                self.object_class,
                Recognizer.of_class(self.object_class, self.weights),
                tuple(METHOD_NAMES),
                ExplainSettings(calibration=calibration),
                workers=self.settings.workers,
                advance=meter.advance,
                cache=self.folder / "fits",
                processes=True,
            )
        with atomic_write(self.folder / "test.json") as temporary:
            temporary.write_text(json.dumps(summary(results, self.object_class), indent=2) + "\n")
        contact_sheet(read_dataset(self.folder / "photos", "train"), self.folder / "photos.png", SHEET_PHOTOS)

    def _finish(self) -> dict[str, Any]:
        """Put weights, calibration and card into the pack."""
        pack, run = self.settings.pack, self.weights.parent
        errors: dict[str, Any] = json.loads((self.folder / "test.json").read_text())
        pictures = {self.folder / "photos.png": pack / "build" / "8-photos.png"}
        for name in (WEIGHTS_FILE, RELIABILITY_FILE, FILE):
            pictures[run / name] = pack / name
        for source, target in pictures.items():
            with atomic_write(target) as temporary:
                shutil.copyfile(source, temporary)
        card = pack / "card.md"
        old_card = (
            card.read_text(encoding="utf-8") if card.exists() else f"# Class {self.object_class.name}\n"
        )
        text = old_card.split(HEADING)[0].rstrip() + "\n\n" + self._section(errors)
        with atomic_write(card) as temporary:
            temporary.write_text(text, encoding="utf-8")
        print(text[text.index(HEADING) :])
        return errors

    def _section(self, errors: dict[str, Any]) -> str:
        """The card's part on the network."""
        settings = self.settings
        minutes = {name: self.record.seconds(name) / 60 for name in self.record.data["steps"]}
        unseen = "rooms, lights and views that the training never saw"
        if "test" in self._held_out():
            unseen = f"meshes, {unseen}"
        else:
            unseen += ", of shapes of the pack's own model (of ten meshes or more some are held out)"
        lines = [
            HEADING,
            "",
            f"Trained by `vig class train` on {settings.images} generated photos, {settings.epochs} times,"
            f" {settings.studio} images of the studio beside each 40 of them, in {sum(minutes.values()):.0f}"
            f" minutes on {os.cpu_count()} cores ({minutes.get('training', 0):.0f} of them the training).",
            "",
            f"Tested on {errors['photos']} generated photos: {unseen}.",
            "",
            "| | azimuth, median | within 15 degrees | within 30 | elevation, median | visible IoU, mean |",
            "|---|---|---|---|---|---|",
        ]
        for name, row in errors["methods"].items():
            azimuth = "- | - | -"
            if "azimuth_deg" in row:
                azimuth = (
                    f"{row['azimuth_deg']:.1f} degrees | {row['within_15']:.0%} | {row['within_30']:.0%}"
                )
            lines.append(
                f"| {name} | {azimuth} | {row['elevation_deg']:.1f} degrees | {row['visible_iou']:.2f} |"
            )
        lines += [
            "",
            f"Of the fits {errors['trusted']:.0%} are `trusted`"
            + (
                f", {errors['trusted_right']:.0%} of these within 15 degrees."
                if errors["trusted_right"] is not None
                else "."
            ),
            "",
            *self._last_third_gain(),
            "",
            "![training photos](build/8-photos.png)",
            "",
            "![reliability](reliability.png)",
            "",
        ]
        return "\n".join(lines)

    def _held_out(self) -> set[str]:
        designs = json.loads((self.settings.pack / "class.json").read_text()).get("held_out_designs", [])
        return {design["split"] for design in designs}

    def _last_third_gain(self) -> list[str]:
        """One line on what the last third of the training improved on the held-out rooms."""
        with open(self.weights.parent / "log.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        if len(rows) == 1:
            return ["One epoch says nothing on what more would bring."]
        earlier, final = rows[max(0, len(rows) - 1 - max(1, len(rows) // 3))], rows[-1]
        iou = f"the mask's IoU rose from {float(earlier['mask_iou']):.3f} to {float(final['mask_iou']):.3f}"
        view_change = ""
        if self.object_class.symmetry is not Symmetry.ANY_TURN:
            view_change = (
                f" views more than 30 degrees off went from {float(earlier['wrong_view']):.1%} to"
                f" {float(final['wrong_view']):.1%},"
            )
        return [
            f"Between epochs {earlier['epoch']} and {final['epoch']},{view_change} {iou}. The schedule ends"
            " there: for better weights take more `--images` and `--epochs`, and more meshes."
        ]


def summary(results: dict[str, MethodResult], object_class: ObjectClass) -> dict[str, Any]:
    """Errors of the methods of `METHOD_NAMES`, and the precision of the verdict "trusted"."""
    methods: dict[str, dict[str, float]] = {}
    for method, name in METHOD_NAMES.items():
        errors = results[method].errors
        row = {
            "elevation_deg": float(np.median(errors["elevation_deg"])),
            "visible_iou": float(results[MASK_METHOD.get(method, method)].errors["segmentation_iou"].mean()),
        }
        if object_class.symmetry is not Symmetry.ANY_TURN:
            azimuth = errors["azimuth_deg"]
            row["azimuth_deg"] = float(np.median(azimuth))
            row |= {f"within_{most}": float((azimuth <= most).mean()) for most in (15, 30)}
        methods[name] = row
    fits = results["spatial"]
    trusted = np.array([verdict == "trusted" for verdict in fits.verdicts])
    # Where any turn looks the same, the view is the elevation.
    view = "elevation_deg" if object_class.symmetry is Symmetry.ANY_TURN else "azimuth_deg"
    right = fits.errors[view][trusted] <= 15
    return {
        "photos": len(trusted),
        "methods": methods,
        "trusted": float(trusted.mean()),
        "trusted_right": float(right.mean()) if trusted.any() else None,
    }
