"""Images of the studio beside those of datasets: drawn by worker processes, for each step or once."""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from vig.io.checks import read_tensors, reading
from vig.io.errors import UserError
from vig.io.files import write_arrays
from vig.parallel import map_in_processes
from vig.recognition.network import layout_of_numbers
from vig.scene import Latents, ObjectClass
from vig_train.training.examples import Examples
from vig_train.training.pasting import CutoutLibrary
from vig_train.training.recolour import recolour
from vig_train.training.targets import numbers_of
from vig_world.studio.cutouts import model_cutouts
from vig_world.studio.studio import Studio, StudioImage, StudioSettings

DRAWN = 60  # images of a file that is drawn once

StepArrays = tuple[int, dict[str, np.ndarray]]


@dataclass(frozen=True)
class Drawing:
    """Images that are drawn for each step.

    Attributes:
        object_class: Folder of the class pack whose objects are drawn.
        count: Images of the studio.
        distinct: Images drawn before the training, of which each step takes some; 0: each step's are
            drawn for it.
        recoloured: Share of the dataset's images whose object gets other colours.
        studio: Settings of the images.
        workers: Processes.
    """

    object_class: Path
    count: int = 24
    distinct: int = 0
    recoloured: float = 0.7
    studio: StudioSettings = field(default_factory=StudioSettings)
    workers: int = 1

    def library(self, seed: int) -> CutoutLibrary | None:
        """Return cut-outs to paste before the objects of each step; None without models to put there."""
        if not self.studio.props:
            return None
        name = ObjectClass.load(self.object_class).name
        return CutoutLibrary.draw(seed, "train", name, model_cutouts(self.studio.props, "train", name))

    def resume_settings(self) -> dict[str, Any]:
        """Return the settings that a checkpoint must match to be resumed."""
        settings = asdict(self) | {"object_class": ObjectClass.load(self.object_class).fingerprint}
        return {name: value for name, value in settings.items() if name != "workers"}


def drawn_once(
    drawing: Drawing, folder: Path, seed: int, advance: Callable[[int], None] = lambda count: None
) -> Examples:
    """Return the first `drawing.distinct` images of the studio, or a few more; files in the folder stay.

    Args:
        drawing: Number and settings of the images.
        folder: Folder of the run; the files lie in a folder of it, named after all that they depend on.
        seed: Seed of the training.
        advance: Called with the number of new images.

    Raises:
        UserError: A file is damaged, or the folder cannot be written.
    """
    described = drawing.resume_settings()
    for name in ("count", "distinct", "recoloured"):  # images do not depend on these
        described.pop(name, None)
    key = hashlib.sha256(json.dumps([described, seed], sort_keys=True).encode()).hexdigest()[:12]
    numbers, folder = range(-(-drawing.distinct // DRAWN)), folder / f"drawn-{key}"
    paths = {number: folder / f"{number:05d}.safetensors" for number in numbers}
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"expected a folder that can be written; got '{folder}' ({error.strerror})."
        ) from error
    missing = [
        (number, number * DRAWN, (number + 1) * DRAWN) for number, path in paths.items() if not path.exists()
    ]
    # Each file as it is done: a run that was killed goes on from there.
    for number, arrays in map_in_processes(_prepare_once, (drawing, seed), missing, drawing.workers):
        write_arrays(paths[number], arrays)
        advance(DRAWN)
    parts = []
    for path in paths.values():
        with reading(path, "images of an earlier run", "Remove the folder to draw them anew."):
            parts.append(Examples(**read_tensors(path, "pt")[0]))
    return Examples.concatenate(parts)


def add_drawn_examples(
    steps: Iterator[tuple[Examples, int]], drawing: Drawing, seed: int, once: Examples | None = None
) -> Iterator[tuple[Examples, int]]:
    """Recolour a share of each step's examples, and add images of the studio, in order.

    Each step's are a pure function of its examples, the seed and its number, whatever the number of workers.

    Args:
        steps: Examples of a dataset with the number of their step.
        drawing: Number and settings of the images.
        seed: Seed of the training.
        once: Images drawn before, from which they are taken.

    Raises:
        UserError: The dataset is of another class than the studio's.
    """
    items = ((step, examples.arrays()) for examples, step in steps)
    for step, arrays in map_in_processes(_prepare, (drawing, seed), items, drawing.workers):
        examples = Examples.of_arrays(arrays)
        if once is not None:
            rng = np.random.default_rng([seed, step, 3])
            taken = rng.choice(len(once), min(drawing.count, len(once)), replace=False)
            examples = Examples.concatenate([examples, once[torch.from_numpy(taken)]])
        yield examples, step


def _prepare_once(shared: tuple[Drawing, int]) -> Callable[[tuple[int, int, int]], StepArrays]:
    drawing, seed = shared
    studio = Studio(ObjectClass.load(drawing.object_class), drawing.studio)

    def work(item: tuple[int, int, int]) -> StepArrays:
        number, *bounds = item
        return number, studio_examples(studio, seed, range(*bounds)).arrays()

    return work


def _prepare(shared: tuple[Drawing, int]) -> Callable[[StepArrays], StepArrays]:
    drawing, seed = shared
    object_class = ObjectClass.load(drawing.object_class)
    studio = Studio(object_class, drawing.studio)
    modes, fresh = object_class.shape_model.modes, 0 if drawing.distinct else drawing.count

    def work(item: StepArrays) -> StepArrays:
        step, arrays = item
        examples = Examples.of_arrays(arrays)
        layout = layout_of_numbers(examples.numbers.shape[1])
        if layout.count("shape") != modes:
            raise UserError(
                f"expected a dataset of class '{object_class.name}', with {modes} shape components; got"
                f" {layout.count('shape')}. Make it with that class."
            )
        rng = np.random.default_rng([seed, step, 2])
        parts = [recolour_share(examples, drawing.recoloured, rng)]
        if fresh:
            parts.append(studio_examples(studio, seed, range(step * fresh, (step + 1) * fresh)))
        return step, Examples.concatenate(parts).arrays()

    return work


def studio_examples(studio: Studio, seed: int, indices: range) -> Examples:
    """Return the studio's images of these indices."""
    return examples_of([studio.draw(seed, index) for index in indices])


def examples_of(images: Sequence[StudioImage]) -> Examples:
    """Return images of the studio, stacked."""
    latents = Latents.from_vector(torch.from_numpy(np.stack([image.latents for image in images])))
    return Examples(
        torch.from_numpy(np.stack([image.image for image in images])),
        latents.azimuth,
        numbers_of(latents),
        torch.tensor([image.roll for image in images], dtype=torch.float32),
        torch.from_numpy(np.stack([image.visible for image in images])),
        torch.from_numpy(np.stack([image.hidden for image in images])),
    )


def recolour_share(examples: Examples, share: float, rng: np.random.Generator) -> Examples:
    """Return examples of a dataset, the object of a share of them in other colours."""
    images, numbers = examples.images.clone(), examples.numbers.clone()
    albedo = layout_of_numbers(numbers.shape[1])["albedo"]
    for index in np.flatnonzero(rng.random(len(examples)) < share):
        visible = examples.visible[index].numpy() > 127
        image, albedo_of_new = recolour(images[index].numpy(), visible, numbers[index, albedo].numpy(), rng)
        images[index] = torch.from_numpy(image)
        numbers[index, albedo] = torch.from_numpy(np.asarray(albedo_of_new, np.float32))
    return replace(examples, images=images, numbers=numbers)
