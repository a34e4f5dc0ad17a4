"""The steps of a run. Each can be killed and begun again."""

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from vig.inference import ExplainSettings, FitCalibration
from vig.inference.calibration import FILE
from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig.io.progress import Meter
from vig.recognition import Recognizer
from vig.recognition.weights import TRUNK_FILE
from vig.scene import ObjectClass
from vig_paper.ablation import ablation_blocks, run_ablations, variants
from vig_paper.figures import draw_figures as draw_all_figures
from vig_paper.network.recognizer import recognizer_of
from vig_paper.network.training import PaperTrainingSettings, train_paper
from vig_paper.reproduction.folder import DATASETS, RENDERERS, RunFolder
from vig_paper.settings import ReproductionSettings
from vig_paper.teapot_class import copy_class
from vig_train.calibration.learning import describe
from vig_train.calibration.samples import calibrate_fits, fit_count
from vig_train.evaluation.fits import FitRun
from vig_train.evaluation.paper import comparison_block
from vig_train.evaluation.presentation import blocks, save_table
from vig_train.evaluation.protocol import evaluate as run_methods
from vig_train.evaluation.protocol import fitted_likelihoods
from vig_train.evaluation.results import MethodResult, write_csv
from vig_train.evaluation.statistics import within_occlusion
from vig_train.evaluation.table import summarise
from vig_train.plots import TrainingLog, report_calibration
from vig_train.training.calibration import MIN_IMAGES, calibrate_network
from vig_train.training.training import TrainingSettings
from vig_train.training.training import train as train_network
from vig_world.dataset import Dataset, read_dataset
from vig_world.dataset.format import complete_split, read_info
from vig_world.generation.show import contact_sheet
from vig_world.generation.write import make_dataset

OCCLUSION_LIMITS = {"table": (0.0, 0.75), "table_75_90": (0.75, 0.9)}
"""The tables of a renderer's photos: least and most of the object hidden in the photos of each."""


@dataclass(frozen=True)
class Run:
    """A run: its folder, its settings, and how it is carried out."""

    folder: RunFolder
    settings: ReproductionSettings
    cycles: bool = True
    """Evaluate on path-traced photos, too."""
    workers: int | None = None
    """Processes and threads; one per CPU by default."""
    report: Callable[[str], None] = print
    """Called with a line for each step."""
    progress: bool = True
    """A bar on a terminal, a line now and then in a log."""

    @property
    def threads(self) -> int:
        """Return the number of workers."""
        return self.workers or os.cpu_count() or 1

    @cached_property
    def object_class(self) -> ObjectClass:
        """Return the paper's class, copied into the run's folder."""
        if not (self.folder.object_class / "class.json").exists():
            copy_class(self.folder.object_class, self.settings.objects == "designs")
        return ObjectClass.load(self.folder.object_class)

    def dataset_folder(self, name: str) -> Path:
        """Return the folder of one of `DATASETS`: the one that the settings name, or the run's own."""
        return getattr(self.settings, name) or self.folder.data(name)

    def dataset(self, name: str) -> Dataset:
        """Return one of `DATASETS`. Raises UserError when it is missing, incomplete or damaged."""
        return read_dataset(self.dataset_folder(name), DATASETS[name][0]).at_network_size()

    def recognizer(self) -> Recognizer:
        """Return the run's recognition model. Raises UserError when its weights are missing or invalid."""
        return recognizer_of(self.object_class, self.folder.weights)

    def explain_settings(self) -> ExplainSettings:
        """Return how photos are fitted: with the run's calibration, or uncalibrated where it has none."""
        if self.folder.calibration.exists():
            return ExplainSettings(calibration=FitCalibration.load(self.folder.calibration))
        return ExplainSettings(calibrated=False)

    def renderers(self) -> tuple[str, ...]:
        """Return the renderers whose photos are evaluated; reports when path-traced photos are left out.

        They are left out when not requested, and when there is neither a Blender nor finished photos.
        """
        if not self.cycles:
            self.report("path-traced photos are left out, as --no-cycles asks")
            return ("raster",)
        try:
            complete_split(self.dataset_folder("test_cycles"), "test")
        except UserError:
            from vig_world.renderers.cycles.renderer import find_python

            try:
                find_python()
            except UserError as error:
                self.report(f"path-traced photos are left out: {error}")
                return ("raster",)
        return tuple(RENDERERS)


def make_data(run: Run, name: str) -> None:
    """Make one of `DATASETS`, or check the one that is to be used."""
    split, renderer, count = DATASETS[name]
    folder = run.dataset_folder(name)
    if getattr(run.settings, name) is not None:
        info = read_info(folder)["splits"][complete_split(folder, split)]
        if info["tier"] != renderer:
            raise UserError(
                f"expected {renderer} photos in '{folder}'; got {info['tier']}. Name another dataset."
            )
        if info["class_fingerprint"] != run.object_class.fingerprint:
            raise UserError(
                f"expected photos of class '{run.object_class.name}' in '{folder}'; got class"
                f" '{info['class']}'. Make them with --class {run.folder.object_class}."
            )
        return
    # One seed for all: the splits' scenes differ even so, and both renderers draw the same scenes.
    make_dataset(
        folder, run.settings.count(count), run.settings.seed, renderer, split, run.workers, run.progress,
        run.object_class, world="paper",
    )  # fmt: skip


def train(run: Run) -> None:
    """Train the recognition model on the training photos."""
    dataset = run.dataset("train")
    chosen: dict[str, Any] = {"seed": run.settings.seed, "threads": run.threads}
    if run.settings.epochs is not None:
        chosen["epochs"] = run.settings.epochs
    most = len(dataset) // 8  # in small training sets, so that an epoch has at least eight batches
    if run.settings.net == "paper":
        paper = PaperTrainingSettings(**chosen)
        paper = replace(paper, batch=min(paper.batch, most))
        train_paper(dataset, run.folder.recognition, paper, run.report)
    else:
        settings = TrainingSettings(**chosen, start=TRUNK_FILE, trunk_only=True)
        settings = replace(settings, batch=min(settings.batch, most))
        out = run.folder.recognition
        train_network([dataset], out, settings, run.report, TrainingLog(out).add)


def take_weights(run: Run) -> None:
    """Copy the weights that the settings name, and their calibration, into the run's folder."""
    weights = run.settings.weights
    assert weights is not None
    recognizer_of(run.object_class, weights)  # refuses invalid weights
    for path, copy in ((weights.with_name(FILE), run.folder.calibration), (weights, run.folder.weights)):
        if path.exists():
            with atomic_write(copy) as temporary:
                shutil.copyfile(path, temporary)


def calibrate(run: Run) -> None:
    """Calibrate uncertainties on the validation photos: the network's, then those of the fits.

    The network's are written into its weights' file, the fits' into calibration.json beside it. With fewer
    than `MIN_IMAGES` photos nothing is calibrated.
    """
    dataset = run.dataset("validation")
    if len(dataset) < MIN_IMAGES:
        run.report(f"calibrate: {len(dataset)} photos are too few; uncertainties stay as they are predicted")
        return
    if run.settings.net == "vig":  # the paper's networks predict their errors on held-out photos
        result = calibrate_network(run.folder.weights, [dataset])
        report_calibration(run.folder.weights, result, run.report)
    with Meter(fit_count(dataset), 0, run.progress, "fits") as meter:
        fits = FitRun(run.object_class, run.threads, meter.advance, run.folder.fits("validation"), True)
        # The standard camera, as the test photos are fitted.
        calibration, samples = calibrate_fits([dataset], run.recognizer(), fits, ExplainSettings())
    calibration.save(run.folder.calibration)
    for line in describe(calibration, samples):
        run.report(f"calibrate: {line}")


def evaluate(run: Run, renderer: str) -> None:
    """Run the methods over a renderer's test photos: errors.csv, a table for each of `OCCLUSION_LIMITS`."""
    dataset = run.dataset(RENDERERS[renderer])
    results = _results(run, renderer, dataset)
    folder = run.folder.tables(renderer)
    write_csv(folder / "errors.csv", dataset, results)
    for name, (least, most) in OCCLUSION_LIMITS.items():
        if not within_occlusion(dataset.occlusion, least, most).any():
            run.report(f"evaluate {renderer}: no photo has {least:.0%} to {most:.0%} of the object hidden")
            continue
        table = summarise(results, dataset, renderer, least, most, run.settings.seed)
        comparison = [comparison_block(table)] if name == "table" else []
        save_table(folder / f"{name}.json", table, comparison + blocks(table))


def ablate(run: Run) -> None:
    """Fit the first rasterised test photos with each part of the method switched off; write the tables."""
    dataset = run.dataset("test_raster").first(run.settings.count("ablation_images"))
    settings = run.explain_settings()
    with Meter(len(variants(settings)) * len(dataset), 0, run.progress, "fits") as meter:
        fits = FitRun(run.object_class, run.threads, meter.advance, run.folder.fits("ablations"))
        table = run_ablations(dataset, run.recognizer(), fits, settings=settings)
    save_table(run.folder.ablations, table, ablation_blocks(table))


def draw_figures(run: Run, renderer: str) -> None:
    """Draw the figures of a renderer's photos: a contact sheet, and those of `vig_paper.figures`."""
    dataset = run.dataset(RENDERERS[renderer])
    results = _results(run, renderer, dataset)
    folder = run.folder.figures(renderer)
    contact_sheet(dataset, folder / "photos.png", 48)
    draw_all_figures(dataset, run.object_class, results, renderer, folder)


def _results(run: Run, renderer: str, dataset: Dataset) -> dict[str, MethodResult]:
    """Return results of the methods on a renderer's photos; fits made before are read from their folder."""
    with Meter(
        len(dataset) * len(fitted_likelihoods(run.settings.methods)), 0, run.progress, "fits"
    ) as meter:
        fits = FitRun(run.object_class, run.threads, meter.advance, run.folder.fits(renderer), True)
        return run_methods(dataset, run.recognizer(), fits, run.settings.methods, run.explain_settings())
