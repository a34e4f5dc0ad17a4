import shutil
from pathlib import Path

import numpy as np
import pytest

from vig.io.errors import UserError
from vig.scene import EXPOSURE_L00, latent_layout
from vig_world.dataset import Dataset, read_dataset

COUNT = 10  # of the fixture `made`


def test_arrays_have_the_documented_shapes(dataset: Dataset) -> None:
    assert len(dataset) == COUNT
    assert dataset.images.shape == (COUNT, 150, 150, 3) and dataset.images.dtype == np.uint8
    assert dataset.amodal.shape == dataset.visible.shape == (COUNT, 150, 150)
    assert dataset.latents.shape == (COUNT, 24) and dataset.latents.dtype == np.float32
    assert dataset.names == latent_layout(10).labels
    depth = dataset.read("depth", [3, 1])
    assert depth.shape == (2, 150, 150) and depth.dtype == np.float32


def test_occlusion_is_what_the_masks_say_and_what_was_asked_for(dataset: Dataset) -> None:
    assert not (dataset.visible & ~dataset.amodal).any()
    hidden = 1 - dataset.visible.sum((1, 2)) / dataset.amodal.sum((1, 2))
    np.testing.assert_allclose(dataset.occlusion, hidden, atol=1e-6)
    assert np.abs(dataset.occlusion - dataset.target_occlusion).max() < 0.03
    assert all((cause == "none") == (share == 0) for cause, share in zip(dataset.cause, hidden, strict=True))


def test_latents_are_those_of_the_specs_at_the_papers_exposure(dataset: Dataset) -> None:
    np.testing.assert_array_equal(dataset.latents, [spec.latents() for spec in dataset.specs()])
    np.testing.assert_allclose(dataset.latents[:, 15], EXPOSURE_L00, rtol=1e-6)


def test_a_missing_dataset_or_split_is_told(made: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"expected a dataset folder with info\.json"):
        read_dataset(tmp_path / "nowhere")
    with pytest.raises(UserError, match="has no test split; it has train"):
        read_dataset(made, "test")


@pytest.mark.parametrize("damage", ["info.json", "train/latents.parquet"])
def test_a_damaged_file_is_told(damage: str, made: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(made, tmp_path / "copy")
    (copy / damage).write_bytes((copy / damage).read_bytes()[:40])
    with pytest.raises(UserError, match=r"(expected a dataset folder|damaged)"):
        read_dataset(copy)


@pytest.mark.parametrize("content", [None, b"", b"\x89PNG\r\n\x1a\nhalf"])
def test_a_damaged_picture_is_told(content: bytes | None, made: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(made, tmp_path / "copy")
    picture = copy / "train" / "000000" / "rgb" / "000002.png"
    picture.unlink()
    if content is not None:
        picture.write_bytes(content)
    dataset = read_dataset(copy)
    with pytest.raises(UserError, match=r"expected a picture .*000002\.png'; got "):
        _ = dataset.images
