"""Settings of `vig reproduce`, from which its command line is derived."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from vig_paper import STEP_KINDS, Network, Objects, Scale, StepKind
from vig_train import Method


@dataclass(frozen=True)
class Reproduce:
    """The paper's section 5: data, training, every method under both renderers, Table 1 beside the paper's,
    figures, ablations, and one page of results. Continues where it was stopped."""

    scale: Scale
    """How much: tiny takes minutes, small an hour on two cores, paper is 10,000 training and 1,000 test
    images of each renderer. The options below change single numbers of it."""
    out: Path = Path("vig-reproduce")
    """Folder of the run."""
    steps: Annotated[tuple[StepKind, ...], tyro.conf.arg(name="stages")] = STEP_KINDS
    """Which steps to do; those done already are skipped."""
    train_images: int | None = None
    """Rasterised photos to train on."""
    epochs: int | None = None
    """Passes of the training over them, at most; at the paper's scale as many as `vig train` does."""
    net: Network | None = None
    """The recognition model: vig's, or the paper's own."""
    objects: Objects | None = None
    """What test photos show: `model`, shapes drawn from the shape model as in the paper; or `designs`, which
    the model was not made of, the default. Training photos show the model's."""
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
