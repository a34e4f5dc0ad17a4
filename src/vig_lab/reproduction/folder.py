"""Where things lie in the folder of a run."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vig.inference.calibration import FILE

DATASETS = {
    "train": ("train", "raster"),
    "validation": ("validation", "raster"),
    "test_raster": ("test", "raster"),
    "test_cycles": ("test", "cycles"),
}
"""The datasets of a run: split and tier of each."""

TIERS = {"raster": "test_raster", "cycles": "test_cycles"}
"""The tiers that are evaluated, and the dataset of each."""


@dataclass(frozen=True)
class RunFolder:
    """The paths of a run in the folder `root`; nothing of it needs to be there."""

    root: Path

    @property
    def record(self) -> Path:
        """Settings, machine, and what is done: `run.json`."""
        return self.root / "run.json"

    @property
    def page(self) -> Path:
        """The page that shows it all."""
        return self.root / "index.html"

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
        """What was learned of fits on the validation photos."""
        return self.recognition / FILE

    @property
    def ablations(self) -> Path:
        """The table of ablations."""
        return self.root / "tables" / "ablations.json"

    def read_table(self, tier: str, name: str = "table") -> dict[str, Any] | None:
        """One of a tier's tables, see `stages.LIMITS`; None when it is not there."""
        return read_json(self.tables(tier) / f"{name}.json")

    def data(self, name: str) -> Path:
        """Folder of a dataset that the run makes."""
        return self.root / "data" / name

    def fits(self, tier: str) -> Path:
        """Folder that keeps the fits of a tier's photos."""
        return self.root / "fits" / tier

    def tables(self, tier: str) -> Path:
        """Folder of a tier's tables."""
        return self.root / "tables" / tier

    def figures(self, tier: str) -> Path:
        """Folder of a tier's figures."""
        return self.root / "figures" / tier


def read_json(path: Path) -> dict[str, Any] | None:
    """A table of a run; None when it is not there."""
    return json.loads(path.read_text()) if path.exists() else None
