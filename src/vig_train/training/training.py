"""Training of the recognition network on a dataset and fresh drawings, resumable from its last epoch."""

from __future__ import annotations

import json
import math
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import torch
from torch import nn

from vig.io.checks import decode, parse_json, read_tensors, reading
from vig.io.progress import Meter
from vig.recognition import WEIGHTS_FILE
from vig.recognition.network import NetworkSettings, layout_of_numbers
from vig.recognition.weights import TRUNK_PREFIXES, whole_tensors
from vig.scene import Symmetry
from vig_train.network.network import RecognitionNetwork, bfloat16
from vig_train.network.weights import as_tensors
from vig_train.training.augmentation import Augmentation, Batch
from vig_train.training.checkpoint import Scale, save_weights
from vig_train.training.drawing import Drawing, add_drawn_examples, drawn_once
from vig_train.training.examples import Examples, hold_out
from vig_train.training.loop import Trainer, TrainingRun, check_amounts
from vig_train.training.losses import LOSS_WEIGHTS, losses
from vig_world.dataset import Dataset

TRUNK_RATE = 0.3
"""Learning rate of a trunk that was trained before, over that of the rest."""
REPORT_SECONDS = 300.0
"""Seconds between lines on the time left, in a log."""
HEAD_PARTS = ("dense", "azimuth", "numbers", "others")
"""The network's dense layer and the heads that read from it."""


@dataclass(frozen=True)
class TrainingSettings:
    """Settings of the training.

    Attributes:
        epochs: Passes over the datasets' training images, at most.
        batch: Images of the datasets per step.
        drawing: Further images for each step, drawn afresh; None for the datasets alone.
        start: Weights to begin with: all that fits of a file of `vig train`.
        trunk_only: Take only the trunk from it.
        frozen: Number of the trunk's first stages that stay as they are in `start`.
        mask_alone: Whether all but the mask's decoder stays as it is in `start`.
        learning_rate: The highest; see `Schedule`.
        weight_decay: Weight decay of AdamW.
        validation: Most images of held-out rooms that are used.
        patience: Epochs without a better validation loss after which training ends.
        augmentation: Augmentation of the training images.
        symmetry: Symmetry of the class, under which azimuths are the same.
        mirror: Whether shapes of the class are their own mirror images; if not, no image is flipped.
        network: Sizes; the number of shape components is the datasets'.
        seed: Seed of weights, order, drawing and augmentation.
        threads: Threads of the CPU, all by default.
    """

    epochs: int = 18
    batch: int = 40
    drawing: Drawing | None = None
    start: Path | None = None
    trunk_only: bool = False
    frozen: int = 3
    mask_alone: bool = False
    learning_rate: float = 2e-3
    weight_decay: float = 2e-2
    validation: int = 2000
    patience: int = 6
    augmentation: Augmentation = Augmentation()
    symmetry: Symmetry = Symmetry.NONE
    mirror: bool = True
    network: NetworkSettings = NetworkSettings()
    seed: int = 0
    threads: int | None = None

    def fingerprint(self, datasets: Sequence[Dataset]) -> str:
        """Return settings and data that a checkpoint must match to be resumed."""
        data = 0
        for dataset in datasets:
            data = zlib.crc32(np.ascontiguousarray(dataset.latents).tobytes(), data)
        count = sum(map(len, datasets))
        described = asdict(self) | {"count": count, "data": data, "start": str(self.start)}
        described["drawing"] = None if self.drawing is None else self.drawing.resume_settings()
        left_out = {"threads": self.threads, "symmetry": Symmetry.NONE, "mirror": True, "mask_alone": False}
        return json.dumps({k: value for k, value in described.items() if (k, value) not in left_out.items()})


@dataclass(frozen=True)
class Epoch:
    """Losses and errors of one pass over the training images.

    Attributes:
        number: From 1 on.
        trained: Each part of the loss, mean over the pass.
        validated: The same on the held-out images, of the averaged weights.
        errors: Errors of the averaged weights on the held-out images, in their own units.
    """

    number: int
    trained: dict[str, float]
    validated: dict[str, float]
    errors: dict[str, float]


def train(
    datasets: Sequence[Dataset],
    out: Path,
    settings: TrainingSettings,
    say: Callable[[str], None] = print,
    record: Callable[[Epoch], None] = lambda epoch: None,
    progress: bool = False,
) -> Path:
    """Train on datasets but for the rooms that are held out.

    On a GPU where there is one, in bfloat16 where the processor has it. An interrupted run resumes from the
    checkpoint that is written after each epoch.

    Args:
        datasets: Training data, their images in one order.
        out: Folder of the weights and the checkpoint.
        settings: Settings of the training.
        say: Called with a line after each epoch.
        record: Called after each epoch, before the checkpoint is written.
        progress: Report the time left on standard error.

    Returns:
        The path of the weights: their exponential moving average after the epoch of least held-out loss.

    Raises:
        UserError: The datasets are too small, the settings train nothing, or `out` holds a checkpoint that is
            damaged or of another run.
    """
    check_amounts(settings, datasets)
    chosen, held_out = (torch.from_numpy(indices) for indices in hold_out(datasets, settings.validation))
    examples = Examples.concatenate([Examples.of(dataset) for dataset in datasets])
    fingerprint = settings.fingerprint(datasets)
    return train_on_examples(examples, chosen, held_out, out, settings, fingerprint, say, record, progress)


def train_on_examples(
    examples: Examples,
    chosen: torch.Tensor,
    held_out: torch.Tensor,
    out: Path,
    settings: TrainingSettings,
    fingerprint: str,
    say: Callable[[str], None] = print,
    record: Callable[[Epoch], None] = lambda epoch: None,
    progress: bool = False,
) -> Path:
    """Train on chosen examples, validate on others, by their indices; see `train`.

    fingerprint: of settings and data, which a checkpoint must match.
    """
    if settings.threads is not None:
        torch.set_num_threads(settings.threads)
    state, steps = _TrainingState.begin(settings, examples, chosen), len(chosen) // settings.batch
    path, average = Path(out) / WEIGHTS_FILE, state.networks["average"]
    run = TrainingRun(
        state.trainer.optimizer,
        state.networks,
        Path(out) / "checkpoint.safetensors",
        fingerprint,
    )
    drawing, once = settings.drawing, None
    if drawing is not None and drawing.distinct:
        with Meter(drawing.distinct, 0, progress, "images", REPORT_SECONDS) as drawn:
            once = drawn_once(drawing, Path(out), settings.seed, drawn.advance)
    batches = state.batches(examples, chosen, run.done(), once)
    with Meter(settings.epochs * steps, run.done() * steps, progress, "steps", REPORT_SECONDS) as meter:
        for number in run.epochs(settings.epochs, settings.patience):
            started = time.monotonic()
            state.begin_epoch(number)
            trained = state.trainer.steps(islice(batches, steps), number * steps, meter.advance)
            speed = len(chosen) / (time.monotonic() - started)
            validated, errors = validate(average, examples, held_out, state.scale, settings.symmetry)
            loss = sum(LOSS_WEIGHTS[name] * value for name, value in validated.items())
            is_best = run.judge(loss)
            record(Epoch(number + 1, trained, validated, errors))
            if is_best:
                save_weights(average, state.scale, path)
            run.save()
            listed = "  ".join(f"{name} {value:.3g}" for name, value in errors.items())
            say(f"epoch {number + 1}/{settings.epochs}  loss {loss:.3f}  {listed}  {speed:.0f} images/s")
    if run.done() < settings.epochs:
        say(f"no better for {settings.patience} epochs; the weights are those after epoch {run.best_epoch}")
    return path


@dataclass(frozen=True)
class _TrainingState:
    """A network in training, the average of its weights, and its optimiser."""

    settings: TrainingSettings
    networks: dict[str, RecognitionNetwork]
    trainer: Trainer[Batch]
    scale: Scale
    device: torch.device

    @staticmethod
    def begin(settings: TrainingSettings, examples: Examples, chosen: torch.Tensor) -> _TrainingState:
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        numbers = examples.numbers[chosen]
        scale = {"mean": numbers.mean(0), "deviation": numbers.std(0).clamp_min(1e-3)}
        torch.manual_seed(settings.seed)
        sizes = replace(settings.network, modes=layout_of_numbers(numbers.shape[1]).count("shape"))
        if settings.start is not None and not (settings.trunk_only or sizes.context):
            sizes = replace(sizes, context=_setting_of(settings.start, "context", []))
        if settings.start is not None and settings.mask_alone:
            sizes = replace(sizes, object_map=_setting_of(settings.start, "object_map", 0))
        network, average = (RecognitionNetwork(sizes).to(device) for _ in range(2))
        if settings.start is not None:
            needed = HEAD_PARTS if settings.mask_alone else ()
            start_scale = load_start_weights(network, settings.start, settings.trunk_only, needed)
            # Heads that stay as they are speak in the units of their own training.
            scale = start_scale if settings.mask_alone else scale
            for part in _frozen_parts(network, settings):
                part.requires_grad_(False)
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        average.load_state_dict(network.state_dict())
        named = [(name, value) for name, value in network.named_parameters() if value.requires_grad]
        trunk_parameters = [value for name, value in named if name.startswith(TRUNK_PREFIXES)]
        head_parameters = [value for name, value in named if not name.startswith(TRUNK_PREFIXES)]
        share = TRUNK_RATE if settings.start is not None else 1.0
        groups = [{"params": head_parameters, "share": 1.0}, {"params": trunk_parameters, "share": share}]
        units = {name: value.to(device) for name, value in scale.items()}

        def loss(batch: Batch) -> dict[str, torch.Tensor]:
            scaled = replace(batch, numbers=(batch.numbers - units["mean"]) / units["deviation"])
            with bfloat16(device):
                heads = network(batch.images)
            return losses(heads, scaled, settings.symmetry)

        steps = settings.epochs * (len(chosen) // settings.batch)
        trainer = Trainer.adamw(
            groups, loss, settings.learning_rate, steps, settings.weight_decay, LOSS_WEIGHTS
        )
        trainer = replace(trainer, max_norm=5.0, average=(network, average))
        return _TrainingState(settings, {"network": network, "average": average}, trainer, scale, device)

    def begin_epoch(self, number: int) -> None:
        """Seed an epoch's randomness and put the network into training mode, except for frozen parts."""
        seed = np.random.SeedSequence([self.settings.seed, number]).generate_state(1)[0]
        torch.manual_seed(int(seed >> 1))
        network = self.networks["network"].train()
        if self.settings.start is not None:
            for part in _frozen_parts(network, self.settings):
                part.eval()

    def batches(
        self, examples: Examples, chosen: torch.Tensor, first_epoch: int, once: Examples | None = None
    ) -> Iterator[Batch]:
        """Yield augmented batches of all epochs from `first_epoch` on, in order, on the network's device.

        once: Images of the studio that were drawn before.
        """
        settings = self.settings
        steps = len(chosen) // settings.batch

        def dataset_steps() -> Iterator[tuple[Examples, int]]:
            for epoch in range(first_epoch, settings.epochs):
                rng = np.random.default_rng(np.random.SeedSequence([settings.seed, epoch]))
                order = chosen[torch.from_numpy(rng.permutation(len(chosen)))]
                for step, part in enumerate(order[: steps * settings.batch].split(settings.batch)):
                    yield examples[part], epoch * steps + step

        examples_of_steps = dataset_steps()
        if drawing := settings.drawing:
            examples_of_steps = add_drawn_examples(examples_of_steps, drawing, settings.seed, once)
        augment = settings.augmentation if settings.mirror else replace(settings.augmentation, flip=0.0)
        library = None if drawing is None else drawing.library(settings.seed)
        library = None if library is None else library.to(self.device)
        for part, step in examples_of_steps:
            yield augment(part.to(self.device), np.random.default_rng([settings.seed, step, 1]), library)


def load_start_weights(
    network: RecognitionNetwork, path: Path, trunk_only: bool, needed: tuple[str, ...] = ()
) -> Scale:
    """Give a network those weights of a file that fit it, or of these only the trunk's.

    Args:
        network: Network that gets them.
        path: Path of the file.
        trunk_only: Whether to take only the trunk's.
        needed: Parts of the network of which all must fit, besides the trunk.

    Returns:
        The scale of the targets of the file's own training; empty where it has none.

    Raises:
        UserError: The file is no weights file, or needed parts have other sizes in it.
    """
    with reading(path, "recognition weights", "Take a file of `vig train`."):
        tensors = as_tensors(whole_tensors(*read_tensors(path)))
        own_weights = network.state_dict()
        fitting = {
            name: value.to(own_weights[name].dtype)
            for name, value in ((k.removeprefix("network."), v) for k, v in tensors.items())
            if name in own_weights and own_weights[name].shape == value.shape
        }
        if missing := [
            name
            for name in own_weights
            if name.startswith((*TRUNK_PREFIXES, *(f"{part}." for part in needed))) and name not in fitting
        ]:
            what = "trunk has" if missing[0].startswith(TRUNK_PREFIXES) else "heads have"
            raise ValueError(f"its {what} other sizes than the network's, at '{missing[0]}'")
    loaded = {
        name: value for name, value in fitting.items() if name.startswith(TRUNK_PREFIXES) or not trunk_only
    }
    network.load_state_dict(loaded, strict=False)
    return {k.removeprefix("scale."): value for k, value in tensors.items() if k.startswith("scale.")}


def _setting_of(path: Path, name: str, without: Any) -> Any:
    """Return a field of `NetworkSettings` of a weights file, `without` where the file lacks it."""
    with reading(path, "recognition weights", "Take a file of `vig train`."):
        _, metadata = read_tensors(path)
        settings = decode(dict[str, Any], parse_json(metadata.get("settings", "{}")))
        return decode(get_type_hints(NetworkSettings)[name], settings.get(name, without))


def _frozen_parts(network: RecognitionNetwork, settings: TrainingSettings) -> list[nn.Module]:
    """Return the first stages of the trunk, with the stem, or all but the mask's decoder."""
    if settings.mask_alone:
        return [network.stem, *network.stages, *(getattr(network, name) for name in HEAD_PARTS)]
    return [network.stem, *network.stages[: settings.frozen]] if settings.frozen else []


@torch.inference_mode()
def validate(
    network: RecognitionNetwork,
    examples: Examples,
    chosen: torch.Tensor,
    scale: Scale,
    symmetry: Symmetry = Symmetry.NONE,
) -> tuple[dict[str, float], dict[str, float]]:
    """Return mean losses, and errors in their own units, on chosen examples without augmentation."""
    network.eval()
    device = next(network.parameters()).device
    sums, azimuths, elevations, shapes = dict.fromkeys(LOSS_WEIGHTS, 0.0), [], [], []
    hits = unions = 0.0
    for indices in chosen.split(128):
        part_examples = examples[indices]
        numbers = (part_examples.numbers - scale["mean"]) / scale["deviation"]
        mask = part_examples.mask()
        present, pixels = part_examples.present(), part_examples.pixels()
        batch = Batch(part_examples.azimuth, numbers, part_examples.roll, present, pixels, mask).to(device)
        with bfloat16(device):
            heads = network(batch.images)
        for name, loss in losses(heads, batch, symmetry).items():
            sums[name] += float(loss) * len(indices) / len(chosen)
        bins = heads.azimuth.shape[1]
        best_azimuth = (heads.azimuth.argmax(1).cpu() + 0.5) * (2 * math.pi / bins)
        azimuth_error = symmetry.difference(best_azimuth, part_examples.azimuth)
        azimuths.append(azimuth_error.abs().rad2deg())
        error = (heads.mean.cpu() - numbers).abs() * scale["deviation"]
        parts = layout_of_numbers(error.shape[1]).split(error)
        elevations.append(parts["elevation"][:, 0].rad2deg())
        shapes.append(parts["shape"][:, :3].mean(1))
        visible, predicted = mask[:, 0] > 0.5, heads.mask.argmax(1).cpu() == 0
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
