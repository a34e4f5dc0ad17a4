"""Photos for benchmarks of fits: rendered from a seed, or the last ones of a dataset."""

import argparse
from pathlib import Path

import numpy as np

from vig.scene import ObjectClass, linear_from_srgb
from vig_world.composition.sampling import sample
from vig_world.dataset import read_dataset
from vig_world.library import Library
from vig_world.renderers.rasterized import render


def add_arguments(parser: argparse.ArgumentParser, count: int) -> None:
    """`--count`, `--seed`, `--dataset` and `--split`, of which `chosen` reads."""
    parser.add_argument("--count", type=int, default=count)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dataset", type=Path)
    parser.add_argument("--split", default="test")


def chosen(arguments: argparse.Namespace, object_class: ObjectClass) -> tuple[np.ndarray, np.ndarray]:
    """Linear RGB photos (N, H, W, 3) float32 and their true latents (N, P)."""
    if arguments.dataset is None:
        images, truth = made(object_class, arguments.count, arguments.seed)
    else:
        images, truth = read(arguments.dataset, arguments.split, arguments.count)
    return linear_from_srgb(images.astype(np.float32) / 255), truth


def made(object_class: ObjectClass, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Photos (N, H, W, 3) uint8 and latents (N, P) of the test split's scenes."""
    library = Library("test")
    specs = [sample(library, object_class, seed, index, "paper") for index in range(count)]
    images = np.stack([render(library, spec, object_class).image for spec in specs])
    return images, np.stack([spec.latents() for spec in specs]).astype(np.float32)


def read(folder: Path, split: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The last `count` photos and latents of a dataset; the last thousand of a training set validate."""
    dataset = read_dataset(folder, split)
    wanted = range(max(0, len(dataset) - count), len(dataset))
    return dataset.read("rgb", wanted), dataset.latents[wanted.start :]
