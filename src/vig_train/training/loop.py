"""The loop by which every network is trained: steps of an optimiser, and epochs that resume."""

import csv
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from torch import nn

from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig_train.training.checkpoint import load_checkpoint, save_checkpoint
from vig_world.dataset import Dataset

B = TypeVar("B")


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


@dataclass(frozen=True)
class Trainer(Generic[B]):
    """Steps of an optimiser on batches of any type.

    Attributes:
        optimizer: Its groups may have a `share`, a factor on their learning rate.
        loss: From a batch to the parts of its loss.
        rate: Learning rate by step.
        weights: Weights of the parts of the loss; 1 where none is given.
        max_norm: Norm to which gradients are clipped; None for no clipping.
        average: A module, and the one that becomes the moving average of its weights.
    """

    optimizer: torch.optim.Optimizer
    loss: Callable[[B], Mapping[str, torch.Tensor]]
    rate: Callable[[int], float]
    weights: Mapping[str, float] = field(default_factory=dict)
    max_norm: float | None = None
    average: tuple[nn.Module, nn.Module] | None = None

    @staticmethod
    def adamw(
        parameters: Iterable[Any],
        loss: Callable[[B], Mapping[str, torch.Tensor]],
        learning_rate: float,
        steps: int,
        weight_decay: float = 2e-2,
        weights: Mapping[str, float] | None = None,
    ) -> "Trainer[B]":
        """Return a trainer with AdamW on parameters, or groups of them; its rate follows `Schedule`."""
        optimizer = torch.optim.AdamW(parameters, learning_rate, weight_decay=weight_decay, fused=True)
        return Trainer(optimizer, loss, Schedule(learning_rate, steps), weights or {})

    def steps(
        self, batches: Iterable[B], first: int = 0, advance: Callable[[int], None] = lambda steps: None
    ) -> dict[str, float]:
        """Take a step for each batch; return the mean of each part of the loss.

        Args:
            batches: In order.
            first: Number of the first step, for the learning rate.
            advance: Called with 1 after each step.
        """
        sums: dict[str, torch.Tensor] = {}
        count = 0
        for batch in batches:
            parts = self.loss(batch)
            self.optimizer.zero_grad()
            torch.stack([self.weights.get(name, 1.0) * part for name, part in parts.items()]).sum().backward()
            groups = self.optimizer.param_groups
            if self.max_norm is not None:
                nn.utils.clip_grad_norm_([p for group in groups for p in group["params"]], self.max_norm)
            for group in groups:
                group["lr"] = self.rate(first + count) * group.get("share", 1.0)
            self.optimizer.step()
            if self.average is not None:
                # Decay per step: 0.998, less in the first steps, whose weights are of no use.
                update_average(*self.average, min(0.998, (1 + first + count) / (10 + first + count)))
            sums = {name: sums.get(name, 0) + part.detach() for name, part in parts.items()}
            count += 1
            advance(1)
        return {name: float(total) / count for name, total in sums.items()}


def update_average(network: nn.Module, average: nn.Module, keep: float) -> None:
    """Move the exponential moving average of a network's weights and statistics."""
    with torch.no_grad():
        for averaged, current in zip(
            average.state_dict().values(), network.state_dict().values(), strict=True
        ):
            if averaged.is_floating_point():
                averaged.lerp_(current, 1 - keep)
            else:
                averaged.copy_(current)


class TrainingRun:
    """Epochs of a training and its checkpoint, from which an interrupted run resumes.

    Args:
        optimizer: Optimizer of the training.
        networks: By name, as the checkpoint keeps them; they take on its weights where it exists.
        checkpoint: Its path; None for none.
        fingerprint: Fingerprint of settings and data, which a checkpoint must match.

    Attributes:
        best_epoch: The best so far of the part that is trained, from 1 on.

    Raises:
        UserError: The checkpoint is damaged, or of another run.
    """

    def __init__(
        self,
        optimizer: torch.optim.Optimizer,
        networks: Mapping[str, nn.Module],
        checkpoint: Path | None,
        fingerprint: str,
    ) -> None:
        self.optimizer, self.networks, self.checkpoint = optimizer, networks, checkpoint
        self.part, self.best_epoch, self._best = "", 0, math.inf
        self._state = {"run": fingerprint}
        if checkpoint is not None and checkpoint.exists():
            self._state = load_checkpoint(checkpoint, networks, optimizer, fingerprint)

    def done(self, part: str = "") -> int:
        """Return how many epochs of a part of the training are done."""
        return int(self._state.get(f"{part}epoch", 0))

    def epochs(self, count: int, patience: int | None = None, part: str = "") -> Iterator[int]:
        """Yield the numbers, from 0 on, of the epochs to train; each ends with `judge` and `save`.

        Args:
            count: Epochs, at most.
            patience: Epochs without a better held-out loss after which training ends.
            part: Name of these epochs where a run trains several networks one after the other.
        """
        self.part = part
        self._best = float(self._state.get(f"{part}best", math.inf))
        self.best_epoch = int(self._state.get(f"{part}best_at", 0))
        for number in range(self.done(part), count):
            if patience is not None and number - self.best_epoch >= patience:
                break
            self._state[f"{part}epoch"] = str(number + 1)
            yield number

    def judge(self, loss: float) -> bool:
        """Return whether this epoch's held-out loss is the least so far.

        Raises:
            UserError: It is not finite.
        """
        number = self._state[f"{self.part}epoch"]
        if not math.isfinite(loss):
            named = f"the {self.part} network" if self.part else "the network"
            raise UserError(f"the training of {named} diverged in epoch {number}; try another --seed")
        if loss >= self._best:
            return False
        self._best, self.best_epoch = loss, int(number)
        return True

    def save(self) -> None:
        """Write the checkpoint."""
        self._state |= {f"{self.part}best": repr(self._best), f"{self.part}best_at": str(self.best_epoch)}
        if self.checkpoint is not None:
            save_checkpoint(self.checkpoint, self.networks, self.optimizer, self._state)


def check_amounts(settings: Any, datasets: Sequence[Dataset]) -> None:
    """Raise UserError when settings with `epochs`, `seed` and `batch` train nothing on datasets."""
    for name, least in (("epochs", 1), ("seed", 0)):
        if getattr(settings, name) < least:
            raise UserError(f"{name} must be at least {least}; got {getattr(settings, name)}")
    count = sum(map(len, datasets))
    if count < 2 * settings.batch:
        folders = ", ".join(f"'{dataset.folder}'" for dataset in datasets)
        raise UserError(f"training needs at least {2 * settings.batch} images; {folders} has {count}")


class EpochLog:
    """A table of epochs as a CSV file, which a run that resumes goes on with.

    Args:
        path: Path of the file; rows that it has stay.
        keys: Columns that name a row; the last is the epoch's number.
    """

    def __init__(self, path: Path, keys: Sequence[str] = ("epoch",)) -> None:
        self.path, self.keys = path, keys
        self.rows: list[dict[str, str]] = []
        if path.is_file():
            with open(path, newline="") as file:
                self.rows = list(csv.DictReader(file))

    def add(self, row: Mapping[str, str]) -> None:
        """Write a row; it replaces those of its own and of later epochs, of a run that was stopped."""
        *part, epoch = self.keys
        self.rows = [
            old
            for old in self.rows
            if any(old[name] != row[name] for name in part) or int(old[epoch]) < int(row[epoch])
        ] + [dict(row)]
        with atomic_write(self.path) as temporary, open(temporary, "w", newline="") as file:
            writer = csv.DictWriter(file, list(row))
            writer.writeheader()
            writer.writerows(self.rows)
