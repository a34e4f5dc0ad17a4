"""Training runs, goes on where it stopped as if it never had, and refuses what it cannot use."""

import dataclasses
import math
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from tests.support import SMALL
from tests.vig_train.training.test_augmentation import NOTHING
from vig.io.errors import UserError
from vig.recognition import Recognizer
from vig.scene import Symmetry
from vig_train.network.network import RecognitionNetwork
from vig_train.training.augmentation import Augmentation
from vig_train.training.checkpoint import save_weights
from vig_train.training.examples import Examples
from vig_train.training.losses import LOSS_WEIGHTS
from vig_train.training.training import Epoch, TrainingSettings, train, validate
from vig_world.dataset import Dataset

SETTINGS = TrainingSettings(epochs=3, batch=8, threads=1, network=SMALL)
COUNT = 40


def tiny_dataset(folder: Path, count: int = COUNT) -> Dataset:
    """Photos of a bright disc whose place follows azimuth, half of it hidden."""
    rng = np.random.default_rng(0)
    latents = rng.normal(size=(count, 24)).astype(np.float32)
    latents[:, 10] = rng.uniform(0, 2 * math.pi, count)
    y, x = np.mgrid[:150, :150]
    centre = 75 + 30 * np.stack([np.cos(latents[:, 10]), np.sin(latents[:, 10])])
    amodal = (x - centre[0, :, None, None]) ** 2 + (y - centre[1, :, None, None]) ** 2 < 25**2
    visible = amodal & (x < centre[0, :, None, None])
    images = rng.integers(0, 80, (count, 150, 150, 3), np.uint8)
    images[visible] += 150
    zeros = np.zeros(count, np.float32)
    names, none = ("none",) * count, np.full(count, -1)
    dataset = InMemory(
        folder, latents, (), zeros, zeros, names, zeros > 0, none, ("matt",) * count, zeros, "paper"
    )
    dataset.__dict__.update(rgb=images, mask=amodal, mask_visib=visible)  # instead of files
    return dataset


class InMemory(Dataset):
    """A dataset without files, whose samples lie in eight rooms in turn."""

    def read(self, kind, indices=None):  # type: ignore[no-untyped-def]
        return self.__dict__[kind][np.arange(len(self)) if indices is None else np.asarray(indices)]

    def specs(self):  # type: ignore[no-untyped-def]
        return [SimpleNamespace(room=SimpleNamespace(layout=index % 8)) for index in range(len(self))]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return tiny_dataset(tmp_path_factory.mktemp("tiny"))


@pytest.fixture(scope="module")
def trained(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """Weights of an uninterrupted run, and what it said."""
    said: list[str] = []
    return train([dataset], tmp_path_factory.mktemp("whole"), SETTINGS, said.append), said


def test_a_run_says_one_line_an_epoch_and_writes_weights_that_can_be_read(trained, dataset: Dataset) -> None:
    path, said = trained
    assert path.name == "recognition.safetensors"
    assert [line.split()[1] for line in said] == ["1/3", "2/3", "3/3"]
    assert all("nan" not in line for line in said)
    prediction = Recognizer(path)(np.full((2, 150, 150, 3), 0.5, np.float32))
    assert prediction.azimuth.shape == (2, 72) and prediction.mask.shape == (2, 150, 150, 3)
    np.testing.assert_allclose(prediction.azimuth.sum(1), 1, rtol=1e-5)
    np.testing.assert_allclose(prediction.mask.sum(-1), 1, rtol=1e-5)
    assert (prediction.deviation > 0).all()


def test_each_epoch_is_recorded_with_losses_and_errors(dataset: Dataset, tmp_path: Path) -> None:
    epochs: list[Epoch] = []
    said: list[str] = []
    train([dataset], tmp_path, dataclasses.replace(SETTINGS, epochs=2), said.append, epochs.append)
    assert [epoch.number for epoch in epochs] == [1, 2]
    for epoch, line in zip(epochs, said, strict=True):
        assert epoch.trained.keys() == epoch.validated.keys() == set(LOSS_WEIGHTS)
        assert np.isfinite([*epoch.trained.values(), *epoch.errors.values()]).all()
        loss = sum(LOSS_WEIGHTS[name] * value for name, value in epoch.validated.items())
        assert f"loss {loss:.3f}" in line and f"wrong_view {epoch.errors['wrong_view']:.3g}" in line


def test_the_mask_alone_is_trained(dataset: Dataset, tmp_path: Path) -> None:
    """Heads and map say the same before and after, in their units; a run that goes on keeps the decoder."""
    mapped = dataclasses.replace(SMALL, object_map=8)
    first = train([dataset], tmp_path / "1", dataclasses.replace(SETTINGS, epochs=1, network=mapped), print)
    larger = dataclasses.replace(dataset, latents=2 * dataset.latents)
    larger.__dict__.update({name: dataset.__dict__[name] for name in ("rgb", "mask", "mask_visib")})
    wide = dataclasses.replace(SMALL, context=(8, 6, 6, 4))
    alone = dataclasses.replace(SETTINGS, epochs=1, start=first, mask_alone=True, network=wide)
    second = train([larger], tmp_path / "2", alone, print)
    photos = np.random.default_rng(0).random((3, 150, 150, 3), np.float32)
    before, after = Recognizer(first)(photos), Recognizer(second)(photos)
    for name in ("azimuth", "numbers", "deviation", "roll", "presence"):
        np.testing.assert_allclose(getattr(after, name), getattr(before, name), atol=2e-3, rtol=2e-3)
    assert np.abs(after.mask - before.mask).max() > 0.01
    images = photos[:1].transpose(0, 3, 1, 2)
    np.testing.assert_allclose(
        *(Recognizer(path).object_map(images) for path in (first, second)), atol=2e-3, rtol=2e-3
    )
    onwards = dataclasses.replace(SETTINGS, epochs=1, start=second, frozen=5)
    third = train([dataset], tmp_path / "3", onwards, print)
    assert Recognizer(third).settings.context == wide.context
    other = dataclasses.replace(wide, features=24)
    with pytest.raises(UserError, match="its heads have other sizes than the network's, at 'dense"):
        train([dataset], tmp_path / "4", dataclasses.replace(alone, network=other), print)


def test_the_loss_falls(dataset: Dataset, tmp_path: Path) -> None:
    epochs: list[Epoch] = []
    settings = dataclasses.replace(SETTINGS, epochs=6, patience=6)
    train([dataset], tmp_path, settings, lambda line: None, epochs.append)
    first, last = epochs[0], epochs[-1]
    assert sum(last.validated.values()) < 0.98 * sum(first.validated.values())
    assert last.trained["mask"] < 0.9 * first.trained["mask"]


def test_the_weights_are_those_of_the_best_epoch_and_training_ends_after_it(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    losses = iter([3.0, 1.0, 2.0, 2.5, 0.5])

    def validated(network, examples, chosen, scale, symmetry):  # type: ignore[no-untyped-def]
        others = dict.fromkeys(("numbers", "mask", "roll", "presence"), 0.0)
        return {"azimuth": next(losses), **others}, {"azimuth_deg": 0.0}

    monkeypatch.setattr("vig_train.training.training.validate", validated)
    settings = dataclasses.replace(SETTINGS, epochs=5, patience=2)
    held: list[bytes] = []
    said: list[str] = []

    def say(line: str) -> None:
        said.append(line)
        held.append((tmp_path / "recognition.safetensors").read_bytes())

    train([dataset], tmp_path, settings, say)
    assert [line.split()[1] for line in said[:4]] == ["1/5", "2/5", "3/5", "4/5"]
    assert said[4:] == ["no better for 2 epochs; the weights are those after epoch 2"]
    assert held[0] != held[1] and held[1] == held[2] == held[3] == held[4]


@dataclasses.dataclass(frozen=True)
class Watched(Augmentation):
    """Changes nothing, and notes which photos each batch has, by their azimuths."""

    seen: ClassVar[list[list[float]]] = []

    def __call__(self, batch, rng, library=None):  # type: ignore[no-untyped-def]
        self.seen.append(batch.azimuth.tolist())
        return NOTHING(batch, rng)


@pytest.fixture(scope="module")
def seeded(
    dataset: Dataset, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, tuple[torch.Tensor, list[list[float]]]]:
    """Weights and batches of runs with seeds; at a learning rate of 0 weights stay what they began as."""
    runs = {}
    for name, seed, epochs in (("first", 0, 2), ("again", 0, 1), ("other", 1, 1)):
        Watched.seen.clear()
        given = dataclasses.replace(
            SETTINGS, epochs=epochs, augmentation=Watched(), learning_rate=0.0, seed=seed
        )
        path = train([dataset], tmp_path_factory.mktemp(name), given, lambda line: None)
        runs[name] = load_file(path)["network.azimuth.weight"], list(Watched.seen)
    return runs


def test_the_seed_decides_the_first_weights(seeded) -> None:
    assert torch.equal(seeded["first"][0], seeded["again"][0])
    assert not torch.equal(seeded["first"][0], seeded["other"][0])


def test_the_seed_and_the_epoch_decide_the_order_of_photos(seeded) -> None:
    first, again, other = (seeded[name][1] for name in ("first", "again", "other"))
    count = len(again)
    assert first[:count] == again and again != other
    assert first[count:] != again, "an epoch has an order of its own"
    photos = sorted(number for batch in again for number in batch)
    assert len(set(photos)) == len(photos) == 8 * count


@pytest.mark.filterwarnings("error::UserWarning")
def test_an_interrupted_run_ends_with_the_same_bytes(trained, dataset: Dataset, tmp_path: Path) -> None:
    def interrupt(line: str) -> None:
        if line.startswith("epoch 1/"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train([dataset], tmp_path, SETTINGS, interrupt)
    said: list[str] = []
    resumed = train([dataset], tmp_path, SETTINGS, said.append)
    assert [line.split()[1] for line in said] == ["2/3", "3/3"]
    first, second = load_file(trained[0]), load_file(resumed)
    assert first.keys() == second.keys()
    assert [name for name in first if not torch.equal(first[name], second[name])] == []


def test_a_finished_run_is_not_trained_again(trained, dataset: Dataset) -> None:
    path, _ = trained
    before, said = path.read_bytes(), []
    assert train([dataset], path.parent, SETTINGS, said.append) == path
    assert said == [] and path.read_bytes() == before


def test_another_runs_checkpoint_is_not_continued(trained, dataset: Dataset) -> None:
    folder = trained[0].parent
    before = (folder / "checkpoint.safetensors").read_bytes()
    with pytest.raises(UserError, match="another training run"):
        train([dataset], folder, dataclasses.replace(SETTINGS, epochs=5))
    assert (folder / "checkpoint.safetensors").read_bytes() == before


@pytest.mark.parametrize("keep", [0, 40, -100])
def test_a_damaged_checkpoint_is_told(keep: int, trained, dataset: Dataset, tmp_path: Path) -> None:
    whole = (trained[0].parent / "checkpoint.safetensors").read_bytes()
    (tmp_path / "checkpoint.safetensors").write_bytes(whole[:keep])
    with pytest.raises(UserError, match="checkpoint"):
        train([dataset], tmp_path, SETTINGS)


def test_a_checkpoint_that_is_none_of_ours_is_told(dataset: Dataset, tmp_path: Path) -> None:
    save_file({"a": torch.zeros(1)}, tmp_path / "checkpoint.safetensors")
    with pytest.raises(UserError, match="checkpoint"):
        train([dataset], tmp_path, SETTINGS)


def test_too_small_a_dataset_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="at least 16 images; .* has 15"):
        train([tiny_dataset(tmp_path, 15)], tmp_path, SETTINGS)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("wrong", [{"epochs": 0}, {"epochs": -1}, {"seed": -1}])
def test_impossible_settings_are_refused(wrong: dict[str, int], dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=f"{next(iter(wrong))} must be at least"):
        train([dataset], tmp_path, dataclasses.replace(SETTINGS, **wrong))
    assert not list(tmp_path.iterdir())


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    """Untrained weights of a small network."""
    torch.manual_seed(0)
    path = tmp_path / "recognition.safetensors"
    scale = {"mean": torch.zeros(23), "deviation": torch.ones(23)}
    save_weights(RecognitionNetwork(SMALL), scale, path)
    return path


def test_weights_are_read_back_with_their_settings(weights: Path) -> None:
    assert Recognizer(weights).settings == SMALL


@pytest.mark.parametrize("keep", [0, 30, -1])
def test_truncated_weights_are_refused(weights: Path, keep: int) -> None:
    weights.write_bytes(weights.read_bytes()[:keep])
    with pytest.raises(UserError, match="expected recognition weights at"):
        Recognizer(weights)


def test_missing_foreign_and_non_finite_weights_are_refused(weights: Path, tmp_path: Path) -> None:
    for path in (tmp_path / "nothing.safetensors", tmp_path):
        with pytest.raises(UserError, match="expected recognition weights at"):
            Recognizer(path)
    tensors = load_file(weights)
    save_file(tensors, tmp_path / "foreign.safetensors")  # no settings
    with pytest.raises(UserError, match="expected recognition weights at"):
        Recognizer(tmp_path / "foreign.safetensors")
    with safe_open(weights, framework="pt") as file:
        metadata = file.metadata()
    for name in ("network.azimuth.bias", "scale.mean"):
        bad = tensors | {name: torch.full_like(tensors[name], math.nan)}
        save_file(bad, tmp_path / "bad.safetensors", metadata=metadata)
        with pytest.raises(UserError, match="not finite"):
            Recognizer(tmp_path / "bad.safetensors")
    save_file(tensors | {"scale.mean": torch.zeros(3)}, tmp_path / "bad.safetensors", metadata=metadata)
    with pytest.raises(UserError, match="expected recognition weights at"):
        Recognizer(tmp_path / "bad.safetensors")


def told(path: Path) -> dict[str, str]:
    """What a weights file says beside its tensors."""
    with safe_open(path, framework="pt") as file:
        return dict(file.metadata())


@pytest.mark.parametrize("change", ["missing", "extra"])
def test_weights_with_a_tensor_too_few_or_too_many_are_refused(change: str, weights: Path) -> None:
    tensors, metadata = load_file(weights), told(weights)
    if change == "missing":
        del tensors["network.numbers.bias"]
    else:
        tensors["network.numbers.more"] = torch.zeros(3)
    save_file(tensors, weights, metadata=metadata)
    with pytest.raises(UserError, match="expected recognition weights at .*weights are missing or unknown"):
        Recognizer(weights)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("average.numbers.bias", "missing"),
        ("average.numbers.more", "extra"),
        ("optimizer.0.exp_avg", "missing"),
        ("optimizer.0.more", "extra"),
        ("optimizer.999.step", "extra"),
        ("more.numbers.bias", "extra"),
    ],
)
def test_a_checkpoint_with_a_tensor_too_few_or_too_many_is_not_continued(
    name: str, change: str, trained, dataset: Dataset, tmp_path: Path
) -> None:
    path = trained[0].parent / "checkpoint.safetensors"
    tensors, metadata = load_file(path), told(path)
    if change == "missing":
        del tensors[name]
    else:
        tensors[name] = torch.zeros(3)
    save_file(tensors, tmp_path / path.name, metadata=metadata)
    with pytest.raises(UserError, match="tensors are missing or unknown") as caught:
        train([dataset], tmp_path, SETTINGS)
    assert name in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["average.numbers.bias", "optimizer.0.exp_avg", "optimizer.0.step"])
def test_a_checkpoint_with_a_tensor_of_another_shape_is_not_continued(
    name: str, trained, dataset: Dataset, tmp_path: Path
) -> None:
    path = trained[0].parent / "checkpoint.safetensors"
    tensors, metadata = load_file(path) | {name: torch.zeros(1)}, told(path)
    save_file(tensors, tmp_path / path.name, metadata=metadata)
    with pytest.raises(UserError, match="expected a checkpoint of a training run") as caught:
        train([dataset], tmp_path, SETTINGS)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("mirror", [True, False])
def test_images_are_flipped_only_where_a_class_is_its_mirror_image(
    mirror: bool, dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shares = set()
    plain = Augmentation.__call__

    def seen(self, examples, rng, library=None):  # type: ignore[no-untyped-def]
        shares.add(self.flip)
        return plain(self, examples, rng, library)

    monkeypatch.setattr(Augmentation, "__call__", seen)
    settings = dataclasses.replace(SETTINGS, epochs=1, mirror=mirror)
    train([dataset], tmp_path, settings, lambda line: None)
    assert shares == {0.5 if mirror else 0.0}


def test_a_checkpoint_is_of_one_symmetry_and_those_of_before_remain_valid(dataset: Dataset) -> None:
    plain = SETTINGS.fingerprint([dataset])
    assert "symmetry" not in plain and "mirror" not in plain
    for changed in ({"symmetry": Symmetry.HALF_TURN}, {"mirror": False}):
        assert dataclasses.replace(SETTINGS, **changed).fingerprint([dataset]) != plain


def test_views_that_look_the_same_are_no_error(dataset: Dataset) -> None:
    """Untrained, half of all errors exceed 90 degrees, or 45 where half a turn looks the same."""
    torch.manual_seed(0)
    network = RecognitionNetwork(dataclasses.replace(SMALL, modes=10))
    examples = Examples.of(dataset)
    scale = {"mean": examples.numbers.mean(0), "deviation": examples.numbers.std(0)}
    chosen = torch.arange(len(examples))
    found = {each: validate(network, examples, chosen, scale, each)[1] for each in Symmetry}
    assert found[Symmetry.NONE]["azimuth_deg"] > found[Symmetry.HALF_TURN]["azimuth_deg"] > 0
    assert found[Symmetry.ANY_TURN]["azimuth_deg"] == found[Symmetry.ANY_TURN]["wrong_view"] == 0
