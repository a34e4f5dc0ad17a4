"""Training of the paper's recognition networks one after the other, resumable from the last epoch."""

from __future__ import annotations

import csv
import json
import time
import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file
from torch import nn
from torch.nn import functional

from vig.io.checks import read_tensors, reading
from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig.recognition.weights import FORMAT
from vig.scene import Latents, angle_difference
from vig_paper.network.network import FACTORS, FactorNetwork, PaperNetworks, PaperSettings, targets_of
from vig_train.network.network import bfloat16
from vig_train.training.targets import numbers_of
from vig_world.dataset import Dataset

_DEVIATION_PER_MAD = 1.4826
"""Standard deviation of a Gaussian over the median of its absolute values."""


@dataclass(frozen=True)
class PaperTrainingSettings:
    """How to train: the paper's numbers, but for smaller batches.

    Attributes:
        epochs: Of each network, at most.
        patience: A network is done this many epochs after its best one.
        batch: Images per step. The paper's are of 128, with which losses fall less by an epoch.
        learning_rate: Of stochastic gradient descent.
        momentum: Nesterov's.
        seed: Of weights and order.
        threads: Of the CPU, all by default.
        networks: Their sizes; the number of shape components is the dataset's.
    """

    epochs: int = 150
    patience: int = 20
    batch: int = 32
    learning_rate: float = 0.01
    momentum: float = 0.9
    seed: int = 0
    threads: int | None = None
    networks: PaperSettings = PaperSettings()


@dataclass
class _CheckpointState:
    """What a checkpoint holds.

    Attributes:
        networks: As they are now.
        curves: For each factor and epoch the loss on training images, that on held-out images, and seconds.
        best: Weights by name, as they were in their factor's best epoch.
        momentum: Of the factor that is being trained, by name of the weight.
    """

    networks: PaperNetworks
    curves: dict[str, list[list[float]]] = field(default_factory=lambda: {name: [] for name in FACTORS})
    best: dict[str, torch.Tensor] = field(default_factory=dict)
    momentum: dict[str, torch.Tensor] = field(default_factory=dict)


@dataclass(frozen=True)
class _TrainingData:
    """images (N, H, W, 3) uint8 and latents on the training device; the first `count` are trained on."""

    images: torch.Tensor
    latents: Latents
    count: int

    @property
    def held_out(self) -> torch.Tensor:
        """Indices of the images that no network is trained on."""
        return torch.arange(self.count, len(self.images))

    def pixels(self, chosen: torch.Tensor) -> torch.Tensor:
        """Network input (B, 3, H, W), sRGB in [0, 1]."""
        return self.images[chosen].permute(0, 3, 1, 2).float() / 255


def train_paper(
    dataset: Dataset,
    out: Path,
    settings: PaperTrainingSettings,
    say: Callable[[str], None] = print,
) -> Path:
    """Train the networks on all but the last tenth of the images.

    On a GPU where there is one, in bfloat16 where the processor computes in it. An interrupted run resumes
    from the checkpoint that is written after each epoch. The standard deviations in the weights are those of
    the held-out images, which also chose the best epoch.

    Args:
        dataset: To learn from.
        out: Folder of the weights, the checkpoint, and log.csv with the losses of every epoch.
        settings: How to train.
        say: Is called with a line after each epoch.

    Returns:
        The weights' path.

    Raises:
        UserError: The dataset is too small, the settings train nothing, the training diverges, or `out` holds
            a checkpoint that is damaged or of another run.
    """
    for name, least in (("epochs", 1), ("seed", 0)):
        if getattr(settings, name) < least:
            raise UserError(f"{name} must be at least {least}; got {getattr(settings, name)}")
    if len(dataset) < 2 * settings.batch:
        raise UserError(
            f"training needs at least {2 * settings.batch} images; '{dataset.folder}' has {len(dataset)}"
        )
    if settings.threads is not None:
        torch.set_num_threads(settings.threads)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    latents = Latents.from_vector(torch.from_numpy(dataset.latents).to(device))
    held_out_count = max(1, len(dataset) // 10)
    data = _TrainingData(torch.from_numpy(dataset.images).to(device), latents, len(dataset) - held_out_count)
    sizes = replace(settings.networks, modes=latents.shape.shape[1])
    networks = _initialise_networks(sizes, data, settings.seed)
    networks.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    run = _CheckpointState(networks)
    checkpoint, fingerprint = Path(out) / "checkpoint.safetensors", _fingerprint(settings, dataset)
    if checkpoint.exists():
        _resume(checkpoint, run, fingerprint)
    for number, factor in enumerate(FACTORS):
        _train_factor(factor, number, run, data, settings, lambda: _save(checkpoint, run, fingerprint), say)
    _calibrate(run.networks, data)
    path = Path(out) / "recognition.safetensors"
    save_paper_weights(run.networks, path)
    return path


def save_paper_weights(networks: PaperNetworks, path: Path) -> None:
    """Write the networks with their settings: weights in half precision, what goes with them in single."""
    parameters = dict(networks.named_parameters())
    tensors = {
        f"network.{name}": (value.half() if name in parameters else value).contiguous()
        for name, value in networks.state_dict().items()
    }
    metadata = {"net": "paper", "format": FORMAT, "settings": json.dumps(asdict(networks.settings))}
    with atomic_write(path) as temporary:
        save_file(tensors, temporary, metadata=metadata)


def _initialise_networks(settings: PaperSettings, data: _TrainingData, seed: int) -> PaperNetworks:
    """Networks with Glorot's initial weights, and the training data's mean image, centre and scale.

    A factor has one scale, so that the learning rate means the same for each and its numbers weigh against
    each other as in the paper's loss.
    """
    torch.manual_seed(seed)
    networks = PaperNetworks(settings)
    for module in networks.modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
            nn.init.xavier_uniform_(module.weight)
            assert module.bias is not None
            nn.init.zeros_(module.bias)
    parts = torch.arange(data.count).split(256)
    total = sum((data.pixels(part).sum(0, dtype=torch.float64) for part in parts), torch.zeros(()))
    mean = (torch.as_tensor(total) / data.count).float().cpu()
    for factor, targets in targets_of(data.latents).items():
        network = networks.of(factor)
        training_targets = targets[: data.count].cpu()
        network.mean_image.copy_(network.channels(mean[None])[0])
        network.centre.copy_(training_targets.mean(0))
        network.scale.copy_(training_targets.var(0).mean().sqrt().clamp_min(1e-3))
    return networks


def _train_factor(
    factor: str,
    number: int,
    run: _CheckpointState,
    data: _TrainingData,
    settings: PaperTrainingSettings,
    save: Callable[[], None],
    say: Callable[[str], None],
) -> None:
    """Train one factor's network from where the run is to its end; leaves its best epoch's weights in it."""
    network, curve = run.networks.of(factor), run.curves[factor]
    parameters = {f"{factor}.{name}": parameter for name, parameter in network.named_parameters()}
    optimizer = torch.optim.SGD(
        network.parameters(), settings.learning_rate, momentum=settings.momentum, nesterov=True
    )
    for name in parameters.keys() & run.momentum.keys():
        momentum = torch.empty_like(parameters[name]).copy_(run.momentum[name])
        optimizer.state[parameters[name]]["momentum_buffer"] = momentum
    targets = targets_of(data.latents)[factor]
    while not _done(curve, settings):
        started = time.monotonic()
        rng = np.random.default_rng(np.random.SeedSequence([settings.seed, number, len(curve)]))
        torch.manual_seed(int(rng.integers(2**31)))  # dropout
        order = torch.from_numpy(rng.permutation(data.count))
        steps = order[: data.count // settings.batch * settings.batch].split(settings.batch)
        network.train()
        total = torch.zeros((), device=targets.device)
        for chosen in steps:
            loss = _loss(network, data.pixels(chosen), targets[chosen])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            total += loss.detach()
        training_seconds = time.monotonic() - started
        held_out = _held_out_loss(network, data, targets)
        curve.append([float(total) / len(steps), held_out, time.monotonic() - started])
        if not np.isfinite(curve[-1]).all():
            raise UserError(
                f"the training of the {factor} network diverged in epoch {len(curve)}; try another --seed"
            )
        best = _best_epoch(curve)
        if best == len(curve) - 1:
            run.best |= {f"{factor}.{name}": value.clone() for name, value in network.state_dict().items()}
        run.momentum = {name: optimizer.state[p]["momentum_buffer"] for name, p in parameters.items()}
        save()
        say(
            f"{factor}: epoch {len(curve)}/{settings.epochs}  loss {curve[-1][0]:.4f}"
            f"  held-out {held_out:.4f} (best {curve[best][1]:.4f} in epoch {best + 1})"
            f"  {len(steps) * settings.batch / training_seconds:.0f} images/s"
        )
    network.load_state_dict({name: run.best[f"{factor}.{name}"] for name in network.state_dict()})


def _loss(network: FactorNetwork, images: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
    """Mean squared error in units of the factor's scale."""
    with bfloat16(images.device):
        predicted = network(images)
    return functional.mse_loss(predicted, targets) / network.scale**2


def _held_out_loss(network: FactorNetwork, data: _TrainingData, targets: torch.Tensor) -> float:
    """The mean of `_loss` over the held-out images."""
    network.eval()
    with torch.inference_mode():
        total = sum(
            float(_loss(network, data.pixels(part), targets[part])) * len(part)
            for part in data.held_out.split(256)
        )
    return total / len(data.held_out)


def _best_epoch(curve: list[list[float]]) -> int:
    """Index of the epoch with the least held-out loss, the first of them."""
    return int(np.argmin([held_out for _, held_out, _ in curve]))


def _done(curve: list[list[float]], settings: PaperTrainingSettings) -> bool:
    if not curve:
        return False
    return len(curve) >= settings.epochs or len(curve) - 1 - _best_epoch(curve) >= settings.patience


@torch.inference_mode()
def _calibrate(networks: PaperNetworks, data: _TrainingData) -> None:
    """Set the networks' standard deviations from their errors on the held-out images.

    Azimuth is off by half a turn at times, so its deviation is robust: 1.4826 times the median absolute
    error. Of the other numbers it is the root mean square error.
    """
    networks.eval()
    with bfloat16(data.images.device):
        outputs = [networks.numbers(data.pixels(part)) for part in data.held_out.split(64)]
    azimuth, numbers = (torch.cat(column) for column in zip(*outputs, strict=True))
    truth = data.latents[data.held_out]
    azimuth_error = angle_difference(azimuth, truth.azimuth)
    networks.azimuth_deviation.copy_((_DEVIATION_PER_MAD * azimuth_error.abs().median()).clamp_min(1e-3))
    networks.deviation.copy_((numbers - numbers_of(truth)).square().mean(0).sqrt().clamp_min(1e-3))


def _save(path: Path, run: _CheckpointState, fingerprint: str) -> None:
    """Write the checkpoint, and the curves as a table beside it."""
    tensors = {f"now.{name}": value for name, value in run.networks.factors.state_dict().items()}
    tensors |= {f"best.{name}": value for name, value in run.best.items()}
    tensors |= {f"momentum.{name}": value for name, value in run.momentum.items()}
    for factor, curve in run.curves.items():
        tensors[f"curve.{factor}"] = torch.tensor(curve, dtype=torch.float64).view(-1, 3)
    metadata = {"epoch": str(sum(len(curve) for curve in run.curves.values())), "run": fingerprint}
    with atomic_write(path) as temporary:
        save_file({name: value.contiguous() for name, value in tensors.items()}, temporary, metadata=metadata)
    with atomic_write(path.with_name("log.csv")) as temporary, open(temporary, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["factor", "epoch", "loss", "held_out_loss", "seconds"])
        for factor, curve in run.curves.items():
            for epoch, (loss, held_out, seconds) in enumerate(curve, 1):
                writer.writerow([factor, epoch, f"{loss:.6g}", f"{held_out:.6g}", f"{seconds:.1f}"])


def _resume(path: Path, run: _CheckpointState, fingerprint: str) -> None:
    """Put a checkpoint back into `run`."""
    with reading(path, "a checkpoint of a training run", "Remove it to train from the start."):
        tensors, state = read_tensors(path, "pt")
        if state["run"] != fingerprint:
            raise UserError(
                f"'{path.parent}' holds another training run's checkpoint; choose another folder or remove it"
            )
        current, run.best, run.momentum, curves = (
            {name.removeprefix(part): value for name, value in tensors.items() if name.startswith(part)}
            for part in ("now.", "best.", "momentum.", "curve.")
        )
        run.networks.factors.load_state_dict(current)
        run.curves = {factor: curves[factor].tolist() for factor in FACTORS}


def _fingerprint(settings: PaperTrainingSettings, dataset: Dataset) -> str:
    """Settings and data that a checkpoint must match to be resumed."""
    data = zlib.crc32(np.ascontiguousarray(dataset.latents).tobytes())
    described = {"net": "paper"} | asdict(settings) | {"count": len(dataset), "data": data}
    return json.dumps({name: value for name, value in described.items() if name != "threads"})
