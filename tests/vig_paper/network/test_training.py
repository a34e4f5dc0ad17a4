"""Training of the paper's networks: it learns, stops in time, and goes on where it stopped."""

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from vig.io.errors import UserError
from vig.scene import linear_from_srgb, srgb_from_linear
from vig_paper.network.network import FACTORS, PaperNetworks, PaperSettings
from vig_paper.network.recognizer import PaperRecognizer
from vig_paper.network.training import PaperTrainingSettings, train_paper
from vig_train.training.checkpoint import load_checkpoint
from vig_train.training.training import TrainingSettings
from vig_world.dataset import Dataset

NETWORKS = PaperSettings(filters=(4, 4, 4), dense=(16, 16), dropout=0.1)
SETTINGS = PaperTrainingSettings(
    epochs=5, patience=5, batch=8, learning_rate=0.03, threads=1, networks=NETWORKS
)
COUNT = 64


def discs(folder: Path, count: int = COUNT) -> Dataset:
    """Photos of discs: their place follows the azimuth, their colour the albedo."""
    rng = np.random.default_rng(0)
    latents = rng.normal(size=(count, 24)).astype(np.float32)
    latents[:, 10] = rng.uniform(0, 2 * math.pi, count)
    latents[:, 11] = rng.uniform(0.1, 1.4, count)
    latents[:, 12:15] = rng.uniform(0.2, 0.8, (count, 3))
    y, x = np.mgrid[:150, :150]
    centre = 75 + 30 * np.stack([np.cos(latents[:, 10]), np.sin(latents[:, 10])])[..., None, None]
    inside = (x - centre[0]) ** 2 + (y - centre[1]) ** 2 < 30**2
    colours = np.broadcast_to(srgb_from_linear(latents[:, None, None, 12:15]) * 255, (count, 150, 150, 3))
    images = np.where(inside[..., None], colours, 60).astype(np.uint8)
    zeros = np.zeros(count, np.float32)
    names, none = ("none",) * count, np.full(count, -1)
    dataset = Dataset(
        folder, latents, (), zeros, zeros, names, zeros > 0, none, ("matt",) * count, zeros, "paper"
    )
    dataset.__dict__.update(images=images)  # instead of files
    return dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return discs(tmp_path_factory.mktemp("discs"))


@pytest.fixture(scope="module")
def trained(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """Weights of an uninterrupted run, and what it said."""
    said: list[str] = []
    return train_paper(dataset, tmp_path_factory.mktemp("whole"), SETTINGS, said.append), said


def read_log(folder: Path) -> list[dict[str, str]]:
    with open(folder / "log.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_the_pose_is_learned_and_every_loss_stands_in_the_log(trained: tuple[Path, list[str]]) -> None:
    path, said = trained
    rows = read_log(path.parent)
    assert len(rows) == len(said) == 4 * SETTINGS.epochs
    for number, factor in enumerate(FACTORS):
        mine = rows[number * SETTINGS.epochs : (number + 1) * SETTINGS.epochs]
        assert [(row["factor"], row["epoch"]) for row in mine] == [
            (factor, str(epoch + 1)) for epoch in range(SETTINGS.epochs)
        ]
        losses = [float(row["loss"]) for row in mine]
        assert factor != "pose" or losses[-1] < 0.8 * losses[0]  # the others have little to see


def test_the_predicted_deviations_are_those_of_the_held_out_images(
    trained: tuple[Path, list[str]], dataset: Dataset
) -> None:
    recognizer = PaperRecognizer(trained[0])
    held = slice(COUNT - COUNT // 10, COUNT)
    prediction = recognizer(linear_from_srgb(dataset.images[held].astype(np.float32) / 255))
    off = prediction.numbers[:, 11:14] - dataset.latents[held, 12:15]
    np.testing.assert_allclose(
        prediction.deviation[0, 11:14], np.sqrt(np.square(off).mean(0)), atol=0.01, rtol=0.02
    )
    assert (prediction.deviation > 0).all()


def test_an_interrupted_run_ends_with_the_same_weights(
    trained: tuple[Path, list[str]], dataset: Dataset, tmp_path: Path
) -> None:
    """Interrupted in the middle of the first network, and after the last epoch of the second."""
    for stop in ("pose: epoch 2/", f"shape: epoch {SETTINGS.epochs}/"):

        def interrupt(line: str, stop: str = stop) -> None:
            if line.startswith(stop):
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            train_paper(dataset, tmp_path, SETTINGS, interrupt)
        assert not (tmp_path / "recognition.safetensors").exists()
    said: list[str] = []
    resumed = train_paper(dataset, tmp_path, SETTINGS, said.append)
    assert said[0].startswith("appearance: epoch 1/")
    first, second = load_file(trained[0]), load_file(resumed)
    assert first.keys() == second.keys()
    assert [name for name in first if not torch.equal(first[name], second[name])] == []
    again: list[str] = []
    third = load_file(train_paper(dataset, tmp_path, SETTINGS, again.append))
    assert again == [] and [name for name in first if not torch.equal(first[name], third[name])] == []


def test_a_network_that_gets_no_better_stops_and_keeps_its_best_epoch(
    dataset: Dataset, tmp_path: Path
) -> None:
    """At a learning rate of almost nothing held-out losses differ by chance."""
    settings = replace(SETTINGS, epochs=30, patience=2, learning_rate=1e-12)
    path = train_paper(dataset, tmp_path, settings, lambda line: None)
    losses = [float(row["held_out_loss"]) for row in read_log(tmp_path) if row["factor"] == "pose"]
    assert len(losses) == 1 + int(np.argmin(losses)) + 2
    checkpoint = load_file(tmp_path / "checkpoint.safetensors")
    for name, kept in load_file(path).items():
        if "pose.layers" in name:
            assert torch.equal(kept, checkpoint[name.replace("network.factors", "best")].half())


def test_the_mean_image_is_of_the_training_images_channel_by_channel(
    trained: tuple[Path, list[str]], dataset: Dataset
) -> None:
    tensors = load_file(trained[0])
    mean = dataset.images[: COUNT - COUNT // 10].mean(0, dtype=np.float64) / 255
    found = tensors["network.factors.light.mean_image"].permute(1, 2, 0)
    np.testing.assert_allclose(found, mean, atol=1e-5)


def test_another_runs_checkpoint_is_not_continued(trained: tuple[Path, list[str]], dataset: Dataset) -> None:
    """Neither by other settings nor by the training of vig's own network."""
    checkpoint = trained[0].parent / "checkpoint.safetensors"
    before = checkpoint.read_bytes()
    with pytest.raises(UserError, match="another training run"):
        train_paper(dataset, checkpoint.parent, replace(SETTINGS, epochs=7))
    own = TrainingSettings().fingerprint([dataset])
    with pytest.raises(UserError, match="another training run"):
        load_checkpoint(checkpoint, {}, torch.optim.SGD([torch.zeros(1)]), own)
    assert checkpoint.read_bytes() == before


def test_too_small_a_dataset_and_impossible_settings_are_refused(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=f"at least 128 images; .* has {COUNT}"):
        train_paper(dataset, tmp_path, replace(SETTINGS, batch=64))
    for wrong in ({"epochs": 0}, {"seed": -1}):
        with pytest.raises(UserError, match=f"{next(iter(wrong))} must be at least"):
            train_paper(dataset, tmp_path, replace(SETTINGS, **wrong))
    assert not list(tmp_path.iterdir())


def test_a_training_that_diverges_is_told(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="pose network diverged in epoch 1"):
        train_paper(dataset, tmp_path, replace(SETTINGS, learning_rate=1e30))
    assert not list(tmp_path.iterdir())


def test_the_papers_numbers_but_for_smaller_batches_are_the_default() -> None:
    settings = PaperTrainingSettings()
    assert (settings.epochs, settings.patience, settings.batch) == (150, 20, 32)
    assert (settings.learning_rate, settings.momentum) == (0.01, 0.9)
    dropouts = [m.p for m in PaperNetworks(settings.networks).modules() if isinstance(m, torch.nn.Dropout)]
    assert dropouts == [0.5] * 8


def test_the_seed_decides_what_training_begins_with(dataset: Dataset, tmp_path: Path) -> None:
    """At a learning rate of next to nothing the weights stay what they began as."""

    def weights(seed: int, run: str) -> dict[str, torch.Tensor]:
        still = replace(SETTINGS, epochs=1, learning_rate=1e-30, seed=seed)
        return load_file(train_paper(dataset, tmp_path / run, still, lambda line: None))

    once, again, other = weights(0, "a"), weights(0, "b"), weights(1, "c")
    name = next(name for name, value in once.items() if "pose" in name and value.ndim == 4)
    assert torch.equal(once[name], again[name]) and not torch.equal(once[name], other[name])
