"""The recognition network's training and calibration with their records: log.csv, plots, a summary."""

import math
from collections.abc import Callable
from pathlib import Path

import torch

from vig.inference.calibration import WITHIN_90
from vig.io.files import atomic_write
from vig.recognition.network import layout_of_numbers
from vig_train.training.calibration import CalibrationResult, azimuth_bins
from vig_train.training.loop import EpochLog
from vig_train.training.training import Epoch
from vig_world.extras import optional_import


def report_calibration(weights: Path, result: CalibrationResult, say: Callable[[str], None]) -> None:
    """Say what a network's calibration changed and draw reliability.png beside its weights."""
    plot_reliability(weights.parent / "reliability.png", result)
    say(describe_calibration(result))


class TrainingLog:
    """Losses and errors of each epoch, in `folder`/log.csv and `folder`/losses.png."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.log = folder, EpochLog(folder / "log.csv")

    def add(self, epoch: Epoch) -> None:
        """Write an epoch; later ones, of a run that was stopped before its checkpoint, are forgotten."""
        values = {f"train_{name}": value for name, value in epoch.trained.items()}
        values |= {f"held_out_{name}": value for name, value in epoch.validated.items()} | epoch.errors
        texts = {name: f"{value:.6g}" for name, value in values.items()}
        self.log.add({"epoch": str(epoch.number)} | texts)
        self._plot(list(epoch.trained), list(epoch.errors))

    def _plot(self, parts: list[str], errors: list[str]) -> None:
        with optional_import("world"):
            from matplotlib.figure import Figure

        epochs = [int(row["epoch"]) for row in self.log.rows]
        figure = Figure(figsize=(3 * len(errors), 5), layout="constrained")
        panels = figure.subplots(2, len(errors))
        for panel, name in zip(panels[0], parts, strict=False):
            for prefix, label in (("train", "training"), ("held_out", "held-out rooms")):
                panel.plot(epochs, [float(row[f"{prefix}_{name}"]) for row in self.log.rows], label=label)
            panel.set_title(f"{name} loss")
        panels[0, 0].legend()
        for panel in panels[0, len(parts) :]:
            panel.axis("off")
        for panel, name in zip(panels[1], errors, strict=True):
            panel.plot(epochs, [float(row[name]) for row in self.log.rows], color="C1")
            panel.set_title(name.replace("_", " "))
            panel.set_xlabel("epoch")
        with atomic_write(self.folder / "losses.png") as temporary:
            figure.savefig(temporary, dpi=80, format="png")


def view_levels(logits: torch.Tensor, azimuth: torch.Tensor) -> torch.Tensor:
    """Return the probability (N,) of the smallest region, likeliest bins first, with the true azimuth (N,).

    Where logits (N, bins) are calibrated, it is uniform over [0, 1].
    """
    probability = logits.softmax(1)
    true_share = probability.gather(1, azimuth_bins(azimuth, logits.shape[1])[:, None])
    # Half of the true bin's own share counts: it lies anywhere within it.
    return (probability * (probability > true_share)).sum(1) + 0.5 * true_share[:, 0]


def describe_calibration(result: CalibrationResult) -> str:
    """Return one line on how well uncertainties held before and after."""
    calibration, logits = result.calibration, result.azimuth_logits
    before, after = (
        float((view_levels(scaled, result.azimuth) <= 0.9).float().mean())
        for scaled in (logits, logits / float(calibration.azimuth_temperature))
    )
    within = (result.standard_errors.abs() < WITHIN_90).float().mean(0)
    return (
        f"calibrated on {len(logits)} images: regions that should hold 90 % of the true azimuths held"
        f" {before:.1%}, now {after:.1%} (temperature {calibration.azimuth_temperature:.2f}); 90 % intervals"
        f" of the other numbers held {within.min():.1%} to {within.max():.1%}, so that their deviations are"
        f" multiplied by {calibration.deviation.min():.2f} to {calibration.deviation.max():.2f}; temperature"
        f" of the mask {calibration.mask_temperature:.2f}"
    )


def plot_reliability(path: Path, result: CalibrationResult) -> None:
    """Plot observed against stated probability, before and after: azimuth's regions, intervals of numbers."""
    with optional_import("world"):
        from matplotlib.figure import Figure

    calibration, errors = result.calibration, result.standard_errors
    figure = Figure(figsize=(9, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    stated = torch.linspace(0, 1, 51)
    for name, temperature in (("as trained", 1.0), ("calibrated", float(calibration.azimuth_temperature))):
        levels = view_levels(result.azimuth_logits / temperature, result.azimuth)
        left.plot(stated, (levels <= stated[:, None]).float().mean(1), label=name)
    left.set_title("azimuth")
    reach = math.sqrt(2) * torch.erfinv(stated.clamp_max(0.9999))
    layout = layout_of_numbers(errors.shape[1])
    for number, name in enumerate(("elevation", "shape", "albedo", "light")):
        group = layout[name]
        for factor, style in ((torch.ones(()), ":"), (torch.from_numpy(calibration.deviation)[group], "-")):
            error = (errors[:, group] / factor).abs().flatten()
            observed = (error <= reach[:, None]).float().mean(1)
            right.plot(stated, observed, style, color=f"C{number}", label=name if style == "-" else None)
    right.set_title("numbers: dotted as trained, solid calibrated")
    for panel in (left, right):
        panel.plot([0, 1], [0, 1], color="grey", linewidth=0.8)
        panel.set(xlabel="stated probability", ylabel="share of images", xlim=(0, 1), ylim=(0, 1))
        panel.legend(loc="upper left")
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=80, format="png")
