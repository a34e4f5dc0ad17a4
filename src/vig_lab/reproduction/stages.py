"""What each stage of a run does. Every stage can be killed and begun again."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from vig.dataset import Dataset, read_dataset
from vig.dataset.format import complete_split, read_info
from vig.errors import UserError
from vig.files import atomic_write
from vig.inference import ExplainSettings, FitCalibration
from vig.inference.calibration import FILE
from vig.recognition import Recognizer, TrainingSettings
from vig.recognition.calibration import LEAST_IMAGES as LEAST
from vig.scene import ObjectClass
from vig_lab.ablation import ablation_markdown, run_ablations, variants
from vig_lab.calibration import calibrate_fits, describe, fits_of
from vig_lab.evaluation import MethodResult, markdown_table, save_table, summarise, write_csv
from vig_lab.evaluation import evaluate as run_methods
from vig_lab.evaluation.protocol import fitted
from vig_lab.evaluation.statistics import within
from vig_lab.figures import draw_figures as draw_all
from vig_lab.paper_network.recognizer import recognizer_of
from vig_lab.paper_network.training import PaperTrainingSettings, train_paper
from vig_lab.plots import calibrate_and_plot as calibrate_network
from vig_lab.plots import train_and_plot as train_network
from vig_lab.reproduction.comparison import comparison_block
from vig_lab.reproduction.folder import DATASETS, TIERS, RunFolder
from vig_lab.reproduction.scales import Settings
from vig_world.generation.progress import Meter
from vig_world.generation.show import contact_sheet
from vig_world.generation.write import make_dataset

LIMITS = {"table": (0.0, 0.75), "table_75_90": (0.75, 0.9)}
"""The tables of a tier, and how much of the object is hidden in the photos of each, at least and at most."""
SHEET = 48
"""Test photos that are shown of a tier."""
LEAST_BATCHES = 8
"""A small training set is trained on in smaller batches, so that an epoch has so many."""


@dataclass(frozen=True)
class Run:
    """A run: where it lies, what it is made of, and how it is carried out.

    cycles: whether the path-traced tier is wanted. workers: processes and threads; all cores by default. say:
    takes a line on what is done. progress: a bar on a terminal, a line now and then in a log.
    """

    folder: RunFolder
    settings: Settings
    cycles: bool = True
    workers: int | None = None
    say: Callable[[str], None] = print
    progress: bool = True

    @property
    def threads(self) -> int:
        """As many as there are to be workers."""
        return self.workers or os.cpu_count() or 1

    @cached_property
    def object_class(self) -> ObjectClass:
        """The paper's class."""
        return ObjectClass.load("teapot")

    def dataset_folder(self, name: str) -> Path:
        """Where one of `DATASETS` lies: the folder that the settings name, or the run's own."""
        return getattr(self.settings, name) or self.folder.data(name)

    def dataset(self, name: str) -> Dataset:
        """One of `DATASETS`. Raises UserError when it is not there, not complete or damaged."""
        return read_dataset(self.dataset_folder(name), DATASETS[name][0])

    def recognizer(self) -> Recognizer:
        """The run's recognition model. Raises UserError when it is not there or of no use."""
        return recognizer_of(self.object_class, self.folder.weights)

    def explain_settings(self) -> ExplainSettings:
        """How photos are fitted: calibrated as the run has learned, or as its weights came."""
        if self.folder.calibration.exists():
            return ExplainSettings(calibration=FitCalibration.load(self.folder.calibration))
        return ExplainSettings(calibrated=False)

    def tiers(self) -> tuple[str, ...]:
        """The tiers that are evaluated; says so when the path-traced one is left out.

        It is left out when it is not wanted, and when there is neither a Blender nor the finished photos.
        """
        if not self.cycles:
            self.say("the path-traced tier is left out, as --no-cycles asks")
            return ("raster",)
        try:
            complete_split(self.dataset_folder("test_cycles"), "test")
        except UserError:
            from vig_world.renderers.cycles.renderer import find_python

            try:
                find_python()
            except UserError as error:
                self.say(f"the path-traced tier is left out: {error}")
                return ("raster",)
        return tuple(TIERS)


def make_data(run: Run, name: str) -> None:
    """Make one of `DATASETS`, or look at the one that is to be used."""
    split, tier = DATASETS[name]
    folder = run.dataset_folder(name)
    if getattr(run.settings, name) is not None:
        info = read_info(folder)["splits"][complete_split(folder, split)]
        if info["tier"] != tier:
            raise UserError(
                f"expected {tier} photos in '{folder}'; got {info['tier']}. Name another dataset."
            )
        return
    counts = {
        "train": run.settings.train_images,
        "validation": run.settings.validation_images,
        "test_raster": run.settings.test_images,
        "test_cycles": run.settings.cycles_images,
    }
    # One seed for all: the splits' scenes differ all the same, and both tiers show the same scenes.
    make_dataset(
        folder,
        counts[name],
        run.settings.seed,
        tier,
        split,
        run.workers,
        run.progress,
        run.object_class,
    )


def train(run: Run) -> None:
    """Train the recognition model on the training photos."""
    dataset = run.dataset("train")
    chosen: dict[str, Any] = {"seed": run.settings.seed, "threads": run.threads}
    if run.settings.epochs is not None:
        chosen["epochs"] = run.settings.epochs
    batch = len(dataset) // LEAST_BATCHES
    if run.settings.net == "paper":
        paper = PaperTrainingSettings(**chosen)
        train_paper(dataset, run.folder.recognition, replace(paper, batch=min(paper.batch, batch)), run.say)
    else:
        own = TrainingSettings(**chosen)
        train_network(dataset, run.folder.recognition, replace(own, batch=min(own.batch, batch)), run.say)


def take_weights(run: Run) -> None:
    """Copy the weights that the settings name, and their calibration, so that the run keeps what made it."""
    weights = run.settings.weights
    assert weights is not None
    recognizer_of(run.object_class, weights)  # refuses what is of no use
    for path, kept in ((weights.with_name(FILE), run.folder.calibration), (weights, run.folder.weights)):
        if path.exists():
            with atomic_write(kept) as temporary:
                shutil.copyfile(path, temporary)


def calibrate(run: Run) -> None:
    """Make stated uncertainties hold on the validation photos: the network's, then those of the fits.

    The network's goes into its weights' file, the fits' into calibration.json beside it; too few photos teach
    nothing.
    """
    dataset = run.dataset("validation")
    if len(dataset) < LEAST:
        run.say(f"calibrate: {len(dataset)} photos are too few; uncertainties stay as they are stated")
        return
    if run.settings.net == "vig":  # the paper's nets state what was seen on held-out photos
        calibrate_network(run.folder.weights, [dataset], run.say)
    with Meter(fits_of(dataset), 0, run.progress, "fits") as meter:
        learned, lessons = calibrate_fits(
            [dataset],
            run.object_class,
            run.recognizer(),
            workers=run.threads,
            advance=meter.advance,
            cache=run.folder.fits("validation"),
            processes=True,
        )
    learned.save(run.folder.calibration)
    for line in describe(learned, lessons):
        run.say(f"calibrate: {line}")


def evaluate(run: Run, tier: str) -> None:
    """Run the methods over a tier's test photos: errors.csv, and a table for each of `LIMITS`."""
    dataset = run.dataset(TIERS[tier])
    results = _results(run, tier, dataset)
    folder = run.folder.tables(tier)
    write_csv(folder / "errors.csv", dataset, results)
    for name, (least, most) in LIMITS.items():
        if not within(dataset.occlusion, least, most).any():
            run.say(f"evaluate {tier}: no photo has {least:.0%} to {most:.0%} of the object hidden")
            continue
        table = summarise(results, dataset, tier, least, most, run.settings.seed)
        save_table(folder / f"{name}.json", table)
        with atomic_write(folder / f"{name}.md") as temporary:
            text = markdown_table(table)
            if name == "table":
                text = comparison_block(table).markdown() + "\n" + text
            temporary.write_text(text)


def ablate(run: Run) -> None:
    """Fit the first rasterised test photos with each part of the method switched off: ablations.json, .md."""
    dataset = run.dataset("test_raster").first(run.settings.ablation_images)
    settings = run.explain_settings()
    with Meter(len(variants(settings)) * len(dataset), 0, run.progress, "fits") as meter:
        table = run_ablations(
            dataset,
            run.object_class,
            run.recognizer(),
            run.folder.fits("ablations"),
            workers=run.threads,
            advance=meter.advance,
            settings=settings,
        )
    save_table(run.folder.ablations, table)
    with atomic_write(run.folder.ablations.with_suffix(".md")) as temporary:
        temporary.write_text(ablation_markdown(table))


def draw_figures(run: Run, tier: str) -> None:
    """Draw a tier's figures: photos, and what `vig_lab.figures` makes of the results."""
    dataset = run.dataset(TIERS[tier])
    results = _results(run, tier, dataset)
    folder = run.folder.figures(tier)
    contact_sheet(dataset, folder / "photos.png", SHEET)
    draw_all(dataset, run.object_class, run.recognizer(), results, tier, folder, run.explain_settings())


def _results(run: Run, tier: str, dataset: Dataset) -> dict[str, MethodResult]:
    """What the methods say of a tier's photos; fits that were made before are taken from their folder."""
    with Meter(len(dataset) * len(fitted(run.settings.methods)), 0, run.progress, "fits") as meter:
        return run_methods(
            dataset,
            run.object_class,
            run.recognizer(),
            run.settings.methods,
            run.explain_settings(),
            workers=run.threads,
            advance=meter.advance,
            cache=run.folder.fits(tier),
            processes=True,
        )
