"""Training of the recognition network on a dataset, resumable from its last epoch."""

from __future__ import annotations

import json
import math
import time
import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional

from vig.errors import UserError
from vig.recognition.network import (
    Heads,
    NetworkSettings,
    RecognitionNetwork,
    bfloat16,
    layout_of_numbers,
)
from vig.scene import angle_difference
from vig_lab.training.augmentation import Augmentation
from vig_lab.training.checkpoint import Scale, load_checkpoint, save_checkpoint, save_weights
from vig_lab.training.examples import Examples, hold_out
from vig_lab.training.targets import azimuth_labels
from vig_world.dataset import Dataset

AVERAGING = 0.998
"""Share of the averaged weights that a step keeps."""
LOSS_WEIGHTS = {"azimuth": 1.0, "numbers": 2.0, "mask": 2.0}
"""Of the parts of the loss."""


@dataclass(frozen=True)
class TrainingSettings:
    """How to train.

    Attributes:
        epochs: Passes over the training images, at most.
        batch: Images per step.
        learning_rate: The highest; see `Schedule`.
        weight_decay: Of AdamW.
        validation: Most images of held-out rooms that are used.
        patience: Epochs without a better validation loss after which training ends.
        augmentation: Of the training images.
        network: Sizes; the number of shape components is the dataset's.
        seed: Of weights, order and augmentation.
        threads: Of the CPU, all by default.
    """

    epochs: int = 18
    batch: int = 64
    learning_rate: float = 2e-3
    weight_decay: float = 2e-2
    validation: int = 2000
    patience: int = 6
    augmentation: Augmentation = Augmentation()
    network: NetworkSettings = NetworkSettings()
    seed: int = 0
    threads: int | None = None

    def check(self, dataset: Dataset) -> None:
        """Raise UserError when this trains nothing on a dataset."""
        for name, least in (("epochs", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise UserError(f"{name} must be at least {least}; got {getattr(self, name)}")
        if len(dataset) < 2 * self.batch:
            raise UserError(
                f"training needs at least {2 * self.batch} images; '{dataset.folder}' has {len(dataset)}"
            )

    def fingerprint(self, dataset: Dataset) -> str:
        """Settings and data that a checkpoint must match to be resumed."""
        data = zlib.crc32(np.ascontiguousarray(dataset.latents).tobytes())
        described = asdict(self) | {"count": len(dataset), "data": data}
        return json.dumps({name: value for name, value in described.items() if name != "threads"})


@dataclass(frozen=True)
class Epoch:
    """What one pass over the training images came to.

    Attributes:
        number: From 1 on.
        trained: Each part of the loss, mean over the pass.
        validated: The same on the held-out images, of the averaged weights.
        errors: Of these on the held-out images, in their own units.
    """

    number: int
    trained: dict[str, float]
    validated: dict[str, float]
    errors: dict[str, float]


def train(
    dataset: Dataset,
    out: Path,
    settings: TrainingSettings,
    say: Callable[[str], None] = print,
    record: Callable[[Epoch], None] = lambda epoch: None,
) -> Path:
    """Train on a dataset but for the rooms that are held out.

    On a GPU where there is one, in bfloat16 where the processor has it. An interrupted run resumes from the
    checkpoint that is written after each epoch.

    Args:
        dataset: To learn from.
        out: Folder of the weights and the checkpoint.
        settings: How to train.
        say: Is called with a line after each epoch.
        record: Is called after each epoch, before the checkpoint is written.

    Returns:
        The path of the weights: their exponential moving average after the epoch of least held-out loss.

    Raises:
        UserError: The dataset is too small, the settings train nothing, or `out` holds a checkpoint that is
            damaged or of another run.
    """
    settings.check(dataset)
    if settings.threads is not None:
        torch.set_num_threads(settings.threads)
    chosen, held = (torch.from_numpy(indices) for indices in hold_out(dataset, settings.validation))
    examples = Examples.of(dataset)
    run = _Run.begin(settings, examples, chosen)
    checkpoint, path = Path(out) / "checkpoint.safetensors", Path(out) / "recognition.safetensors"
    fingerprint = settings.fingerprint(dataset)
    first, best, best_at = 0, math.inf, 0
    if checkpoint.exists():
        state = load_checkpoint(checkpoint, run.networks, run.optimizer, fingerprint)
        first, best, best_at = int(state["epoch"]), float(state["best"]), int(state["best_at"])
    for epoch in range(first, settings.epochs):
        if epoch - best_at >= settings.patience:
            say(f"no better for {settings.patience} epochs; the weights are those after epoch {best_at}")
            break
        started = time.monotonic()
        trained = run.epoch(examples, chosen, epoch)
        speed = len(chosen) / (time.monotonic() - started)
        validated, errors = validate(run.networks["average"], examples, held, run.scale)
        record(Epoch(epoch + 1, trained, validated, errors))
        loss = sum(LOSS_WEIGHTS[name] * value for name, value in validated.items())
        if loss < best:
            best, best_at = loss, epoch + 1
            save_weights(run.networks["average"], run.scale, path)
        state = {"epoch": str(epoch + 1), "run": fingerprint, "best": repr(best), "best_at": str(best_at)}
        save_checkpoint(checkpoint, run.networks, run.optimizer, state)
        listed = "  ".join(f"{name} {value:.3g}" for name, value in errors.items())
        say(f"epoch {epoch + 1}/{settings.epochs}  loss {loss:.3f}  {listed}  {speed:.0f} images/s")
    return path


@dataclass(frozen=True)
class _Run:
    """A network in training, the average of its weights, and what moves them."""

    settings: TrainingSettings
    networks: dict[str, RecognitionNetwork]
    optimizer: torch.optim.Optimizer
    scale: Scale
    device: torch.device

    @staticmethod
    def begin(settings: TrainingSettings, examples: Examples, chosen: torch.Tensor) -> _Run:
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        numbers = examples.numbers[chosen]
        scale = {"mean": numbers.mean(0), "deviation": numbers.std(0).clamp_min(1e-3)}
        torch.manual_seed(settings.seed)
        sizes = replace(settings.network, modes=layout_of_numbers(numbers.shape[1]).count("shape"))
        network, average = (RecognitionNetwork(sizes).to(device) for _ in range(2))
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        average.load_state_dict(network.state_dict())
        optimizer = torch.optim.AdamW(
            network.parameters(), settings.learning_rate, weight_decay=settings.weight_decay, fused=True
        )
        return _Run(settings, {"network": network, "average": average}, optimizer, scale, device)

    def epoch(self, examples: Examples, chosen: torch.Tensor, epoch: int) -> dict[str, float]:
        """One pass over the chosen examples; returns the mean of each part of the loss."""
        settings, (network, average) = self.settings, self.networks.values()
        rng = np.random.default_rng(np.random.SeedSequence([settings.seed, epoch]))
        torch.manual_seed(int(rng.integers(2**31)))  # dropout and pixel noise; the rest draws from rng
        network.train()
        order = chosen[torch.from_numpy(rng.permutation(len(chosen)))]
        steps = len(order) // settings.batch
        rate = Schedule(settings.learning_rate, settings.epochs * steps)
        sums = dict.fromkeys(LOSS_WEIGHTS, 0.0)
        for step, some in enumerate(order[: steps * settings.batch].split(settings.batch)):
            images, azimuth, numbers, mask = settings.augmentation(examples[some], rng)
            numbers = (numbers - self.scale["mean"]) / self.scale["deviation"]
            with bfloat16(self.device):
                heads = network(images.to(self.device))
            parts = losses(heads, *(target.to(self.device) for target in (azimuth, numbers, mask)))
            self.optimizer.zero_grad()
            total(parts).backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
            done = epoch * steps + step
            for group in self.optimizer.param_groups:
                group["lr"] = rate(done)
            self.optimizer.step()
            _average_in(average, network, min(AVERAGING, (1 + done) / (10 + done)))
            sums = {name: sums[name] + float(part.detach()) / steps for name, part in parts.items()}
        return sums


def losses(
    heads: Heads, azimuth: torch.Tensor, numbers: torch.Tensor, mask: torch.Tensor
) -> dict[str, torch.Tensor]:
    """Each part of the loss: a distribution over azimuth, Gaussian likelihoods of numbers, a mask.

    Terms of numbers are weighted by their own deviations (beta-NLL, Seitzer et al. 2022), so that those that
    are hard to predict continue to be learned.

    Args:
        heads: The network's outputs.
        azimuth: (B,) radians.
        numbers: (B, M) in the heads' units.
        mask: (B, 3, h, w) shares; images whose mask is negative have none.
    """
    labels = azimuth_labels(azimuth, heads.azimuth.shape[1])
    variance = heads.log_variance.exp()
    likelihood = (heads.mean - numbers) ** 2 / variance + heads.log_variance
    known = (mask.amin((1, 2, 3)) >= 0).float()
    pixels = functional.cross_entropy(heads.mask, mask.clamp_min(0.0), reduction="none").mean((1, 2))
    return {
        "azimuth": functional.cross_entropy(heads.azimuth, labels),
        "numbers": (likelihood * variance.detach().sqrt()).mean(),
        "mask": (pixels * known).sum() / known.sum().clamp_min(1.0),
    }


def total(parts: dict[str, torch.Tensor]) -> torch.Tensor:
    """The weighted sum that is minimised."""
    return sum((LOSS_WEIGHTS[name] * loss for name, loss in parts.items()), torch.zeros(()))


@dataclass(frozen=True)
class Schedule:
    """Learning rate by step: a linear rise over a twentieth, then half a cosine down to a hundredth."""

    highest: float
    steps: int

    def __call__(self, step: int) -> float:
        rise = max(1, self.steps // 20)
        if step < rise:
            return self.highest * (step + 1) / rise
        share = (step - rise) / max(1, self.steps - rise)
        return self.highest * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(1.0, share))))


@torch.inference_mode()
def validate(
    network: RecognitionNetwork, examples: Examples, chosen: torch.Tensor, scale: Scale
) -> tuple[dict[str, float], dict[str, float]]:
    """Mean losses, and errors in their own units, on chosen examples as they are."""
    network.eval()
    device = next(network.parameters()).device
    sums, azimuths, elevations, shapes = dict.fromkeys(LOSS_WEIGHTS, 0.0), [], [], []
    hits = unions = 0.0
    for part in chosen.split(128):
        some = examples[part]
        pixels = some.pixels(device)
        with bfloat16(device):
            heads = network(pixels)
        targets = ((some.numbers - scale["mean"]) / scale["deviation"]).to(device)
        mask = some.mask.to(device).float() / 255
        for name, loss in losses(heads, some.azimuth.to(device), targets, mask).items():
            sums[name] += float(loss) * len(part) / len(chosen)
        bins = heads.azimuth.shape[1]
        guess = (heads.azimuth.argmax(1).cpu() + 0.5) * (2 * math.pi / bins)
        off = angle_difference(guess, some.azimuth)
        azimuths.append(off.abs().rad2deg())
        error = (heads.mean - targets).abs().cpu() * scale["deviation"]
        parts = layout_of_numbers(error.shape[1]).split(error)
        elevations.append(parts["elevation"][:, 0].rad2deg())
        shapes.append(parts["shape"][:, :3].mean(1))
        visible, predicted = mask[:, 0] > 0.5, heads.mask.argmax(1) == 0
        hits += float((visible & predicted).sum())
        unions += float((visible | predicted).sum())
    azimuth = torch.cat(azimuths)
    return sums, {
        "azimuth_deg": float(azimuth.median()),
        "wrong_view": float((azimuth > 30).float().mean()),
        "elevation_deg": float(torch.cat(elevations).median()),
        "shape_sd": float(torch.cat(shapes).mean()),
        "mask_iou": hits / max(unions, 1.0),
    }


def _average_in(average: RecognitionNetwork, network: RecognitionNetwork, keep: float) -> None:
    """Exponential moving average of weights and statistics."""
    with torch.no_grad():
        for kept, new in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
            if kept.is_floating_point():
                kept.lerp_(new, 1 - keep)
            else:
                kept.copy_(new)
