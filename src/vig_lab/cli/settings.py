"""Settings of the experiments' verbs: a dataclass each, from which the command line is derived."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vig_lab.names import METHODS, STEP_KINDS, Method, Network, Scale, StepKind
from vig_world.names import Split


@dataclass(frozen=True)
class Demo:
    """Explain the packaged example photos and print truth beside estimate."""

    out: Path = Path("vig-demo")
    """Folder for the results."""
    no_open: bool = False
    """Do not open the page of results in a browser, where there is a screen."""
    json: bool = False
    """Print one JSON object instead of a table."""


@dataclass(frozen=True)
class Train:
    """Train a recognition network on datasets; continues where it was stopped."""

    dataset: tuple[Path, ...]
    """Folders of datasets with a train split."""
    out: Path
    """Folder for weights and checkpoint."""
    object_class: Annotated[str, tyro.conf.arg(name="class")] = "teapot"
    """A packaged class or the folder of a class pack: the datasets'."""
    start: Path | None = None
    """Weights to begin with, of an earlier training; by default only the packaged teapot's trunk."""
    studio: int = 24
    """Images that are drawn afresh for each step, beside 40 of the datasets; 0: these as they are."""
    level: float = 0.6
    """Share of these that are seen from about the horizon."""
    workers: int = 1
    """Processes that draw."""
    net: Network = "vig"
    """vig: one network for everything, with its uncertainty; paper: the paper's four, one for each factor."""
    epochs: int | None = None
    """Passes over the data: 18 by default; with --net paper at most, 150 by default, for each network."""
    seed: int = 0
    """Seed of initial weights, order and augmentation."""
    json: bool = False
    """Print one JSON object at the end."""


@dataclass(frozen=True)
class TrainClass:
    """Give a class pack its recognition weights: photos of the generator, training, calibration, errors on
    photos that none of it saw, the card. About two hours on two cores; continues where it was stopped. What
    it makes on the way lies in PACK/training, which can be removed when it is done."""

    pack: tyro.conf.Positional[Path]
    """Folder of the class pack."""
    images: int = 8000
    """Generated photos to train on."""
    epochs: int = 12
    """Passes over them."""
    studio: int = 40
    """Images that are drawn afresh for each step, beside 40 of these."""
    level: float = 0.35
    """Share of these that are seen from about the horizon."""
    photos: int = 400
    """Generated photos to calibrate on, and as many to measure errors on."""
    start: Path | None = None
    """Weights to begin with, where they fit; by default the packaged teapot's."""
    seed: int = 0
    """Of the photos and the training."""
    workers: int | None = None
    """Processes; one per CPU by default."""
    json: bool = False
    """Print one JSON object at the end."""


@dataclass(frozen=True)
class Calibrate:
    """Calibrate uncertainties and confidences of a network and of fits on photos that training never saw.
    Writes into the weights, and calibration.json and reliability.png beside them; a class pack's
    calibration.json is used by every fit."""

    datasets: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of datasets; for the fits each has the same weight, whatever its size."""
    weights: Path
    """The weights to calibrate; of a class pack, or a training run."""
    split: Literal["train", "validation"] = "validation"
    """Which split of them; test photos are not for calibration."""
    studio: int = 300
    """Photos that are drawn in the studio, of the split's designs, some without the object; 0: none."""
    seed: int = 1
    """Of these."""
    object_class: Annotated[str, tyro.conf.arg(name="class")] = "teapot"
    """A packaged class or the folder of a class pack."""
    workers: int | None = None
    """Fits at a time; one per CPU by default."""
    json: bool = False
    """Print one JSON object at the end."""


@dataclass(frozen=True)
class Evaluate:
    """Measure methods on a dataset: errors.csv per image, the paper's Table 1 as table.json and table.md.

    Safe to kill and run again: fits are kept in OUT/fits, 50 at a time. Those of other photos, weights or
    settings are made again; remove the folder after a change of the code.
    """

    dataset: Path
    """Folder of the dataset."""
    out: Path
    """Folder for the results."""
    split: Split = "test"
    """Which split."""
    methods: tuple[Method, ...] = METHODS
    """baseline: the training mean; rm: the recognition model; gaussian, robust, spatial: fits from it."""
    max_occlusion: float = 0.75
    """Only images with at most this share of the object hidden enter the table."""
    min_occlusion: float = 0.0
    """Only images with more than this share of the object hidden enter the table."""
    limit: int | None = None
    """Only the first so many images of the split."""
    figures: bool = False
    """Also draw the paper's Figures 3 to 5, failures, reliability and an animated fit."""
    object_class: Annotated[str, tyro.conf.arg(name="class")] = "teapot"
    """A packaged class or the folder of a class pack."""
    weights: Path | None = None
    """Recognition weights other than those of the class."""
    workers: int | None = None
    """Fits at a time; one per CPU by default."""
    cluster: str | None = None
    """Address of a Ray cluster that does the fits, in place of workers; auto: that of this machine."""
    json: bool = False
    """Print table.json instead of a table."""


@dataclass(frozen=True)
class Reproduce:
    """The paper's section 5: data, training, every method under both renderers, Table 1 beside the paper's,
    figures, ablations, and one page of results. Continues where it was stopped."""

    scale: Scale
    """How much: tiny takes minutes, small an hour on two cores, paper is 10,000 training and 1,000 test
    images of each renderer. The options below change single numbers of it."""
    out: Path
    """Folder of the run."""
    steps: Annotated[tuple[StepKind, ...], tyro.conf.arg(name="stages")] = STEP_KINDS
    """Which steps to do; those done already are skipped."""
    train_images: int | None = None
    """Rasterised photos to train on."""
    epochs: int | None = None
    """Passes of the training over them, at most; at the paper's scale as many as `vig train` does."""
    net: Network | None = None
    """The recognition model: vig's, or the paper's own."""
    weights: Path | None = None
    """Recognition weights to use in place of training."""
    validation_images: int | None = None
    """Rasterised photos on which uncertainties are calibrated."""
    test_images: int | None = None
    """Rasterised photos to test on."""
    cycles_images: int | None = None
    """Path-traced photos to test on."""
    ablation_images: int | None = None
    """Rasterised test photos that are fitted with each part of the method switched off."""
    methods: tuple[Method, ...] | None = None
    """Methods to compare; all by default."""
    seed: int | None = None
    """Of the data and the training; 0 by default."""
    train: Path | None = None
    """Folder of a dataset to train on, in place of making one."""
    validation: Path | None = None
    """Folder of a dataset with a validation split."""
    test_raster: Path | None = None
    """Folder of a rasterised dataset with a test split."""
    test_cycles: Path | None = None
    """Folder of a path-traced dataset with a test split."""
    no_cycles: bool = False
    """Leave path-traced photos out; the same command without this option adds them."""
    workers: int | None = None
    """Processes and threads; all cores by default."""
    json: bool = False
    """Print one JSON object at the end, and no progress."""
