"""What a run is made of, the three scales, and the paths in its folder."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from vig.inference.calibration import FILE
from vig.io.errors import UserError
from vig_paper import Network, Objects, Scale
from vig_train import METHODS, Method

DATASETS = {
    "train": ("train", "raster"),
    "validation": ("validation", "raster"),
    "test_raster": ("test", "raster"),
    "test_cycles": ("test", "cycles"),
}
"""The datasets of a run: split and renderer of each."""

RENDERERS = {"raster": "test_raster", "cycles": "test_cycles"}
"""The renderers whose test photos are evaluated, and the dataset of each."""

MIN_TRAINING_PHOTOS = 16
"""Fewest training photos: some of them are held out."""


@dataclass(frozen=True)
class ReproductionSettings:
    """What a run's numbers depend on: the same settings give the same tables.

    Raises:
        UserError: A number is out of range, or there are no methods.
    """

    scale: Scale
    train_images: int
    """Rasterised training photos."""
    epochs: int | None
    """Passes of the training, at most; None: as many as the network's training takes by default."""
    validation_images: int
    """Rasterised photos on which uncertainties are calibrated."""
    test_images: int
    """Rasterised test photos."""
    cycles_images: int
    """Path-traced test photos."""
    ablation_images: int
    """Rasterised test photos that are fitted once for each ablation."""
    seed: int = 0
    net: Network = "vig"
    objects: Objects = "designs"
    """What test and validation photos show: shapes N(0, 1) of the model as in the paper, or near designs that
    it was not made of."""
    methods: tuple[Method, ...] = METHODS
    weights: Path | None = None
    """Recognition weights to use in place of training."""
    train: Path | None = None
    """Folder of a dataset to use in place of making one, with its own count and seed; so are the next."""
    validation: Path | None = None
    test_raster: Path | None = None
    test_cycles: Path | None = None

    def __post_init__(self) -> None:
        minimums = {"train_images": MIN_TRAINING_PHOTOS, "epochs": 1, "seed": 0}
        minimums |= dict.fromkeys(("validation_images", "test_images", "cycles_images", "ablation_images"), 1)
        for name, smallest in minimums.items():
            value = getattr(self, name)
            if value is not None and value < smallest:
                option = "--" + name.replace("_", "-")
                raise UserError(f"expected {option} of at least {smallest}; got {value}")
        unknown = [method for method in self.methods if method not in METHODS]
        if unknown or not self.methods:
            got = ", ".join(unknown) or "none"
            raise UserError(f"expected methods among {', '.join(METHODS)}; got {got}")

    @staticmethod
    def of(scale: Scale, **chosen: Any) -> ReproductionSettings:
        """A scale's settings, replaced by those of `chosen` that are not None."""
        return replace(SCALES[scale], **{name: value for name, value in chosen.items() if value is not None})

    def to_json(self) -> dict[str, Any]:
        """Plain data: paths as strings."""
        plain = asdict(self) | {"methods": list(self.methods)}
        return {name: str(value) if isinstance(value, Path) else value for name, value in plain.items()}


SCALES: dict[Scale, ReproductionSettings] = {
    "tiny": ReproductionSettings("tiny", 200, 2, 50, 20, 6, 2),
    "small": ReproductionSettings("small", 6000, 12, 500, 200, 40, 50),
    "paper": ReproductionSettings("paper", 10000, None, 1000, 1000, 1000, 200),
}
"""tiny checks an installation, small takes an hour on two cores, paper has the paper's counts."""


@dataclass(frozen=True)
class RunFolder:
    """The paths of a run in the folder `root`; none of them needs to exist."""

    root: Path

    @property
    def record(self) -> Path:
        """Settings, machine, and which steps are done: `run.json`."""
        return self.root / "run.json"

    @property
    def page(self) -> Path:
        """The page of results."""
        return self.root / "index.html"

    @property
    def object_class(self) -> Path:
        """The class pack of the run's objects."""
        return self.root / "class"

    @property
    def recognition(self) -> Path:
        """Folder of the recognition model: weights, log and curve of its training."""
        return self.root / "recognition"

    @property
    def weights(self) -> Path:
        """The recognition model's weights."""
        return self.recognition / "recognition.safetensors"

    @property
    def calibration(self) -> Path:
        """The calibration of fits, learned on the validation photos."""
        return self.recognition / FILE

    @property
    def ablations(self) -> Path:
        """The table of ablations."""
        return self.root / "tables" / "ablations.json"

    def read_table(self, renderer: str, name: str = "table") -> dict[str, Any] | None:
        """One of a renderer's tables, see `work.OCCLUSION_LIMITS`; None when it does not exist."""
        return read_json(self.tables(renderer) / f"{name}.json")

    def data(self, name: str) -> Path:
        """Folder of a dataset that the run makes."""
        return self.root / "data" / name

    def fits(self, name: str) -> Path:
        """Folder that keeps the fits of a renderer's test photos, of "validation" or of "ablations"."""
        return self.root / "fits" / name

    def tables(self, renderer: str) -> Path:
        """Folder of a renderer's tables."""
        return self.root / "tables" / renderer

    def figures(self, renderer: str) -> Path:
        """Folder of a renderer's figures."""
        return self.root / "figures" / renderer


def read_json(path: Path) -> dict[str, Any] | None:
    """A table of a run; None when it does not exist."""
    return json.loads(path.read_text()) if path.exists() else None
