"""A class's recognition network within minutes: on the trunk that all classes share, only heads are trained.

Images of the studio go through the trunk once, each in a few augmentations; the dense heads are trained on
these features, in memory; then the mask's decoder on the images. Each step resumes, and is a pure function of
its seed and its plan.
"""

import copy
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import torch

from vig.io.checks import read_tensors, reading
from vig.parallel import map_in_processes
from vig.recognition.network import NetworkSettings
from vig.recognition.weights import shared_trunk
from vig.scene import ObjectClass
from vig_train.network.network import RecognitionNetwork, bfloat16
from vig_train.network.weights import as_tensors, save_tensors
from vig_train.training.augmentation import Augmentation
from vig_train.training.drawing import examples_of
from vig_train.training.examples import Examples
from vig_train.training.loop import Trainer, TrainingRun
from vig_train.training.losses import mask_loss
from vig_train.training.targets import Targets, TensorRows
from vig_train.training.training import load_start_weights
from vig_world.studio.studio import Studio, StudioSettings

SIZES = NetworkSettings(object_map=64, recalled=4, squeezed=112, features=896, dropout=0.5, members=4)
"""Sizes of a class's heads: with the decoder 3.1 million weights, 2 MB, as the large matrices are packed."""
CHUNK = 128  # images of a file
PASSES = 2  # augmentations of each image whose features are kept
PIXEL_CHUNKS = 128  # files that keep their images, for the decoder; the others keep features alone
LEARNING_RATE = 2e-3  # the highest, of heads and decoder alike
DECODER_PARTS = ("recalled", "deep", "side", "merge", "mask")  # parts of the network that make up the decoder
CHECKPOINT_STEPS = 50  # steps of the decoder between checkpoints
PLAIN_DECODER = Path(__file__).with_name("plain_decoder.safetensors")
"""The mask's decoder of a network of teapots, on the same trunk."""
STUDIO = StudioSettings(level=0.35)
"""Views from the horizon up to above: a user's photos may be from anywhere."""


@dataclass(frozen=True)
class Features(TensorRows):
    """Features of N augmented images by the trunk, and their targets.

    Attributes:
        coarse: (N, C, 10, 10) float16, of its last stage.
        targets: Targets of these, on the host.
        model: (N,) number of the model of the object, see `Studio.models`.
    """

    coarse: torch.Tensor
    targets: Targets
    model: torch.Tensor


def new_network(object_class: ObjectClass) -> RecognitionNetwork:
    """Return untrained heads on the shared trunk; the decoder begins as one of teapots, where that fits."""
    network = RecognitionNetwork(replace(SIZES, modes=object_class.shape_model.modes))
    load_start_weights(network, PLAIN_DECODER, trunk_only=False)
    trunk, _ = shared_trunk()
    network.load_state_dict({name: value.float() for name, value in as_tensors(trunk).items()}, strict=False)
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


# -- images -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ClassImages:
    """Files of images of a class, with their features.

    Attributes:
        object_class: Class of a pack.
        folder: Folder of the files.
        seed: Seed of the images.
        workers: Processes that draw.
        props: See `StudioSettings`.
    """

    object_class: ObjectClass
    folder: Path
    seed: int
    workers: int
    props: str = ""

    def path(self, chunk: int) -> Path:
        """Return the path of a file."""
        return self.folder / f"{chunk:05d}.safetensors"

    def draw(self, chunks: Sequence[int], advance: Callable[[int], None] = lambda count: None) -> None:
        """Write files of these numbers; those that are there stay.

        advance: Called with the number of new images.
        """
        missing = [chunk for chunk in chunks if not self.path(chunk).exists()]
        for _ in map_in_processes(_prepare, self, missing, min(self.workers, max(1, len(missing)))):
            advance(CHUNK)

    def features(self, chunks: Sequence[int]) -> Features:
        """Return the features of files."""
        columns: dict[str, list[torch.Tensor]] = {}
        for chunk in chunks:
            for name, value in self._read(chunk).items():
                if name.startswith("features."):
                    columns.setdefault(name.removeprefix("features."), []).append(value)
        joined = {name: torch.cat(values) for name, values in columns.items()}
        return Features(joined.pop("coarse"), model=joined.pop("model"), targets=Targets(**joined))

    def examples(self, chunks: Sequence[int]) -> Examples:
        """Return the images of files that keep them."""
        parts = []
        for chunk in chunks:
            tensors = self._read(chunk)
            parts.append(Examples(**{k: v for k, v in tensors.items() if not k.startswith("features.")}))
        return Examples.concatenate(parts)

    def _read(self, chunk: int) -> dict[str, torch.Tensor]:
        with reading(self.path(chunk), "images of a training", "Remove it: it is made again."):
            return read_tensors(self.path(chunk), "pt")[0]


def _prepare(images: ClassImages) -> Callable[[int], None]:
    object_class, seed = images.object_class, images.seed
    studio = Studio(object_class, replace(STUDIO, props=images.props))
    network = new_network(object_class).eval()
    augment = Augmentation() if object_class.mirror else replace(Augmentation(), flip=0.0)

    def work(chunk: int) -> None:
        drawn = [studio.draw(seed, index) for index in range(chunk * CHUNK, (chunk + 1) * CHUNK)]
        examples = examples_of(drawn)
        kept: dict[str, torch.Tensor] = dict(vars(examples)) if chunk < PIXEL_CHUNKS else {}
        torch.manual_seed(seed * 2**20 + chunk)
        features = []
        for number in range(PASSES):
            batch = augment(examples, np.random.default_rng([seed, chunk, number]))
            with torch.inference_mode(), bfloat16(batch.images.device):
                parts = [network.maps(part)[-1].half() for part in batch.images.split(32)]
            coarse = torch.cat(parts)  # which refuses float16 within `bfloat16` on a CPU
            model = torch.tensor([image.model for image in drawn])
            own = {field.name: getattr(batch, field.name) for field in fields(Targets)}
            features.append({"coarse": coarse, "model": model, **own})
        for name in features[0]:
            kept[f"features.{name}"] = torch.cat([each[name] for each in features])
        save_tensors(images.path(chunk), kept)

    return work


# -- the mask's decoder -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class DecoderTraining:
    """Steps of training the mask's decoder on images, all else staying as it is.

    Attributes:
        network: It is trained in place.
        examples: Images.
        mirror: Whether images may be mirrored.
        seed: Seed of order and augmentation.
    """

    network: RecognitionNetwork
    examples: Examples
    mirror: bool
    seed: int

    def run(
        self, steps: int, checkpoint: Path | None = None, advance: Callable[[int], None] = lambda steps: None
    ) -> None:
        """Train for so many steps; those that a checkpoint has are not done again."""
        network = self.network.eval()
        parts = [getattr(network, name) for name in DECODER_PARTS]
        network.requires_grad_(False)
        for part in parts:
            part.train().requires_grad_(True)
        parameters = [parameter for part in parts for parameter in part.parameters()]
        trainer = Trainer.adamw(parameters, self._loss, LEARNING_RATE, steps)
        name = f"mask decoder {steps} {self.seed} {len(self.examples)}"
        run = TrainingRun(trainer.optimizer, {"network": network}, checkpoint, name)
        advance(min(steps, run.done() * CHECKPOINT_STEPS))
        for number in run.epochs(-(-steps // CHECKPOINT_STEPS)):
            first = number * CHECKPOINT_STEPS
            trainer.steps(range(first, min(first + CHECKPOINT_STEPS, steps)), first, advance)
            run.save()
        network.eval().requires_grad_(True)

    def seconds_per_step(self) -> float:
        """Measure on a copy's three steps."""
        trial = replace(self, network=copy.deepcopy(self.network))
        trial.run(1)
        begin = time.perf_counter()
        trial.run(2)
        return (time.perf_counter() - begin) / 2

    def _loss(self, step: int) -> dict[str, torch.Tensor]:
        rng = np.random.default_rng([self.seed, step, 4])
        # 48 images a step.
        chosen = rng.choice(len(self.examples), min(48, len(self.examples)), replace=False)
        torch.manual_seed(int(rng.integers(2**31)))
        augment = Augmentation() if self.mirror else replace(Augmentation(), flip=0.0)
        batch = augment(self.examples[torch.from_numpy(chosen)], rng)
        with bfloat16(torch.device("cpu")):
            logits = self.network(batch.images).mask
        return {"mask": mask_loss(logits, batch.mask)}
