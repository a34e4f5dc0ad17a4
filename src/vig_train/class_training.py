"""A class's recognition network within a budget of minutes, from images of the studio to the card.

PACK/training keeps what each step leaves, so that a run that was stopped goes on, and a longer one begins
with the images of a shorter one.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from vig import __version__
from vig.inference import ExplainSettings, FitCalibration
from vig.inference.calibration import FILE as CALIBRATION_FILE
from vig.io.checks import decode, read_json, reading
from vig.io.files import atomic_write
from vig.io.machine import machine
from vig.io.progress import Meter
from vig.parallel import map_in_processes
from vig.recognition import Recognizer
from vig.recognition.network import Heads, shared_trunk
from vig.scene import ObjectClass
from vig_train.calibration import StudioPhotos, calibrate_fits, fit_count
from vig_train.calibration.studio_errors import studio_errors
from vig_train.plots import describe_calibration, plot_reliability
from vig_train.record import Record, read_record
from vig_train.training.calibration import learn_calibration, write_calibration
from vig_train.training.checkpoint import save_weights
from vig_train.training.class_network import (
    CHUNK,
    EPOCHS,
    PIXEL_CHUNKS,
    DecoderTraining,
    chunk_path,
    dense_step_count,
    draw_chunks,
    new_network,
    read_features,
    read_images,
    train_dense,
)
from vig_train.training.examples import Examples
from vig_train.training.studio import Studio
from vig_world.assets.source_meshes import meshes_fingerprint
from vig_world.dataset.spec import Split

WEIGHTS_FILE = "recognition.safetensors"
RELIABILITY_FILE = "reliability.png"
HEADING = "## Recognition"
"""Heading of the card's section on the network, which is replaced."""
QUICK = 0.0
"""Minutes of a training that stands for the quick recognizer of `vig class build`."""
QUICK_CHUNKS = 16
"""Files of images of the quick recognizer: 2,048 images, a minute of two cores."""
QUICK_DECODER_STEPS = 60
"""Steps of its mask's decoder, half a minute."""
QUICK_PHOTOS = 160
"""Photos on which the quick recognizer is calibrated; it is not tested."""
PHOTOS = 640
"""Photos of the studio to calibrate on, about half of them without the object."""
TEST_PHOTOS = 400
"""Photos, likewise, to measure errors on."""
FOLDS = 4
"""Of cross-validation: as many networks, each trained without every fourth mesh, calibrate and test."""
FOLD_EPOCHS = 10
"""Passes over the features for each of these."""
IMAGE_SHARE = 0.55
"""Of the time, for drawing images."""
DECODER_SHARE = 0.15
"""Of the time, for the mask's decoder. What is left is for the heads, the calibration and the test."""
MOST_CHUNKS = 480
"""61,440 images: their features take 2.7 GB of memory."""
CALIBRATION_SEED = 1
TEST_SEED = 2
STEPS = ("images", "heads", "calibration", "test")


@dataclass(frozen=True)
class Plan:
    """What fits into the time, fixed before the work, so that a run that goes on gives what it would have.

    Attributes:
        chunks: Files of images.
        decoder_steps: Of the mask's decoder.
        epochs: Of the heads.
    """

    chunks: int
    decoder_steps: int
    epochs: int = EPOCHS


@dataclass(frozen=True)
class _RunSettings:
    """Settings that must be the same when a training goes on; of shapes, meshes and trunk a hash."""

    minutes: float
    seed: int
    shapes: str
    meshes: str
    trunk: str

    def to_json(self) -> dict[str, Any]:
        return vars(self)


class ClassTraining:
    """The steps of a training, each done once.

    Args:
        pack: Folder of the class pack.
        minutes: All steps together, about; `QUICK` for a quick recognizer.
        seed: Of images and training.
        workers: Processes and threads; one per CPU by default.
        say: Is called with a line for each step.
    """

    def __init__(
        self,
        pack: Path,
        minutes: float,
        seed: int = 0,
        workers: int | None = None,
        say: Callable[[str], None] = lambda line: print(line, flush=True),
    ) -> None:
        self.pack, self.minutes, self.seed, self.say = Path(pack), minutes, seed, say
        self.object_class = ObjectClass.load(pack)
        self.workers = workers or os.cpu_count() or 1
        self.folder = self.pack / "training"
        self.images, self.run_folder = self.folder / "images", self.folder / "run"
        self.calibration_fits = self.folder / "calibration_fits"
        self.test_fits = self.folder / "test_fits"
        meshes = meshes_fingerprint(self.pack)
        settings = _RunSettings(minutes, seed, self.object_class.fingerprint, meshes, shared_trunk()[1])
        path = self.folder / "run.json"
        if path.exists():
            self._renew(Record(path, read_record(path)), settings)
        self.record = Record.open(path, settings, machine(), f"vig {__version__} class train")

    def _renew(self, record: Record, settings: _RunSettings) -> None:
        """Forget the results of an earlier run with other settings; images that are the same stay."""
        before, now = record.data["settings"], settings.to_json()
        changed = sorted(name for name, value in now.items() if before.get(name) != value)
        if not changed:
            return
        for folder in (self.run_folder, self.calibration_fits, self.test_fits):
            shutil.rmtree(folder, ignore_errors=True)
        if changed != ["minutes"]:
            shutil.rmtree(self.images, ignore_errors=True)
        record.renew(settings, list(STEPS))

    @property
    def quick(self) -> bool:
        """Whether this is the quick recognizer."""
        return self.minutes == QUICK

    def run(self) -> dict[str, Any]:
        """Do the steps that are not yet done and put what they made into the pack; return the errors."""
        work = {
            "images": self._draw,
            "heads": self._train,
            "calibration": self._calibrate,
            "test": self._test,
        }
        if self.quick:
            del work["test"]
        for number, (name, do) in enumerate(work.items(), 1):
            if self.record.complete(name):
                self.say(f"{number}/{len(work)} {name}: done in {self.record.seconds(name):.0f} s")
                continue
            self.say(f"{number}/{len(work)} {name}")
            with self.record.timed(name):
                do()
        return self._finish()

    # -- steps --------------------------------------------------------------------------------------------

    def plan(self) -> Plan:
        """What fits into the time; measured once, on the first images, which count."""
        if self.quick:
            return Plan(QUICK_CHUNKS, QUICK_DECODER_STEPS)
        path = self.run_folder / "plan.json"
        if path.exists():
            with reading(path, "the plan of a training", "Remove it."):
                return decode(Plan, read_json(path))
        budget = 60 * self.minutes
        there = 0
        while chunk_path(self.images, there).exists():
            there += 1
        # The first file of each process takes longer: it starts, and nothing is in its caches.
        warm, timed = there + self.workers, there + 3 * self.workers
        draw_chunks(self.object_class, self.images, range(warm), self.seed, self.workers)
        begin = time.perf_counter()
        draw_chunks(self.object_class, self.images, range(warm, timed), self.seed, self.workers)
        per_chunk = (time.perf_counter() - begin) / (timed - warm)
        with self._threads():
            examples = read_images(self.images, range(1))
            decoder = DecoderTraining(new_network(self.object_class), examples, True, self.seed)
            per_step = decoder.seconds_per_step()
        chunks = max(timed, min(MOST_CHUNKS, there + round(IMAGE_SHARE * budget / per_chunk)))
        plan = Plan(chunks, max(1, round(DECODER_SHARE * budget / per_step)))
        with atomic_write(path) as temporary:
            temporary.write_text(json.dumps(vars(plan)) + "\n")
        return plan

    @contextmanager
    def _threads(self) -> Iterator[None]:
        before = torch.get_num_threads()
        torch.set_num_threads(self.workers)
        try:
            yield
        finally:
            torch.set_num_threads(before)

    def _draw(self) -> None:
        chunks, models = range(self.plan().chunks), Studio(self.object_class).models.values()
        shown = sum(model.mesh is not None for model in models)
        self.say(f"drawn after {len(models) or 'no'} meshes, {shown or 'none'} with materials")
        with Meter(CHUNK * len(chunks), 0, unit="images") as meter:
            draw_chunks(self.object_class, self.images, chunks, self.seed, self.workers, meter.advance)

    @property
    def folds(self) -> int:
        """Of cross-validation; 1, none, where objects are drawn after fewer than two meshes or designs."""
        models = len(Studio(self.object_class).models)
        return 1 if models < 2 else min(FOLDS, models)

    def _weights(self, fold: int | None = None) -> Path:
        """Of the network, or of that of a fold."""
        return self.run_folder / (WEIGHTS_FILE if fold is None else f"fold-{fold}.safetensors")

    def _train(self) -> None:
        plan, symmetry, folds = self.plan(), self.object_class.symmetry, self.folds
        images = CHUNK * plan.chunks
        fold_epochs = min(FOLD_EPOCHS, plan.epochs) if folds > 1 else 0
        steps = dense_step_count(images, plan.epochs + fold_epochs * (folds - 1)) + plan.decoder_steps
        with self._threads(), Meter(steps, 0, unit="steps") as meter:
            features = read_features(self.images, range(plan.chunks))
            network = new_network(self.object_class)
            scale = train_dense(network, features, symmetry, self.seed, plan.epochs, meter.advance)
            for fold in range(folds) if folds > 1 else ():
                of_others = features[torch.nonzero(features.model % folds != fold)[:, 0]]
                part = new_network(self.object_class)
                scale_of_part = train_dense(part, of_others, symmetry, self.seed, fold_epochs, meter.advance)
                save_weights(part, scale_of_part, self._weights(fold), shared_trunk=True)
            del features
            examples = read_images(self.images, range(min(plan.chunks, PIXEL_CHUNKS)))
            decoder = DecoderTraining(network, examples, self.object_class.mirror, self.seed)
            decoder.run(plan.decoder_steps, self.run_folder / "checkpoint.safetensors", meter.advance)
        quick = {"quick": "yes"} if self.quick else {}
        save_weights(network, scale, self._weights(), shared_trunk=True, more=quick)

    def _recognizers(self) -> list[Recognizer]:
        """One for each fold, which has not seen its meshes; the network itself where there are no folds."""
        whole = Recognizer.of_class(self.object_class, self._weights())
        if self.folds == 1:
            return [whole]
        parts = [FoldRecognizer.of_class(self.object_class, self._weights(k)) for k in range(self.folds)]
        for part in parts:
            part.whole = whole
        return list(parts)

    def _photos(self, split: Split, count: int, seed: int) -> list[tuple[StudioPhotos, Examples]]:
        """Photos of each fold of the training's meshes, or of a split of held-out designs."""
        folds = self.folds if split == "train" else 1
        items = [(split, count // folds, seed, (k, folds) if folds > 1 else None) for k in range(folds)]
        drawn = map_in_processes(_photo_drawer, self.pack, items, min(self.workers, folds))
        return [
            (photos, Examples(**{name: torch.from_numpy(value) for name, value in arrays.items()}))
            for photos, arrays in drawn
        ]

    def _calibrate(self) -> None:
        drawn = self._photos("train", QUICK_PHOTOS if self.quick else PHOTOS, CALIBRATION_SEED)
        photos = [each for each, _ in drawn]
        parts = zip(self._recognizers(), (examples for _, examples in drawn), strict=True)
        result = learn_calibration(list(parts))
        self.say(describe_calibration(result))
        plot_reliability(self.run_folder / RELIABILITY_FILE, result)
        for path in [self._weights(), *(self._weights(k) for k in range(self.folds) if self.folds > 1)]:
            write_calibration(path, result.calibration)
        with Meter(sum(map(fit_count, photos)), 0, unit="fits") as meter:
            calibration, _ = calibrate_fits(
                photos,
                self.object_class,
                self._recognizers(),
                workers=self.workers,
                advance=meter.advance,
                cache=self.calibration_fits,
                processes=True,
            )
        calibration.save(self.run_folder / CALIBRATION_FILE)
        shutil.rmtree(self.calibration_fits, ignore_errors=True)

    def _test(self) -> None:
        held_out = self._held_out
        parts = self._photos("test" if held_out else "train", TEST_PHOTOS, TEST_SEED)
        recognizers = self._recognizers()
        if held_out:
            recognizers = [Recognizer.of_class(self.object_class, self._weights())]
        settings = ExplainSettings(calibration=FitCalibration.load(self.run_folder / CALIBRATION_FILE))
        with Meter(sum(len(photos) for photos, _ in parts), 0, unit="fits") as meter:
            errors = studio_errors(
                [(photos, recognizer) for (photos, _), recognizer in zip(parts, recognizers, strict=True)],
                self.object_class,
                settings,
                self.workers,
                meter.advance,
                self.test_fits,
            )
        shutil.rmtree(self.test_fits, ignore_errors=True)
        with atomic_write(self.run_folder / "test.json") as temporary:
            temporary.write_text(json.dumps(errors, indent=2) + "\n")

    @property
    def _held_out(self) -> bool:
        """Whether the pack has designs that are for the test alone."""
        description = json.loads((self.pack / "class.json").read_text())
        return any(design["split"] == "test" for design in description.get("held_out_designs", []))

    # -- the pack -----------------------------------------------------------------------------------------

    def _finish(self) -> dict[str, Any]:
        """Put weights, calibration and card into the pack."""
        for name in (WEIGHTS_FILE, RELIABILITY_FILE, CALIBRATION_FILE):
            with atomic_write(self.pack / name) as temporary:
                shutil.copyfile(self.run_folder / name, temporary)
        errors: dict[str, Any] = {}
        if not self.quick:
            with reading(self.run_folder / "test.json", "the errors of a training", "Train it again."):
                errors = decode(dict[str, Any], read_json(self.run_folder / "test.json"))
            self._add_to_history(errors)
        card = self.pack / "card.md"
        old = card.read_text(encoding="utf-8") if card.exists() else f"# Class {self.object_class.name}\n"
        section = self._section(errors)
        with atomic_write(card) as temporary:
            temporary.write_text(old.split(HEADING)[0].rstrip() + "\n\n" + section, encoding="utf-8")
        if not self.quick:
            self.say(section)
        return errors

    def _history(self) -> list[dict[str, Any]]:
        path = self.folder / "history.json"
        if not path.exists():
            return []
        with reading(path, "earlier trainings of a class", "Remove it."):
            return decode(list[dict[str, Any]], read_json(path))

    def _add_to_history(self, errors: dict[str, Any]) -> None:
        plan, row = self.plan(), errors["methods"]["fit"]
        entry = {
            "minutes": round(sum(self.record.seconds(step) for step in STEPS) / 60, 1),
            "images": CHUNK * plan.chunks,
            "trusted": errors["trusted"],
            **row,
        }
        earlier = [old for old in self._history() if old["images"] != entry["images"]]
        with atomic_write(self.folder / "history.json") as temporary:
            temporary.write_text(json.dumps([*earlier, entry], indent=1) + "\n")

    def _section(self, errors: dict[str, Any]) -> str:
        """The card's part on the network."""
        if self.quick:
            return "\n".join(
                [
                    HEADING,
                    "",
                    f"A quick recognizer, made by `vig class build` on {CHUNK * QUICK_CHUNKS} images of the"
                    f" studio. `vig class train {self.pack}` makes a better one in a quarter of an hour, and"
                    " measures it.",
                    "",
                ]
            )
        seconds = {name: self.record.seconds(name) for name in STEPS}
        unseen = "views, lights, surfaces and things before it that the training never saw"
        if self._held_out:
            unseen = f"meshes, {unseen}"
        elif self.folds > 1:
            unseen = (
                f"by {self.folds} networks trained as it was, each on meshes that it has not seen: {unseen}"
            )
        else:
            unseen += ", of the shapes that it was trained on"
        lines = [
            HEADING,
            "",
            f"Trained by `vig class train` on {CHUNK * self.plan().chunks} images of the studio in"
            f" {sum(seconds.values()) / 60:.0f} minutes on {self.workers} cores: {_listed(seconds)}.",
            "",
            f"Tested on {errors['photos']} images of the studio: {unseen}.",
            "",
            "| | azimuth, median | within 15 degrees | within 30 | turned by more than 150 |"
            " elevation, median | visible IoU, mean |",
            "|---|---|---|---|---|---|---|",
            *(f"| {name} | {_cells(row)} |" for name, row in errors["methods"].items()),
            "",
            f"Of the fits {errors['trusted']:.0%} are `trusted`"
            + (
                f", {errors['trusted_right']:.0%} of these within 15 degrees."
                if errors["trusted_right"] is not None
                else "."
            ),
            "",
        ]
        if len(history := self._history()) > 1:
            lines += [
                "| minutes | images | fits: azimuth, median | within 15 degrees | within 30 | turned |"
                " elevation | visible IoU |",
                "|---|---|---|---|---|---|---|---|",
                *(f"| {old['minutes']} | {old['images']} | {_cells(old)} |" for old in history),
                "",
            ]
        return "\n".join([*lines, "![reliability](reliability.png)", ""])


class FoldRecognizer(Recognizer):
    """A network of a fold, with the whole network's mask: a decoder is not trained for each fold."""

    whole: Recognizer

    def heads(self, pixels: torch.Tensor, twice: bool = True) -> Heads:
        """See `Recognizer.heads`."""
        return replace(super().heads(pixels, twice), mask=self.whole.heads(pixels, twice).mask)


def _photo_drawer(
    pack: Path,
) -> Callable[[tuple[Split, int, int, tuple[int, int] | None]], tuple[StudioPhotos, dict[str, np.ndarray]]]:
    """The work of a process: photos, and their examples as arrays."""
    object_class = ObjectClass.load(pack)

    def draw(
        item: tuple[Split, int, int, tuple[int, int] | None],
    ) -> tuple[StudioPhotos, dict[str, np.ndarray]]:
        photos, examples = StudioPhotos.draw(object_class, *item)
        return photos, {name: value.numpy() for name, value in vars(examples).items()}

    return draw


def _cells(row: dict[str, float]) -> str:
    azimuth = "- | - | - | -"
    if "azimuth_deg" in row:
        azimuth = (
            f"{row['azimuth_deg']:.1f} degrees | {row['within_15']:.0%} | {row['within_30']:.0%}"
            f" | {row['turned']:.0%}"
        )
    return f"{azimuth} | {row['elevation_deg']:.1f} degrees | {row['visible_iou']:.2f}"


def _listed(seconds: dict[str, float]) -> str:
    return ", ".join(f"{name} {math.ceil(value)} s" for name, value in seconds.items())
