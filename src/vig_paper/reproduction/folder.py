"""The datasets of a run, and the paths in its folder."""

import json
from pathlib import Path
from typing import Any

from vig.inference.calibration import FILE

DATASETS = {
    "train": ("train", "raster", "train_images"),
    "validation": ("validation", "raster", "validation_images"),
    "test_raster": ("test", "raster", "test_images"),
    "test_cycles": ("test", "cycles", "cycles_images"),
}
"""The datasets of a run: split, renderer, and the setting that has the number of its photos."""

RENDERERS = {"raster": "test_raster", "cycles": "test_cycles"}
"""The renderers whose test photos are evaluated, and the dataset of each."""


class RunFolder:
    """The paths of a run in the folder `root`; none of them needs to exist.

    Attributes:
        record: Settings, machine, and which steps are done.
        page: The page of results.
        object_class: The class pack of the run's objects.
        recognition: Folder of the recognition model: weights, log and curve of its training.
        weights: The recognition model's weights.
        calibration: That of fits, learned on the validation photos.
        ablations: The table of ablations.
    """

    def __init__(self, root: Path) -> None:
        self.root, self.record, self.page = root, root / "run.json", root / "index.html"
        self.object_class, self.recognition = root / "class", root / "recognition"
        self.weights, self.calibration = self.recognition / "recognition.safetensors", self.recognition / FILE
        self.ablations = root / "tables" / "ablations.json"

    def data(self, name: str) -> Path:
        """Return the folder of a dataset that the run makes."""
        return self.root / "data" / name

    def fits(self, name: str) -> Path:
        """Return the folder of the fits of a renderer's test photos, of "validation" or of "ablations"."""
        return self.root / "fits" / name

    def tables(self, renderer: str) -> Path:
        """Return the folder of a renderer's tables, which are named as in `work.OCCLUSION_LIMITS`."""
        return self.root / "tables" / renderer

    def figures(self, renderer: str) -> Path:
        """Return the folder of a renderer's figures."""
        return self.root / "figures" / renderer

    def read_table(self, renderer: str) -> dict[str, Any] | None:
        """Return a renderer's table of the paper's range of occlusion; None when it does not exist."""
        return read_json(self.tables(renderer) / "table.json")


def read_json(path: Path) -> dict[str, Any] | None:
    """Return a table of a run; None when it does not exist."""
    return json.loads(path.read_text()) if path.exists() else None


def duration(seconds: float) -> str:
    """Return a duration in words: 12.3 s, 4 min 10 s, 2 h 5 min."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, remaining_seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {remaining_seconds} s"
