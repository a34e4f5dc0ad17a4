"""Training of the recognition network on a dataset, resumable from its last epoch."""

from __future__ import annotations

import json
import math
import time
import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch.nn import functional

from vig.dataset import Dataset
from vig.errors import UserError
from vig.files import atomic_write
from vig.recognition.network import Heads, NetworkSettings, RecognitionNetwork
from vig.recognition.targets import azimuth_labels, mask_labels, mirrored, numbers_of
from vig.scene import Latents


@dataclass(frozen=True)
class TrainingSettings:
    """How to train. jitter: share of batches whose framing is disturbed, so that real crops are met."""

    epochs: int = 30
    batch: int = 64
    learning_rate: float = 1.5e-3
    weight_decay: float = 1e-2
    validation: int = 1000
    jitter: float = 0.5
    seed: int = 0
    threads: int = 2


@dataclass(frozen=True)
class Examples:
    """A dataset in memory.

    images (N, H, W, 3) uint8; azimuth (N,); numbers (N, M); mask (N, 3, h, w) uint8.
    """

    images: torch.Tensor
    azimuth: torch.Tensor
    numbers: torch.Tensor
    mask: torch.Tensor

    @staticmethod
    def of(dataset: Dataset) -> Examples:
        latents = Latents.from_vector(torch.from_numpy(dataset.latents))
        amodal, visible = torch.from_numpy(dataset.amodal), torch.from_numpy(dataset.visible)
        shares = [mask_labels(a, v) for a, v in zip(amodal.split(256), visible.split(256), strict=True)]
        mask = torch.cat([(share * 255).round().to(torch.uint8) for share in shares])
        return Examples(torch.from_numpy(dataset.images), latents.azimuth, numbers_of(latents), mask)

    def __len__(self) -> int:
        return len(self.azimuth)


def train(
    dataset: Dataset,
    out: Path,
    settings: TrainingSettings,
    say: Callable[[str], None] = print,
) -> Path:
    """Train on all but the last `validation` images; returns the weights' path.

    They are written to `out/recognition.safetensors`.

    Writes a checkpoint after each epoch into `out` and goes on from it when run again. The weights are an
    exponential moving average over the steps. UserError when the dataset is too small, for settings that
    train nothing, and when `out` holds another run's checkpoint or a damaged one.
    """
    for name, least in (("epochs", 1), ("seed", 0)):
        if getattr(settings, name) < least:
            raise UserError(f"{name} must be at least {least}; got {getattr(settings, name)}")
    if len(dataset) < 2 * settings.batch:
        raise UserError(
            f"training needs at least {2 * settings.batch} images; '{dataset.folder}' has {len(dataset)}"
        )
    torch.set_num_threads(settings.threads)
    examples = Examples.of(dataset)
    held = max(1, min(settings.validation, len(examples) // 10))
    count = len(examples) - held
    numbers = examples.numbers[:count]
    scale = {"mean": numbers.mean(0), "deviation": numbers.std(0).clamp_min(1e-3)}
    torch.manual_seed(settings.seed)
    network = RecognitionNetwork(NetworkSettings(modes=dataset.latents.shape[1] - 14))
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    average = RecognitionNetwork(network.settings)
    average.load_state_dict(network.state_dict())
    optimizer = torch.optim.AdamW(
        network.parameters(), settings.learning_rate, weight_decay=settings.weight_decay, fused=True
    )
    steps = count // settings.batch
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, settings.learning_rate, total_steps=settings.epochs * steps + 1, pct_start=0.15
    )
    checkpoint, run = Path(out) / "checkpoint.safetensors", _run(settings, dataset)
    first = (
        _resume(checkpoint, network, average, optimizer, schedule, steps, run) if checkpoint.exists() else 0
    )
    for epoch in range(first, settings.epochs):
        started, total = time.monotonic(), 0.0
        rng = np.random.default_rng(np.random.SeedSequence([settings.seed, epoch]))
        torch.manual_seed(int(rng.integers(2**31)))  # dropout and pixel noise; the rest draws from rng
        network.train()
        order = rng.permutation(count)
        for step in range(steps):
            chosen = torch.from_numpy(order[step * settings.batch : (step + 1) * settings.batch])
            loss = _step(network, _batch(examples, chosen, scale, rng, settings.jitter))
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
            optimizer.step()
            schedule.step()
            _follow(average, network, 0.995)
            total += loss.item()
        _save_checkpoint(checkpoint, network, average, optimizer, epoch + 1, run)
        rate = steps * settings.batch / (time.monotonic() - started)
        errors = validate(average, examples, count, scale)
        say(f"epoch {epoch + 1}/{settings.epochs}  loss {total / steps:.3f}  {errors}  {rate:.0f} images/s")
    path = Path(out) / "recognition.safetensors"
    save_weights(average, scale, path)
    return path


def save_weights(network: RecognitionNetwork, scale: dict[str, torch.Tensor], path: Path) -> None:
    """Write a network in half precision with its settings and the targets' scale."""
    tensors = {
        f"network.{k}": v.half() if v.is_floating_point() else v for k, v in network.state_dict().items()
    }
    tensors |= {f"scale.{k}": v for k, v in scale.items()}
    with atomic_write(path) as temporary:
        save_file(
            {k: v.contiguous() for k, v in tensors.items()},
            temporary,
            metadata={"settings": json.dumps(asdict(network.settings))},
        )


def validate(
    network: RecognitionNetwork, examples: Examples, first: int, scale: dict[str, torch.Tensor]
) -> str:
    """Median errors on the examples from `first` on, in a line."""
    network.eval()
    azimuths, elevations, shapes, hits, unions = [], [], [], 0.0, 0.0
    with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16):
        for chosen in torch.arange(first, len(examples)).split(128):
            heads = network(_pixels(examples.images[chosen]))
            bins = heads.azimuth.shape[1]
            guess = (heads.azimuth.argmax(1) + 0.5) * (2 * math.pi / bins)
            off = torch.remainder(guess - examples.azimuth[chosen] + math.pi, 2 * math.pi) - math.pi
            azimuths.append(off.abs())
            error = (heads.mean * scale["deviation"] + scale["mean"] - examples.numbers[chosen]).abs()
            elevations.append(error[:, 0])
            shapes.append(error[:, 1:4].mean(1))
            seen, said = examples.mask[chosen][:, 0] > 127, heads.mask.argmax(1) == 0
            hits, unions = hits + (seen & said).sum().item(), unions + (seen | said).sum().item()
    azimuth, elevation = torch.cat(azimuths).rad2deg(), torch.cat(elevations).rad2deg()
    return (
        f"azimuth {azimuth.median():.1f} (>30: {(azimuth > 30).float().mean():.0%})"
        f"  elevation {elevation.median():.1f}  shape {torch.cat(shapes).mean():.2f} sd"
        f"  mask IoU {hits / max(unions, 1.0):.2f}"
    )


def _pixels(images: torch.Tensor) -> torch.Tensor:
    """uint8 (B, H, W, 3) to network input (B, 3, H, W) in [0, 1]."""
    return images.permute(0, 3, 1, 2).float().div(255).contiguous(memory_format=torch.channels_last)


def _batch(
    examples: Examples,
    chosen: torch.Tensor,
    scale: dict[str, torch.Tensor],
    rng: np.random.Generator,
    jitter: float,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Augmented images, azimuths, scaled numbers and mask shares."""
    images, azimuth, numbers = (
        _pixels(examples.images[chosen]),
        examples.azimuth[chosen],
        examples.numbers[chosen],
    )
    mask = examples.mask[chosen].float() / 255
    if rng.random() < 0.5:
        azimuth, numbers = mirrored(azimuth, numbers)
        images, mask = images.flip(3), mask.flip(3)
    if rng.random() < jitter:
        images, mask = _reframe(images, rng), mask * 0 - 1
    gain = torch.from_numpy(rng.normal(1, 0.06, (len(images), 3, 1, 1))).float()
    noise = torch.randn(images.shape) * float(rng.uniform(0, 0.03))
    images = (images * gain + noise).clamp(0, 1).contiguous(memory_format=torch.channels_last)
    return images, azimuth, (numbers - scale["mean"]) / scale["deviation"], mask


def _reframe(images: torch.Tensor, rng: np.random.Generator) -> torch.Tensor:
    """Shift and magnify each image a little, as a box drawn by hand does."""
    count = len(images)
    matrix = np.zeros((count, 2, 3), np.float32)
    matrix[:, 0, 0] = matrix[:, 1, 1] = np.exp(rng.normal(0, 0.05, count))
    matrix[:, :, 2] = rng.normal(0, 0.05, (count, 2))
    grid = functional.affine_grid(torch.from_numpy(matrix), list(images.shape), align_corners=False)
    return functional.grid_sample(images, grid, padding_mode="border", align_corners=False)


def _step(network: RecognitionNetwork, batch: tuple[torch.Tensor, ...]) -> torch.Tensor:
    images, azimuth, numbers, mask = batch
    with torch.autocast("cpu", torch.bfloat16):
        heads: Heads = network(images)
    labels = azimuth_labels(azimuth, heads.azimuth.shape[1])
    angle = functional.cross_entropy(heads.azimuth, labels)
    # Gaussian likelihood, each term weighted by its own deviation (beta-NLL, Seitzer et al. 2022), so that
    # numbers that are hard to tell do not stop being learned.
    variance = heads.log_variance.exp()
    likelihood = (heads.mean - numbers) ** 2 / variance + heads.log_variance
    regression = (likelihood * variance.detach().sqrt()).mean()
    loss = angle + 2.0 * regression
    if mask.min() >= 0:
        loss = loss + 2.0 * functional.cross_entropy(heads.mask, mask)
    return loss


def _follow(average: RecognitionNetwork, network: RecognitionNetwork, keep: float) -> None:
    """Exponential moving average of weights and statistics."""
    with torch.no_grad():
        for kept, new in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
            if kept.is_floating_point():
                kept.lerp_(new, 1 - keep)
            else:
                kept.copy_(new)


def _save_checkpoint(
    path: Path,
    network: RecognitionNetwork,
    average: RecognitionNetwork,
    optimizer: torch.optim.Optimizer,
    epoch: int,
    run: str,
) -> None:
    tensors = {f"network.{k}": v for k, v in network.state_dict().items()}
    tensors |= {f"average.{k}": v for k, v in average.state_dict().items()}
    for parameter, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{parameter}.{k}": v for k, v in state.items()}
    metadata = {"epoch": str(epoch), "run": run}
    with atomic_write(path) as temporary:
        save_file({k: v.contiguous() for k, v in tensors.items()}, temporary, metadata=metadata)


def _resume(
    path: Path,
    network: RecognitionNetwork,
    average: RecognitionNetwork,
    optimizer: torch.optim.Optimizer,
    schedule: torch.optim.lr_scheduler.LRScheduler,
    steps: int,
    run: str,
) -> int:
    """Put a checkpoint back; returns how many epochs it has seen."""
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata()
        epoch, said = int(metadata["epoch"]), metadata["run"]
        tensors = load_file(path)
    except (OSError, KeyError, TypeError, ValueError, SafetensorError) as error:
        raise UserError(
            f"the checkpoint '{path}' is damaged ({type(error).__name__}); remove it to train from the start"
        ) from error
    if said != run:
        raise UserError(
            f"'{path.parent}' holds another training run's checkpoint; choose another folder or remove it"
        )
    for name, module in (("network", network), ("average", average)):
        prefix = f"{name}."
        module.load_state_dict(
            {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
        )
    parameters = list(network.parameters())
    state: dict[int, dict[str, torch.Tensor]] = {}
    for key, tensor in tensors.items():
        if key.startswith("optimizer."):
            _, parameter, name = key.split(".", 2)
            if tensor.ndim:  # the fused step walks through memory: its state must lie as the weights do
                tensor = torch.empty_like(parameters[int(parameter)]).copy_(tensor)
            state.setdefault(int(parameter), {})[name] = tensor
    whole = optimizer.state_dict()
    whole["state"] = state
    optimizer.load_state_dict(whole)
    done = epoch * steps
    schedule.load_state_dict({"last_epoch": done - 1, "_step_count": done + 1})
    schedule.step()
    return epoch


def _run(settings: TrainingSettings, dataset: Dataset) -> str:
    """What must be alike for a checkpoint to be gone on with: the settings and the data."""
    data = zlib.crc32(np.ascontiguousarray(dataset.latents).tobytes())
    return json.dumps(asdict(settings) | {"count": len(dataset), "data": data})
