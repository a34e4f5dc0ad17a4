"""The log of a training run: a line of CSV for each epoch, and a plot of it."""

from __future__ import annotations

import csv
from pathlib import Path

from vig.errors import optional_import
from vig.files import atomic_write


class Log:
    """Every loss and error of every epoch, in `folder`/log.csv and `folder`/losses.png."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.rows: list[dict[str, str]] = []
        path = folder / "log.csv"
        if path.is_file():
            with open(path, newline="") as file:
                self.rows = list(csv.DictReader(file))

    def keep(self, epochs: int) -> None:
        """Forget what a run that was stopped wrote after its last checkpoint."""
        self.rows = [row for row in self.rows if int(row["epoch"]) <= epochs]

    def add(
        self, epoch: int, trained: dict[str, float], validated: dict[str, float], errors: dict[str, float]
    ) -> None:
        """Write an epoch's losses in training and on the held-out rooms, and the latter's errors."""
        row = {"epoch": str(epoch)}
        row |= {f"train_{name}": f"{value:.6g}" for name, value in trained.items()}
        row |= {f"held_out_{name}": f"{value:.6g}" for name, value in validated.items()}
        row |= {name: f"{value:.6g}" for name, value in errors.items()}
        self.rows = [old for old in self.rows if int(old["epoch"]) < epoch] + [row]
        with atomic_write(self.folder / "log.csv") as temporary, open(temporary, "w", newline="") as file:
            writer = csv.DictWriter(file, list(row))
            writer.writeheader()
            writer.writerows(self.rows)
        self._plot(list(trained), list(errors))

    def _plot(self, parts: list[str], errors: list[str]) -> None:
        with optional_import("world"):
            from matplotlib.figure import Figure

        epochs = [int(row["epoch"]) for row in self.rows]
        figure = Figure(figsize=(3 * len(errors), 5), layout="constrained")
        panels = figure.subplots(2, len(errors))
        for panel, name in zip(panels[0], parts, strict=False):
            for prefix, label in (("train", "training"), ("held_out", "held-out rooms")):
                panel.plot(epochs, [float(row[f"{prefix}_{name}"]) for row in self.rows], label=label)
            panel.set_title(f"{name} loss")
        panels[0, 0].legend()
        for panel in panels[0, len(parts) :]:
            panel.axis("off")
        for panel, name in zip(panels[1], errors, strict=True):
            panel.plot(epochs, [float(row[name]) for row in self.rows], color="C1")
            panel.set_title(name.replace("_", " "))
            panel.set_xlabel("epoch")
        with atomic_write(self.folder / "losses.png") as temporary:
            figure.savefig(temporary, dpi=80, format="png")
