"""Calibration of a network on a dataset whose scenes and designs training never saw."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from safetensors.torch import save_file
from torch.nn import functional

from vig.checks import read_tensors
from vig.dataset import Dataset
from vig.errors import UserError, optional_import
from vig.files import atomic_write
from vig.recognition.calibration import PREFIX, Calibration, temperature, widening
from vig.recognition.examples import Examples
from vig.recognition.network import Heads, bfloat16
from vig.recognition.prediction import Recognizer
from vig.recognition.targets import layout_of_numbers

LEAST = 50
"""Images below which a calibration means nothing."""


def calibrate(path: Path, datasets: Sequence[Dataset], say: Callable[[str], None] = print) -> None:
    """Write a calibration on datasets into the weights at `path`, and `reliability.png` beside them.

    Raises UserError for fewer than `LEAST` images, for weights that cannot be read, and for the paper's
    networks, which state nothing that could be calibrated.
    """
    count = sum(len(dataset) for dataset in datasets)
    if count < LEAST:
        raise UserError(f"calibration needs at least {LEAST} images; got {count}")
    recognizer, examples = Recognizer(path), Examples.joined([Examples.of(dataset) for dataset in datasets])
    azimuth, mean, deviation, mask = _heads(recognizer, examples)
    labels = functional.one_hot(bins_of(examples.azimuth, azimuth.shape[1]), azimuth.shape[1]).float()
    error = mean - examples.numbers
    cells = mask.movedim(1, -1).reshape(-1, mask.shape[1])[::7]  # cells lie too close to need them all
    shares = (examples.mask.float() / 255).movedim(1, -1).reshape(-1, mask.shape[1])[::7]
    made = Calibration(temperature(azimuth, labels), temperature(cells, shares), widening(error, deviation))
    held, metadata = read_tensors(path, "pt")
    tensors = {name: value for name, value in held.items() if not name.startswith(PREFIX)}
    with atomic_write(path) as temporary:
        save_file(tensors | made.tensors(), temporary, metadata=metadata)
    bins = azimuth.shape[1]
    before, after = (_view_coverage(azimuth / t, examples.azimuth) for t in (1.0, made.azimuth_temperature))
    within = (error.abs() < 1.6449 * deviation).float().mean(0)
    _plot(path.parent / "reliability.png", azimuth, error / deviation, examples.azimuth, made)
    say(
        f"calibrated on {count} images: temperature of azimuth {made.azimuth_temperature:.2f}"
        f" (90 % regions of {bins} bins hold {before:.1%} before, {after:.1%} after), of the mask"
        f" {made.mask_temperature:.2f}; 90 % intervals held {within.min():.1%} to {within.max():.1%} of the"
        f" numbers, deviations are multiplied by {made.deviation.min():.2f} to {made.deviation.max():.2f}"
    )


@torch.inference_mode()
def _heads(
    recognizer: Recognizer, examples: Examples
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Logits of azimuth, numbers, their stated deviations, and logits of the mask, all uncalibrated."""
    found = []
    for images in examples.images.split(64):
        pixels = images.permute(0, 3, 1, 2).float().div(255).contiguous(memory_format=torch.channels_last)
        with bfloat16(pixels.device):
            heads = recognizer.network(pixels)
        assert isinstance(heads, Heads)
        numbers = heads.mean * recognizer.deviation + recognizer.mean
        deviation = (0.5 * heads.log_variance).exp() * recognizer.deviation
        found.append((heads.azimuth, numbers, deviation, heads.mask))
    azimuth, numbers, deviation, mask = (torch.cat(part) for part in zip(*found, strict=True))
    return azimuth, numbers, deviation, mask


def bins_of(azimuth: torch.Tensor, bins: int) -> torch.Tensor:
    """The bin (N,) that each azimuth (N,) in [0, 2 pi) lies in."""
    return (azimuth * bins / (2 * math.pi)).long().clamp(0, bins - 1)


def view_levels(logits: torch.Tensor, azimuth: torch.Tensor) -> torch.Tensor:
    """The smallest region's probability (N,) that reaches the true azimuth, bins taken in order of theirs."""
    bins = logits.shape[1]
    probability = logits.softmax(1)
    own = probability.gather(1, bins_of(azimuth, bins)[:, None])
    # Half of the true bin's own share counts: it lies anywhere within it.
    return (probability * (probability > own)).sum(1) + 0.5 * own[:, 0]


def _view_coverage(logits: torch.Tensor, azimuth: torch.Tensor) -> float:
    return float((view_levels(logits, azimuth) <= 0.9).float().mean())


def _plot(
    path: Path, logits: torch.Tensor, standard: torch.Tensor, azimuth: torch.Tensor, made: Calibration
) -> None:
    """Observed against stated probability, before and after: azimuth's regions, intervals of each number."""
    with optional_import("world"):
        from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    stated = torch.linspace(0, 1, 51)
    for name, scaled in (("as trained", logits), ("calibrated", logits / made.azimuth_temperature)):
        levels = view_levels(scaled, azimuth)
        left.plot(stated, (levels <= stated[:, None]).float().mean(1), label=name)
    left.set_title("azimuth")
    reach = math.sqrt(2) * torch.erfinv(stated.clamp_max(0.9999))
    layout = layout_of_numbers(standard.shape[1])
    for number, name in enumerate(("elevation", "shape", "albedo", "light")):
        group = layout[name]
        for factor, style in ((torch.ones(()), ":"), (made.deviation[group], "-")):
            off = (standard[:, group] / factor).abs().flatten()
            held = (off <= reach[:, None]).float().mean(1)
            right.plot(stated, held, style, color=f"C{number}", label=name if style == "-" else None)
    right.set_title("numbers: dotted as trained, solid calibrated")
    for panel in (left, right):
        panel.plot([0, 1], [0, 1], color="grey", linewidth=0.8)
        panel.set(xlabel="stated probability", ylabel="share of images", xlim=(0, 1), ylim=(0, 1))
        panel.legend(loc="upper left")
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=80, format="png")
