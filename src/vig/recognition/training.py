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

from vig.dataset import Dataset
from vig.errors import UserError
from vig.recognition.augmentation import Augmentation
from vig.recognition.checkpoint import Scale, load_checkpoint, save_checkpoint, save_weights
from vig.recognition.examples import Examples, hold_out
from vig.recognition.log import Log
from vig.recognition.losses import PARTS, WEIGHTS, losses, total
from vig.recognition.network import NetworkSettings, RecognitionNetwork, bfloat16
from vig.recognition.targets import layout_of_numbers
from vig.scene import angle_difference

FOLLOW = 0.998
"""Share of the averaged weights that a step keeps."""


@dataclass(frozen=True)
class TrainingSettings:
    """How to train.

    validation: most images whose rooms are held out for. patience: epochs without a better validation loss
    after which training ends. threads: of the CPU, all by default.
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

    def describe(self, dataset: Dataset) -> str:
        """What must be alike for a checkpoint to be gone on with: the settings and the data."""
        data = zlib.crc32(np.ascontiguousarray(dataset.latents).tobytes())
        described = asdict(self) | {"count": len(dataset), "data": data}
        return json.dumps({name: value for name, value in described.items() if name != "threads"})


def train(
    dataset: Dataset, out: Path, settings: TrainingSettings, say: Callable[[str], None] = print
) -> Path:
    """Train on a dataset but for the rooms that are held out; returns the weights' path.

    Into `out` are written `recognition.safetensors`, the exponential moving average of the weights after the
    epoch whose loss on the held-out rooms was least; `log.csv` and `losses.png`, every loss of every epoch;
    and a checkpoint after each epoch, from which a run goes on. On a GPU where there is one, in bfloat16
    where the processor has it. UserError when the dataset is too small, for settings that train nothing, and
    when `out` holds another run's checkpoint or a damaged one.
    """
    settings.check(dataset)
    if settings.threads is not None:
        torch.set_num_threads(settings.threads)
    chosen, held = (torch.from_numpy(indices) for indices in hold_out(dataset, settings.validation))
    examples, log = Examples.of(dataset), Log(Path(out))
    run = _Run.begin(settings, examples, chosen)
    checkpoint, path = Path(out) / "checkpoint.safetensors", Path(out) / "recognition.safetensors"
    described = settings.describe(dataset)
    first, best, best_at = 0, math.inf, 0
    if checkpoint.exists():
        told = load_checkpoint(checkpoint, run.networks, run.optimizer, described)
        first, best, best_at = int(told["epoch"]), float(told["best"]), int(told["best_at"])
        log.keep(first)
    for epoch in range(first, settings.epochs):
        if epoch - best_at >= settings.patience:
            say(f"no better for {settings.patience} epochs; the weights are those after epoch {best_at}")
            break
        started = time.monotonic()
        trained = run.epoch(examples, chosen, epoch)
        speed = len(chosen) / (time.monotonic() - started)
        validated, errors = validate(run.networks["average"], examples, held, run.scale)
        log.add(epoch + 1, trained, validated, errors)
        loss = sum(WEIGHTS[name] * value for name, value in validated.items())
        if loss < best:
            best, best_at = loss, epoch + 1
            save_weights(run.networks["average"], run.scale, path)
        told = {"epoch": str(epoch + 1), "run": described, "best": repr(best), "best_at": str(best_at)}
        save_checkpoint(checkpoint, run.networks, run.optimizer, told)
        said = "  ".join(f"{name} {value:.3g}" for name, value in errors.items())
        say(f"epoch {epoch + 1}/{settings.epochs}  loss {loss:.3f}  {said}  {speed:.0f} images/s")
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
        sums = dict.fromkeys(PARTS, 0.0)
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
            _follow(average, network, min(FOLLOW, (1 + done) / (10 + done)))
            sums = {name: sums[name] + float(part.detach()) / steps for name, part in parts.items()}
        return sums


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
    sums, azimuths, elevations, shapes = dict.fromkeys(PARTS, 0.0), [], [], []
    hits = unions = 0.0
    for part in chosen.split(128):
        some = examples[part]
        pixels = some.images.permute(0, 3, 1, 2).float().div(255).to(device)
        with bfloat16(device):
            heads = network(pixels.contiguous(memory_format=torch.channels_last))
        targets = ((some.numbers - scale["mean"]) / scale["deviation"]).to(device)
        mask = some.mask.to(device).float() / 255
        for name, loss in losses(heads, some.azimuth.to(device), targets, mask).items():
            sums[name] += float(loss) * len(part) / len(chosen)
        bins = heads.azimuth.shape[1]
        guess = (heads.azimuth.argmax(1).cpu() + 0.5) * (2 * math.pi / bins)
        off = angle_difference(guess, some.azimuth)
        azimuths.append(off.abs().rad2deg())
        error = (heads.mean - targets).abs().cpu() * scale["deviation"]
        elevations.append(error[:, layout_of_numbers(error.shape[1]).at("elevation")].rad2deg())
        shapes.append(error[:, 1:4].mean(1))
        seen, said = mask[:, 0] > 0.5, heads.mask.argmax(1) == 0
        hits, unions = hits + float((seen & said).sum()), unions + float((seen | said).sum())
    azimuth = torch.cat(azimuths)
    return sums, {
        "azimuth_deg": float(azimuth.median()),
        "wrong_view": float((azimuth > 30).float().mean()),
        "elevation_deg": float(torch.cat(elevations).median()),
        "shape_sd": float(torch.cat(shapes).mean()),
        "mask_iou": hits / max(unions, 1.0),
    }


def _follow(average: RecognitionNetwork, network: RecognitionNetwork, keep: float) -> None:
    """Exponential moving average of weights and statistics."""
    with torch.no_grad():
        for kept, new in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
            if kept.is_floating_point():
                kept.lerp_(new, 1 - keep)
            else:
                kept.copy_(new)
