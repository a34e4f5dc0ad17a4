"""The dense heads of a class's network: an ensemble, each member trained on features by itself."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.nn.utils.fusion import fuse_linear_bn_eval

from vig.io.checks import read_tensors, reading
from vig.parallel import map_in_processes
from vig.recognition import Recognizer
from vig.recognition.network import LOG_VARIANCE
from vig.recognition.weights import unpack_matrix
from vig_train.network.network import DenseHeads, RecognitionNetwork, bfloat16
from vig_train.network.weights import pack_matrix, save_tensors
from vig_train.training.checkpoint import Scale
from vig_train.training.class_network import CHUNK, LEARNING_RATE, PASSES, SIZES, ClassImages, Features
from vig_train.training.loop import Trainer
from vig_train.training.losses import LOSS_WEIGHTS, dense_losses

HEADS = ("azimuth", "numbers", "others")  # the network's dense heads
PACKED_MATRICES = ("dense.2.weight", "recalled.weight")  # matrices of the network that are written in 4 bits
EPOCHS = 20  # passes over the features; of 12, 20 and 40 twenty was best on real cars, of one network


class _Member(nn.Module):
    """Dense layer and heads of one member, with normalisation that becomes part of the layer at the end."""

    def __init__(self, modes: int):
        super().__init__()
        count = SIZES.members
        sizes = replace(
            SIZES, modes=modes, squeezed=SIZES.squeezed // count, features=SIZES.features // count, members=1
        )
        network = RecognitionNetwork(sizes)
        self.squeeze, self.dropout = network.dense[0], network.dense[4]
        self.linear: nn.Linear = network.dense[2]  # type: ignore[assignment]
        self.normalise = nn.BatchNorm1d(sizes.features)
        self.azimuth, self.numbers, self.others = network.azimuth, network.numbers, network.others

    def forward(self, coarse: torch.Tensor) -> DenseHeads:
        read = self.dropout(self.squeeze(coarse).flatten(1))
        features = self.dropout(torch.relu(self.normalise(self.linear(read))))
        mean, log_variance = self.numbers(features).chunk(2, dim=1)
        roll, presence = self.others(features).unbind(1)
        return DenseHeads(self.azimuth(features), mean, log_variance.clamp(*LOG_VARIANCE), roll, presence)


@dataclass(frozen=True)
class HeadsTraining:
    """Settings of the dense heads' training.

    Attributes:
        images: The class's images; their seed is that of weights and order, too.
        chunks: Number of their files.
        folds: Member k below `folds` does not see objects drawn after models k modulo `folds`, so that it
            can be tested on these, see `keep_member`; with one fold every member sees all.
        out: Folder where each member's weights are written; those that are there are not trained again.
        epochs: Passes over the features.
    """

    images: ClassImages
    chunks: int
    folds: int
    out: Path
    epochs: int = EPOCHS

    @property
    def steps(self) -> int:
        """Return the approximate number of steps of a member."""
        rows = PASSES * CHUNK * self.chunks
        return self.epochs * (rows // min(256, rows))

    def path(self, number: int) -> Path:
        """Return the path of a member's weights."""
        return self.out / f"member-{number}.safetensors"

    def run(
        self, network: RecognitionNetwork, processes: int, advance: Callable[[int], None] = lambda steps: None
    ) -> Scale:
        """Train all members, each on one core, and put them into a network; returns the targets' scale.

        advance: called with the steps of each member when it is done.
        """
        missing = [number for number in range(SIZES.members) if not self.path(number).exists()]
        advance(self.steps * (SIZES.members - len(missing)))
        for _ in map_in_processes(_prepare, self, missing, min(processes, max(1, len(missing)))):
            advance(self.steps)
        members = []
        for number in range(SIZES.members):
            members.append(_Member(self.images.object_class.shape_model.modes).eval())
            with reading(self.path(number), "a member of a network", "Remove it: it is trained again."):
                tensors, _ = read_tensors(self.path(number), "pt")
                scale = {name: tensors.pop(f"scale.{name}") for name in ("mean", "deviation")}
                members[-1].load_state_dict(tensors)
        _join(network, members)
        return scale


def _prepare(training: HeadsTraining) -> Callable[[int], None]:
    images, modes = training.images, training.images.object_class.shape_model.modes
    features = images.features(range(training.chunks))
    numbers = features.targets.numbers[features.targets.present > 0]
    scale = {"mean": numbers.mean(0), "deviation": numbers.std(0).clamp_min(1e-3)}

    def work(number: int) -> None:
        seen = features
        if 1 < training.folds > number:
            seen = features[torch.nonzero(features.model % training.folds != number)[:, 0]]
        torch.manual_seed(images.seed * SIZES.members + number)
        member = _Member(modes)
        _train_member(member, seen, scale, training)
        tensors = {**member.state_dict(), **{f"scale.{name}": value for name, value in scale.items()}}
        save_tensors(training.path(number), tensors)

    return work


def _train_member(member: _Member, features: Features, scale: Scale, training: HeadsTraining) -> None:
    targets, count = features.targets, len(features.coarse)
    batch = min(256, count)  # rows of features
    steps = count // batch

    def batches() -> Iterator[torch.Tensor]:
        for epoch in range(training.epochs):
            order = torch.from_numpy(
                np.random.default_rng([training.images.seed, epoch, 3]).permutation(count)
            )
            yield from order[: steps * batch].split(batch)

    def loss(chosen: torch.Tensor) -> dict[str, torch.Tensor]:
        part = targets[chosen]
        part = replace(part, numbers=(part.numbers - scale["mean"]) / scale["deviation"])
        with bfloat16(torch.device("cpu")):
            outputs = member(features.coarse[chosen].float())
        heads = DenseHeads(*(output.float() for output in vars(outputs).values()))
        return dense_losses(heads, part, training.images.object_class.symmetry)

    total, decay = training.epochs * steps, 5e-2
    trainer = Trainer.adamw(member.parameters(), loss, LEARNING_RATE, total, decay, LOSS_WEIGHTS)
    member.train()
    trainer.steps(batches())
    member.eval()


@torch.no_grad()
def _join(network: RecognitionNetwork, members: Sequence[_Member]) -> None:
    """Make members the dense heads of a network, which average their outputs."""
    layers = [fuse_linear_bn_eval(member.linear, member.normalise) for member in members]
    squeezes = [member.squeeze.state_dict() for member in members]
    network.dense[0].load_state_dict(
        {
            name: torch.cat([each[name] for each in squeezes]) if value.ndim else value
            for name, value in squeezes[0].items()
        }
    )
    joined = {name: torch.cat([getattr(each, name) for each in layers]) for name in ("weight", "bias")}
    # The decoder is trained on the weights that the file will hold.
    weight = torch.from_numpy(unpack_matrix(*pack_matrix(joined["weight"].numpy())))
    network.dense[2].load_state_dict(joined | {"weight": weight})
    for name in HEADS:
        heads: list[nn.Linear] = [getattr(member, name) for member in members]
        mean = {
            "weight": torch.cat([head.weight for head in heads], 1) / len(heads),
            "bias": torch.stack([head.bias for head in heads]).mean(0),
        }
        getattr(network, name).load_state_dict(mean)


def keep_member(recognizer: Recognizer, number: int) -> Recognizer:
    """Return a recognizer whose dense heads use one of several members alone; the decoder uses all.

    Their biases stay the mean of all members'.
    """
    count, width = recognizer.settings.members, recognizer.settings.features // recognizer.settings.members
    changed = {}
    for name in (f"{head}.weight" for head in HEADS):
        changed[name] = np.zeros_like(recognizer.weights[name])
        own = slice(number * width, (number + 1) * width)
        changed[name][:, own] = recognizer.weights[name][:, own] * count
    return recognizer.with_weights(changed)
