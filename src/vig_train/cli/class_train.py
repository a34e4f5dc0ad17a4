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
from vig.recognition import Recognizer
from vig.recognition.network import RecognitionNetwork
from vig.scene import ObjectClass, Symmetry
from vig.scene.object_class import PACKAGED
from vig_train.cli.calibrate import calibrate
from vig_train.cli.common import check_workers, check_writable
from vig_train.cli.settings import Calibrate, Train, TrainClass
from vig_train.cli.train import train
from vig_train.evaluation import evaluate as run_methods
from vig_train.evaluation.protocol import MASK_HEAD, fitted
from vig_train.evaluation.results import MethodResult
from vig_train.record import Record, read_record
from vig_train.training.calibration import LEAST_IMAGES
from vig_train.training.training import TrainingSettings, begin_with
from vig_world.dataset import read_dataset
from vig_world.dataset.spec import Split
from vig_world.generation.progress import Meter
from vig_world.generation.show import contact_sheet
from vig_world.generation.write import make_dataset, remove_split

WEIGHTS, RELIABILITY = "recognition.safetensors", "reliability.png"
METHODS = {"rm": "network", "spatial": "fit"}
"""What the card compares, and their names there."""
SEEN_BY = {"rm": MASK_HEAD}
"""Where what is seen of the object is a result of its own."""
HEADING = "## Recognition"
"""Of the card's part on the network: what follows it is written anew."""
_PHOTOS, _TRAINING = (
    {"photos", "seed", "shapes"},
    {"images", "epochs", "studio", "level", "seed", "start", "shapes"},
)
DEPENDS: dict[str, set[str]] = {
    "training photos": {"images", "seed", "shapes"},
    "validation photos": _PHOTOS,
    "test photos": _PHOTOS,
    "training": _TRAINING,
    "calibration": _TRAINING | _PHOTOS,
    "test": _TRAINING | _PHOTOS,
}
"""The steps, and the settings that each depends on: with others it is done anew."""
SHEET = 48
STUDIO_SHARE, STUDIO_LACKING = 1.25, 2.5
"""Photos of the studio for the calibration, over those of the dataset, and over those that these lack of
`LEAST_IMAGES`: about half of them show the object."""


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
        found = training.run()
    if settings.json:
        print(json.dumps({"folder": str(settings.pack), "steps": training.record.data["steps"]} | found))
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
        begin_with(RecognitionNetwork(TrainingSettings.network), settings.start, trunk_only=True)


@dataclass(frozen=True)
class _Settings:
    """What a training begun must be gone on with."""

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
        self.weights = self.folder / "run" / WEIGHTS
        names = ("images", "epochs", "studio", "level", "photos", "seed")
        wanted = {name: getattr(settings, name) for name in names} | {"shapes": object_class.fingerprint}
        wanted["start"] = None if settings.start is None else str(settings.start)
        path = self.folder / "run.json"
        if path.exists():
            self._renew(Record(path, read_record(path)), wanted)
        self.record = Record.open(path, _Settings(wanted), machine(), f"vig {__version__} class train")

    def _renew(self, record: Record, wanted: dict[str, Any]) -> None:
        """Remove what a training with other settings made, but for the steps that do not depend on these."""
        before = record.data["settings"]
        changed = {name for name, value in wanted.items() if name not in before or before[name] != value}
        stale = [step for step, names in DEPENDS.items() if names & changed]
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
        record.renew(_Settings(wanted), stale)

    def run(self) -> dict[str, Any]:
        """Do what is not yet done; returns the errors on the test photos."""
        steps: list[Callable[[], object]] = [
            partial(self._photos, "train", self.settings.images),
            partial(self._photos, "validation", self.settings.photos),
            partial(self._photos, "test", self.settings.photos),
            self._train,
            self._calibrate,
            self._test,
        ]
        for number, (name, work) in enumerate(zip(DEPENDS, steps, strict=True), 1):
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
                settings.start or PACKAGED / "teapot" / WEIGHTS,
                settings.studio,
                settings.level,
                max(1, (settings.workers or os.cpu_count() or 1) // 2),
                epochs=settings.epochs,
                seed=settings.seed,
            )
        )

    def _calibrate(self) -> None:
        photos = self.settings.photos
        lacking = max(0, LEAST_IMAGES - photos)
        calibrate(
            Calibrate(
                (self.folder / "photos",),
                self.weights,
                studio=round(STUDIO_SHARE * photos + STUDIO_LACKING * lacking),
                object_class=str(self.settings.pack),
                workers=self.settings.workers,
            )
        )

    def _test(self) -> None:
        dataset = read_dataset(self.folder / "photos", "test")
        calibration = FitCalibration.load(self.weights.with_name(FILE))
        with Meter(len(dataset) * len(fitted(METHODS)), 0, unit="fits") as meter:
            results = run_methods(
                dataset,
                self.object_class,
                Recognizer.of_class(self.object_class, self.weights),
                tuple(METHODS),
                ExplainSettings(calibration=calibration),
                workers=self.settings.workers,
                advance=meter.advance,
                cache=self.folder / "fits",
                processes=True,
            )
        with atomic_write(self.folder / "test.json") as temporary:
            temporary.write_text(json.dumps(summary(results, self.object_class), indent=2) + "\n")
        contact_sheet(read_dataset(self.folder / "photos", "train"), self.folder / "photos.png", SHEET)

    def _finish(self) -> dict[str, Any]:
        """Put weights, calibration and card into the pack."""
        pack, run = self.settings.pack, self.weights.parent
        found: dict[str, Any] = json.loads((self.folder / "test.json").read_text())
        pictures = {self.folder / "photos.png": pack / "build" / "8-photos.png"}
        for name in (WEIGHTS, RELIABILITY, FILE):
            pictures[run / name] = pack / name
        for source, target in pictures.items():
            with atomic_write(target) as temporary:
                shutil.copyfile(source, temporary)
        card = pack / "card.md"
        before = card.read_text(encoding="utf-8") if card.exists() else f"# Class {self.object_class.name}\n"
        text = before.split(HEADING)[0].rstrip() + "\n\n" + self._section(found)
        with atomic_write(card) as temporary:
            temporary.write_text(text, encoding="utf-8")
        print(text[text.index(HEADING) :])
        return found

    def _section(self, found: dict[str, Any]) -> str:
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
            f"Tested on {found['photos']} generated photos: {unseen}.",
            "",
            "| | azimuth, median | within 15 degrees | within 30 | elevation, median | visible IoU, mean |",
            "|---|---|---|---|---|---|",
        ]
        for name, row in found["methods"].items():
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
            f"Of the fits {found['trusted']:.0%} are `trusted`"
            + (
                f", {found['trusted_right']:.0%} of these within 15 degrees."
                if found["trusted_right"] is not None
                else "."
            ),
            "",
            *self._what_more_brings(),
            "",
            "![training photos](build/8-photos.png)",
            "",
            "![reliability](reliability.png)",
            "",
        ]
        return "\n".join(lines)

    def _held_out(self) -> set[str]:
        designs = json.loads((self.settings.pack / "class.json").read_text()).get("held_out_designs", [])
        return {each["split"] for each in designs}

    def _what_more_brings(self) -> list[str]:
        """What the last third of the training brought on the rooms held out of it."""
        with open(self.weights.parent / "log.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        if len(rows) == 1:
            return ["One epoch says nothing on what more would bring."]
        before, last = rows[max(0, len(rows) - 1 - max(1, len(rows) // 3))], rows[-1]
        iou = f"the mask's IoU rose from {float(before['mask_iou']):.3f} to {float(last['mask_iou']):.3f}"
        lost = ""
        if self.object_class.symmetry is not Symmetry.ANY_TURN:
            lost = (
                f" views more than 30 degrees off went from {float(before['wrong_view']):.1%} to"
                f" {float(last['wrong_view']):.1%},"
            )
        return [
            f"Between epochs {before['epoch']} and {last['epoch']},{lost} {iou}. The schedule ends there: for"
            " better weights take more `--images` and `--epochs`, and more meshes."
        ]


def summary(results: dict[str, MethodResult], object_class: ObjectClass) -> dict[str, Any]:
    """Errors of the methods of `METHODS`, and what the verdicts are worth."""
    methods: dict[str, dict[str, float]] = {}
    for method, name in METHODS.items():
        errors = results[method].errors
        row = {
            "elevation_deg": float(np.median(errors["elevation_deg"])),
            "visible_iou": float(results[SEEN_BY.get(method, method)].errors["segmentation_iou"].mean()),
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
