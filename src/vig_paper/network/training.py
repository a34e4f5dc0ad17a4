"""Training of the paper's recognition networks one after the other, resumable from the last epoch."""

import json
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from vig.recognition.weights import FORMAT
from vig.scene import Latents, angle_difference
from vig_paper.network.network import FACTORS, FactorNetwork, PaperNetworks, PaperSettings, targets_of
from vig_train.network.network import bfloat16
from vig_train.network.weights import save_tensors
from vig_train.training.loop import EpochLog, Trainer, TrainingRun, check_amounts
from vig_train.training.targets import numbers_of
from vig_world.dataset import Dataset


@dataclass(frozen=True)
class PaperTrainingSettings:
    """Settings of the training: the paper's numbers, but for smaller batches.

    Attributes:
        epochs: Epochs of each network, at most.
        patience: A network is done this many epochs after its best one.
        batch: Images per step. The paper's are of 128, with which losses fall less by an epoch.
        learning_rate: Step size of stochastic gradient descent.
        momentum: Nesterov's.
        seed: Seed of weights and order.
        threads: Threads of the CPU, all by default.
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


@dataclass(frozen=True)
class _TrainingData:
    """images (N, H, W, 3) uint8 and latents on the training device; the first `count` are trained on."""

    images: torch.Tensor
    latents: Latents
    count: int

    @property
    def held_out(self) -> torch.Tensor:
        """Return indices of the images that no network is trained on."""
        return torch.arange(self.count, len(self.images))

    def pixels(self, chosen: torch.Tensor) -> torch.Tensor:
        """Return the network input (B, 3, H, W), sRGB in [0, 1]."""
        return self.images[chosen].permute(0, 3, 1, 2).float() / 255


def train_paper(
    dataset: Dataset, out: Path, settings: PaperTrainingSettings, say: Callable[[str], None] = print
) -> Path:
    """Train the networks on all but the last tenth of the images.

    On a GPU where there is one, in bfloat16 where the processor computes in it. An interrupted run resumes
    from the checkpoint that is written after each epoch. The standard deviations in the weights are those of
    the held-out images, which also chose the best epoch.

    Args:
        dataset: Training data.
        out: Folder of the weights, the checkpoint, and log.csv with the losses of every epoch.
        settings: Settings of the training.
        say: Called with a line after each epoch.

    Returns:
        The weights' path.

    Raises:
        UserError: The dataset is too small, the settings train nothing, the training diverges, or `out` holds
            a checkpoint that is damaged or of another run.
    """
    check_amounts(settings, [dataset])
    if settings.threads is not None:
        torch.set_num_threads(settings.threads)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    latents = Latents.from_vector(torch.from_numpy(dataset.latents).to(device))
    held_out_count = max(1, len(dataset) // 10)
    data = _TrainingData(torch.from_numpy(dataset.images).to(device), latents, len(dataset) - held_out_count)
    sizes = replace(settings.networks, modes=latents.shape.shape[1])
    networks = _initialise_networks(sizes, data, settings.seed)
    best = PaperNetworks(sizes)
    for module in (networks, best):
        module.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimizer = torch.optim.SGD(
        networks.factors.parameters(), settings.learning_rate, momentum=settings.momentum, nesterov=True
    )
    kept = {"now": networks.factors, "best": best.factors}
    path, fingerprint = Path(out) / "checkpoint.safetensors", _fingerprint(settings, dataset)
    run = TrainingRun(optimizer, kept, path, fingerprint)
    log = EpochLog(Path(out) / "log.csv", ("factor", "epoch"))
    for number, factor in enumerate(FACTORS):
        _train_factor(factor, number, run, data, settings, log, say)
    networks.factors.load_state_dict(best.factors.state_dict())
    _calibrate(networks, data)
    path = Path(out) / "recognition.safetensors"
    save_paper_weights(networks, path)
    return path


def save_paper_weights(networks: PaperNetworks, path: Path) -> None:
    """Write the networks with their settings: weights in half precision, buffers in single."""
    parameters = dict(networks.named_parameters())
    tensors = {
        f"network.{name}": value.half() if name in parameters else value
        for name, value in networks.state_dict().items()
    }
    metadata = {"net": "paper", "format": FORMAT, "settings": json.dumps(asdict(networks.settings))}
    save_tensors(path, tensors, metadata)


def _initialise_networks(settings: PaperSettings, data: _TrainingData, seed: int) -> PaperNetworks:
    """Return networks with Glorot's initial weights, and the training data's mean image, centre and scale.

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
    run: TrainingRun,
    data: _TrainingData,
    settings: PaperTrainingSettings,
    log: EpochLog,
    say: Callable[[str], None],
) -> None:
    """Train one factor's network from where the run is to its end."""
    network, best = (run.networks[name].get_submodule(factor) for name in ("now", "best"))
    assert isinstance(network, FactorNetwork)
    targets = targets_of(data.latents)[factor]
    steps = data.count // settings.batch

    def batches(epoch: int) -> Iterator[torch.Tensor]:
        rng = np.random.default_rng(np.random.SeedSequence([settings.seed, number, epoch]))
        torch.manual_seed(int(rng.integers(2**31)))  # dropout
        order = torch.from_numpy(rng.permutation(data.count))
        yield from order[: steps * settings.batch].split(settings.batch)

    def loss(chosen: torch.Tensor) -> dict[str, torch.Tensor]:
        return {"loss": _loss(network, data.pixels(chosen), targets[chosen])}

    trainer = Trainer(run.optimizer, loss, lambda step: settings.learning_rate)
    for epoch in run.epochs(settings.epochs, settings.patience, factor):
        started = time.monotonic()
        network.train()
        trained = trainer.steps(batches(epoch))["loss"]
        training_seconds = time.monotonic() - started
        held_out = _held_out_loss(network, data, targets)
        if run.judge(held_out):
            best.load_state_dict(network.state_dict())
        seconds = time.monotonic() - started
        row = {"loss": f"{trained:.6g}", "held_out_loss": f"{held_out:.6g}", "seconds": f"{seconds:.1f}"}
        log.add({"factor": factor, "epoch": str(epoch + 1)} | row)
        run.save()
        say(
            f"{factor}: epoch {epoch + 1}/{settings.epochs}  loss {trained:.4f}"
            f"  held-out {held_out:.4f} (best in epoch {run.best_epoch})"
            f"  {steps * settings.batch / training_seconds:.0f} images/s"
        )


def _loss(network: FactorNetwork, images: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
    """Return the mean squared error in units of the factor's scale."""
    with bfloat16(images.device):
        predicted = network(images)
    return functional.mse_loss(predicted, targets) / network.scale**2


def _held_out_loss(network: FactorNetwork, data: _TrainingData, targets: torch.Tensor) -> float:
    """Return the mean of `_loss` over the held-out images."""
    network.eval()
    with torch.inference_mode():
        total = sum(
            float(_loss(network, data.pixels(part), targets[part])) * len(part)
            for part in data.held_out.split(256)
        )
    return total / len(data.held_out)


@torch.inference_mode()
def _calibrate(networks: PaperNetworks, data: _TrainingData) -> None:
    """Set the networks' standard deviations from their errors on the held-out images.

    Azimuth is off by half a turn at times, so its deviation is robust: 1.4826 times the median absolute
    error. For the other numbers it is the root mean square error.
    """
    networks.eval()
    with bfloat16(data.images.device):
        outputs = [networks.numbers(data.pixels(part)) for part in data.held_out.split(64)]
    azimuth, numbers = (torch.cat(column) for column in zip(*outputs, strict=True))
    truth = data.latents[data.held_out]
    azimuth_error = angle_difference(azimuth, truth.azimuth)
    # standard deviation of a Gaussian over the median of its absolute values
    networks.azimuth_deviation.copy_((1.4826 * azimuth_error.abs().median()).clamp_min(1e-3))
    networks.deviation.copy_((numbers - numbers_of(truth)).square().mean(0).sqrt().clamp_min(1e-3))


def _fingerprint(settings: PaperTrainingSettings, dataset: Dataset) -> str:
    """Return settings and data that a checkpoint must match to be resumed."""
    data = zlib.crc32(np.ascontiguousarray(dataset.latents).tobytes())
    described = {"net": "paper"} | asdict(settings) | {"count": len(dataset), "data": data}
    return json.dumps({name: value for name, value in described.items() if name != "threads"})
