"""Images that are drawn afresh for each step of a training, by worker processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from vig.io.errors import UserError
from vig.parallel import map_in_processes
from vig.recognition.network import layout_of_numbers
from vig.scene import Latents, ObjectClass
from vig_train.training.examples import Examples
from vig_train.training.recolour import recolour
from vig_train.training.studio import Studio, StudioImage, StudioSettings
from vig_train.training.targets import numbers_of

StepArrays = tuple[int, dict[str, np.ndarray]]


@dataclass(frozen=True)
class Drawing:
    """What is drawn for each step.

    Attributes:
        object_class: Folder of the class pack whose objects are drawn.
        count: Images of the studio.
        again: Of those that earlier steps of an epoch drew, so many more: they take no time to draw.
        recoloured: Share of the dataset's images whose object gets other colours.
        studio: Of the images.
        workers: Processes.
    """

    object_class: Path
    count: int = 24
    again: int = 0
    recoloured: float = 0.7
    studio: StudioSettings = field(default_factory=StudioSettings)
    workers: int = 1

    def described(self) -> dict[str, Any]:
        """What a checkpoint must match to be resumed."""
        settings = asdict(self) | {"object_class": ObjectClass.load(self.object_class).fingerprint}
        return {name: value for name, value in settings.items() if name != "workers"}


def add_drawn_examples(
    steps: Iterator[tuple[Examples, int]], drawing: Drawing, seed: int
) -> Iterator[tuple[Examples, int]]:
    """Recolour a share of each step's examples, and add images of the studio, in order.

    Each step's are a pure function of its examples, the seed and its number, whatever the number of workers.

    Args:
        steps: Examples of a dataset with the number of their step.
        drawing: How many, and of what.
        seed: Of the training.

    Raises:
        UserError: The dataset is of another class than the studio's.
    """
    items = (
        (step, {name: value.numpy() for name, value in vars(examples).items()}) for examples, step in steps
    )
    for step, arrays in map_in_processes(_prepare, (drawing, seed), items, drawing.workers):
        yield Examples(**{name: torch.from_numpy(value) for name, value in arrays.items()}), step


def add_earlier_examples(
    steps: Iterator[tuple[Examples, int]], drawing: Drawing, seed: int, epoch_steps: int
) -> Iterator[tuple[Examples, int]]:
    """Add images of the studio that earlier steps of the same epoch drew, `drawing.again` or all there are.

    Args:
        steps: What `add_drawn_examples` gives.
        drawing: How many.
        seed: Of the training.
        epoch_steps: Steps of an epoch: a run that resumes begins with one.
    """
    earlier: list[Examples] = []
    for examples, step in steps:
        if step % epoch_steps == 0:
            earlier.clear()
        count = drawing.count * len(earlier)
        rng = np.random.default_rng([seed, step, 3])
        chosen = rng.choice(count, min(drawing.again, count), replace=False)
        own = examples[len(examples) - drawing.count :]
        picked = [
            earlier[index // drawing.count][index % drawing.count : index % drawing.count + 1]
            for index in chosen.tolist()
        ]
        earlier.append(own)
        yield Examples.joined([examples, *picked]), step


def _prepare(shared: tuple[Drawing, int]) -> Callable[[StepArrays], StepArrays]:
    drawing, seed = shared
    object_class = ObjectClass.load(drawing.object_class)
    studio = Studio(object_class, drawing.studio)
    modes = object_class.shape_model.modes

    def work(item: StepArrays) -> StepArrays:
        step, arrays = item
        examples = Examples(**{name: torch.from_numpy(value) for name, value in arrays.items()})
        layout = layout_of_numbers(examples.numbers.shape[1])
        if layout.count("shape") != modes:
            raise UserError(
                f"expected a dataset of class '{object_class.name}', with {modes} shape components; got"
                f" {layout.count('shape')}. Make it with that class."
            )
        parts = [_recolour_share(examples, drawing.recoloured, np.random.default_rng([seed, step, 2]))]
        parts.append(studio_examples(studio, seed, range(step * drawing.count, (step + 1) * drawing.count)))
        return step, {name: value.numpy() for name, value in vars(Examples.joined(parts)).items()}

    return work


def studio_examples(studio: Studio, seed: int, indices: range) -> Examples:
    """The studio's images of these indices."""
    return examples_of([studio.draw(seed, index) for index in indices])


def examples_of(images: Sequence[StudioImage]) -> Examples:
    """Images of the studio, stacked."""
    latents = Latents.from_vector(torch.from_numpy(np.stack([image.latents for image in images])))
    return Examples(
        torch.from_numpy(np.stack([image.image for image in images])),
        latents.azimuth,
        numbers_of(latents),
        torch.tensor([image.roll for image in images], dtype=torch.float32),
        torch.from_numpy(np.stack([image.visible for image in images])),
        torch.from_numpy(np.stack([image.hidden for image in images])),
    )


def _recolour_share(examples: Examples, share: float, rng: np.random.Generator) -> Examples:
    """Examples of a dataset, the object of a share of them in other colours."""
    images, numbers = examples.images.clone(), examples.numbers.clone()
    albedo = layout_of_numbers(numbers.shape[1])["albedo"]
    for index in np.flatnonzero(rng.random(len(examples)) < share):
        visible = examples.visible[index].numpy() > 127
        image, albedo_of_new = recolour(images[index].numpy(), visible, numbers[index, albedo].numpy(), rng)
        images[index] = torch.from_numpy(image)
        numbers[index, albedo] = torch.from_numpy(np.asarray(albedo_of_new, np.float32))
    return replace(examples, images=images, numbers=numbers)
