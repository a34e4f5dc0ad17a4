"""The steps of a training, each done once.

PACK/training keeps the results of each step, so that a run that was stopped goes on, and a longer one begins
with the images of a shorter one.
"""

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vig import __version__
from vig.inference import ExplainSettings, FitCalibration
from vig.inference.calibration import FILE as CALIBRATION_FILE
from vig.io.checks import decode, read_json, reading
from vig.io.files import atomic_write, write_json
from vig.io.machine import machine
from vig.io.progress import Meter
from vig.parallel import map_in_processes, thread_limit
from vig.recognition import WEIGHTS_FILE, Recognizer
from vig.recognition.weights import shared_trunk
from vig.scene import ObjectClass
from vig.scene.object_class import BUILD_COMMAND
from vig_train.calibration.learning import describe
from vig_train.calibration.samples import StudioPhotos, calibrate_fits, fit_count, studio_errors
from vig_train.class_training import card
from vig_train.class_training.plan import (
    QUICK,
    QUICK_CHUNKS,
    QUICK_DECODER_STEPS,
    QUICK_PICTURES,
    Plan,
    measured_plan,
)
from vig_train.evaluation.fits import FitRun
from vig_train.packs.card import replace_section
from vig_train.plots import report_calibration
from vig_train.record import Record, read_record
from vig_train.training.calibration import learn_calibration, write_calibration
from vig_train.training.checkpoint import save_weights
from vig_train.training.class_heads import PACKED_MATRICES, HeadsTraining, keep_member
from vig_train.training.class_network import (
    CHUNK,
    PIXEL_CHUNKS,
    SIZES,
    ClassImages,
    DecoderTraining,
    new_network,
)
from vig_train.training.examples import Examples
from vig_train.training.object_map import MapTraining
from vig_world.assets.source_meshes import meshes_fingerprint
from vig_world.dataset.spec import SPLITS, Split
from vig_world.studio.cutouts import model_cutouts
from vig_world.studio.studio import Studio

RELIABILITY_FILE, TRUST_FILE = "reliability.png", "trust.txt"
PHOTOS = 960
"""Photos of the studio to calibrate on, a quarter of them without the object. From halves of 1,280, half of
these without it, the share of real cars that is trusted varied from 0 to .38."""
TEST_PHOTOS = 320  # photos of the studio to measure errors on
FOLDS = SIZES.members
"""Folds of cross-validation: each member is trained without every fourth mesh, and tested on it."""
CALIBRATION_SEED, TEST_SEED = 2**31 + 1, 2**31 + 2
"""Seeds of their images: larger than usual seeds of trainings, so that no image is in both."""
STEPS = {
    "images": "rendering the images that the network is trained on",
    "heads": "training the network",
    "calibration": "measuring on other images how far its answers can be trusted",
    "test": "measuring its errors on further images",
}
"""Names of the steps, and their descriptions."""


@dataclass(frozen=True)
class _RunSettings:
    """Settings that must be equal when a training is resumed; hashes of shapes, meshes, trunk and props."""

    minutes: float
    seed: int
    shapes: str
    meshes: str
    trunk: str
    props: str

    def to_json(self) -> dict[str, Any]:
        return vars(self)


class ClassTraining:
    """The steps of a training, each done once.

    Args:
        pack: Folder of the class pack.
        minutes: All steps together, about; `QUICK` for a quick recognizer.
        seed: Seed of images and training.
        workers: Processes and threads; one per CPU by default.
        say: Called with a line for each step.
        props: Models in files to put before and behind objects as well, see `mesh_folder`; none where empty.
    """

    def __init__(
        self,
        pack: Path,
        minutes: float,
        seed: int = 0,
        workers: int | None = None,
        say: Callable[[str], None] = lambda line: print(line, flush=True),
        props: str = "",
    ) -> None:
        self.pack, self.minutes, self.seed, self.say, self.props = Path(pack), minutes, seed, say, props
        self.object_class = ObjectClass.load(pack, unfinished=True)
        self.workers = workers or os.cpu_count() or 1
        self.folder = self.pack / "training"
        self.images = ClassImages(self.object_class, self.folder / "images", seed, self.workers, props)
        self.run_folder = self.folder / "run"
        self.calibration_fits = self.folder / "calibration_fits"
        self.test_fits = self.folder / "test_fits"
        meshes = meshes_fingerprint(self.pack)
        if props:
            say(f"reading the names of the models of {props}; catalogues are unpacked once, in some minutes")
        settings = _RunSettings(
            minutes,
            seed,
            self.object_class.fingerprint,
            meshes,
            shared_trunk()[1],
            self._props_fingerprint() if props else "",
        )
        path = self.folder / "run.json"
        if path.exists():
            self._renew(Record(path, read_record(path)), settings)
        self.record = Record.open(path, settings, machine(), f"vig {__version__} class train")

    def _props_fingerprint(self) -> str:
        """Return a hash of the models of the splits that are drawn; UserError where one has none."""
        return "".join(model_cutouts(self.props, of, self.object_class.name).fingerprint for of in SPLITS)

    def _renew(self, record: Record, settings: _RunSettings) -> None:
        """Forget the results of an earlier run with other settings; images that are the same stay."""
        before, now = record.data["settings"], settings.to_json()
        changed = sorted(name for name, value in now.items() if before.get(name) != value)
        if not changed:
            return
        for folder in (self.run_folder, self.calibration_fits, self.test_fits):
            shutil.rmtree(folder, ignore_errors=True)
        if changed != ["minutes"]:
            shutil.rmtree(self.images.folder, ignore_errors=True)
        record.renew(settings, list(STEPS))

    @property
    def quick(self) -> bool:
        """Return whether this is the quick recognizer."""
        return self.minutes == QUICK

    def run(self) -> dict[str, Any]:
        """Do the steps that are not yet done and put their results into the pack; return the errors."""
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
            self.say(f"{number}/{len(work)} {name}: {STEPS[name]} ...")
            with self.record.time_step(name):
                do()
        return self._finish()

    def _draw(self) -> None:
        chunks, models = range(self.plan().chunks), Studio(self.object_class).models.values()
        shown = sum(model.mesh is not None for model in models)
        self.say(f"they show {len(models) or 'no'} meshes, {shown or 'none'} of them with its materials")
        there = sum(self.images.path(chunk).exists() for chunk in chunks)
        with Meter(CHUNK * len(chunks), CHUNK * there, unit="images") as meter:
            self.images.draw(chunks, meter.advance)

    def plan(self) -> Plan:
        """Return the plan for the time; measured once, on the first images, which count."""
        if self.quick:
            return Plan(QUICK_CHUNKS, QUICK_DECODER_STEPS, QUICK_PICTURES)
        path = self.run_folder / "plan.json"
        if path.exists():
            with reading(path, "the plan of a training", "Remove it."):
                return decode(Plan, read_json(path))
        plan = measured_plan(self.images, self.minutes)
        write_json(path, vars(plan), None)
        return plan

    def _train(self) -> None:
        plan = self.plan()
        heads = HeadsTraining(self.images, plan.chunks, self.folds, self.run_folder, plan.epochs)
        steps = SIZES.members * heads.steps + plan.decoder_steps
        with thread_limit(self.workers), Meter(steps, 0, unit="steps") as meter:
            network = new_network(self.object_class)
            scale = heads.run(network, self.workers, meter.advance)
            examples = self.images.examples(range(min(plan.chunks, PIXEL_CHUNKS)))
            decoder = DecoderTraining(network, examples, self.object_class.mirror, self.seed)
            decoder.run(plan.decoder_steps, self.run_folder / "checkpoint.safetensors", meter.advance)
        with thread_limit(self.workers), Meter(plan.pictures, 0, unit="pictures") as meter:
            mirror = self.object_class.mirror
            MapTraining(examples, plan.pictures, self.seed, mirror, meter.advance).run(network)
        quick = {"quick": "yes"} if self.quick else {}
        save_weights(network, scale, self._weights, shared_trunk=True, more=quick, packed=PACKED_MATRICES)

    @property
    def folds(self) -> int:
        """Return the number of folds of cross-validation; 1, none, where the class was built from fewer
        than two meshes or designs.
        """
        models = len(Studio(self.object_class, refused=False).models)
        return 1 if models < 2 else min(FOLDS, models)

    @property
    def _weights(self) -> Path:
        return self.run_folder / WEIGHTS_FILE

    def _calibrate(self) -> None:
        count = 160 if self.quick else PHOTOS  # the quick recognizer is calibrated but not tested
        drawn = self._photos("train", count, CALIBRATION_SEED, "validation")
        photos = [each for each, _ in drawn]
        parts = zip(self._recognizers(), (examples for _, examples in drawn), strict=True)
        result = learn_calibration(list(parts))
        report_calibration(self._weights, result, self.say)
        write_calibration(self._weights, result.calibration)
        with Meter(sum(map(fit_count, photos)), 0, unit="fits") as meter:
            run = FitRun(self.object_class, self.workers, meter.advance, self.calibration_fits, True)
            calibration, samples = calibrate_fits(photos, self._recognizers(), run, pooled=True)
        calibration.save(self.run_folder / CALIBRATION_FILE)
        trust = describe(calibration, samples)[0]
        self.say(trust)
        (self.run_folder / TRUST_FILE).write_text(trust)
        shutil.rmtree(self.calibration_fits, ignore_errors=True)

    def _photos(
        self, split: Split, count: int, seed: int, things: Split
    ) -> list[tuple[StudioPhotos, Examples]]:
        """Return photos of each fold of the meshes, or of a split of held-out designs, no refused ones; with
        grounds and other things of a split.
        """
        folds = self.folds if split == "train" else 1
        items = [(split, count // folds, seed, (k, folds) if folds > 1 else None) for k in range(folds)]
        shared = (self.pack, self.props, things)
        drawn = map_in_processes(_photo_drawer, shared, items, min(self.workers, folds))
        return [(photos, Examples.of_arrays(arrays)) for photos, arrays in drawn]

    def _recognizers(self) -> list[Recognizer]:
        """Return the member of each fold, which has not seen its meshes; the whole without folds."""
        recognizers = [Recognizer.of_class(self.object_class, self._weights) for _ in range(self.folds)]
        if self.folds == 1:
            return recognizers
        return [keep_member(recognizer, number) for number, recognizer in enumerate(recognizers)]

    def _test(self) -> None:
        held_out = self._held_out
        parts = self._photos("test" if held_out else "train", TEST_PHOTOS, TEST_SEED, "test")
        recognizers = self._recognizers()
        if held_out:
            recognizers = [Recognizer.of_class(self.object_class, self._weights)]
        settings = ExplainSettings(calibration=FitCalibration.load(self.run_folder / CALIBRATION_FILE))
        photos = [each for each, _ in parts]
        with Meter(sum(map(len, photos)), 0, unit="fits") as meter:
            run = FitRun(self.object_class, self.workers, meter.advance, self.test_fits, processes=True)
            errors = studio_errors(list(zip(photos, recognizers, strict=True)), run, settings)
        shutil.rmtree(self.test_fits, ignore_errors=True)
        write_json(self.run_folder / "test.json", errors)

    @property
    def _held_out(self) -> bool:
        """Return whether the pack has designs that are for the test alone."""
        description = json.loads((self.pack / "class.json").read_text())
        return any(design["split"] == "test" for design in description.get("held_out_designs", []))

    def _finish(self) -> dict[str, Any]:
        """Put weights, calibration and card into the pack."""
        # Killed in between it leaves weights without a calibration, not with that of others.
        (self.pack / CALIBRATION_FILE).unlink(missing_ok=True)
        for name in (WEIGHTS_FILE, RELIABILITY_FILE, CALIBRATION_FILE):
            with atomic_write(self.pack / name) as temporary:
                shutil.copyfile(self.run_folder / name, temporary)
        (self.pack / BUILD_COMMAND).unlink(missing_ok=True)
        images = CHUNK * self.plan().chunks
        if self.quick:
            quick = card.quick_section(self.pack, images)
            replace_section(self.pack, self.object_class, quick)
            return {}
        with reading(self.run_folder / "test.json", "the errors of a training", "Train it again."):
            errors = decode(dict[str, Any], read_json(self.run_folder / "test.json"))
            trust = self.run_folder / TRUST_FILE
            errors["cross_validation"] = trust.read_text() if trust.exists() else "not measured"
        seconds, history = {step: self.record.seconds(step) for step in STEPS}, self.folder / "history.json"
        card.add_to_history(history, errors, images, seconds)
        unseen = card.unseen_in_test(self._held_out, self.folds)
        earlier = card.read_history(history)
        props = card.origins(self.props) if self.props else []
        section = card.section(errors, images, seconds, self.workers, unseen, earlier, props)
        replace_section(self.pack, self.object_class, section)
        self.say(section)
        return errors


def _photo_drawer(shared: tuple[Path, str, Split]) -> Callable[[Any], Any]:
    """Return the work of a process: photos, and their examples as arrays."""
    pack, props, things = shared
    object_class = ObjectClass.load(pack, unfinished=True)

    def draw(item: tuple[Split, int, int, tuple[int, int] | None]) -> tuple[StudioPhotos, dict[str, Any]]:
        photos, examples = StudioPhotos.draw(object_class, *item, props, things)
        return photos, examples.arrays()

    return draw
