import io
import json
import tarfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vig.io.errors import UserError
from vig.photo.masks import coco_region, run_lengths
from vig_world.dataset import Dataset
from vig_world.generation.coco import export_coco
from vig_world.generation.webdataset import export_webdataset


def decoded(rle: dict) -> np.ndarray:
    """A mask from COCO's run lengths, written out the slow way."""
    height, width = rle["size"]
    pixels: list[bool] = []
    for place, count in enumerate(rle["counts"]):
        pixels += [place % 2 == 1] * count
    mask = np.zeros((height, width), bool)
    for place, value in enumerate(pixels):
        mask[place % height, place // height] = value  # column by column
    return mask


@pytest.mark.parametrize(
    ("rows", "counts"),
    [
        ("010 010", [2, 2, 2]),
        ("100 000", [0, 1, 5]),
        ("000 001", [5, 1]),
        ("111 111", [0, 6]),
        ("000 000", [6]),
        ("101 010", [0, 1, 2, 2, 1]),
    ],
)
def test_run_lengths_by_hand(rows: str, counts: list[int]) -> None:
    mask = np.array([[c == "1" for c in row] for row in rows.split()])
    assert run_lengths(mask) == {"size": [2, 3], "counts": counts}
    np.testing.assert_array_equal(decoded(run_lengths(mask)), mask)


def test_a_box_covers_whole_pixels() -> None:
    mask = np.zeros((6, 8), bool)
    mask[2:4, 3] = True
    assert coco_region(mask)["bbox"] == [3, 2, 1, 2]


@pytest.fixture(scope="module")
def coco(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export_coco(made, tmp_path_factory.mktemp("coco") / "out")


def test_coco_has_the_visible_masks(coco: Path, dataset: Dataset) -> None:
    written = json.loads((coco / "annotations" / "instances_train.json").read_text())
    assert [image["id"] for image in written["images"]] == list(range(len(dataset)))
    assert written["categories"] == [{"id": 1, "name": "teapot", "supercategory": "object"}]
    assert len({each["id"] for each in written["annotations"]}) == len(written["annotations"]) == len(dataset)
    for each in written["annotations"]:
        seen = dataset.visible[each["image_id"]]
        np.testing.assert_array_equal(decoded(each["segmentation"]), seen)
        assert (each["area"], each["iscrowd"], each["category_id"]) == (seen.sum(), 0, 1)
        x, y, width, height = map(int, each["bbox"])
        assert seen[y : y + height, x : x + width].sum() == seen.sum()
        assert (
            seen[y].any() and seen[:, x].any() and seen[y + height - 1].any() and seen[:, x + width - 1].any()
        )
    image = written["images"][4]
    shown = np.asarray(Image.open(coco / "images" / "train" / image["file_name"]))
    np.testing.assert_array_equal(shown, dataset.images[4])


def test_coco_has_the_amodal_masks_under_the_names_that_tools_read(coco: Path, dataset: Dataset) -> None:
    written = json.loads((coco / "annotations" / "amodal_train.json").read_text())
    for each, occlusion in zip(written["annotations"], dataset.occlusion, strict=True):
        whole, seen = dataset.amodal[each["image_id"]], dataset.visible[each["image_id"]]
        np.testing.assert_array_equal(decoded(each["segmentation"]), whole)
        np.testing.assert_array_equal(decoded(each["visible_mask"]), seen)
        np.testing.assert_array_equal(decoded(each["invisible_mask"]), whole & ~seen)
        assert (each["area"], each["a_area"], each["i_area"]) == (whole.sum(), whole.sum(), seen.sum())
        assert each["occlude_rate"] == pytest.approx(occlusion, abs=1e-6)
        assert (each["a_segm"], each["i_segm"]) == (each["segmentation"], each["visible_mask"])
        assert (each["a_bbox"], each["i_bbox"]) == (each["bbox"], each["visible_bbox"])


def test_shards_hold_every_sample_once(made: Path, dataset: Dataset, tmp_path: Path) -> None:
    out = export_webdataset(made, tmp_path / "out", shard=4)
    assert sorted(path.name for path in out.iterdir()) == [f"train-{i:06d}.tar" for i in range(3)]
    samples: dict[str, dict[str, bytes]] = {}
    for path in sorted(out.iterdir()):
        with tarfile.open(path) as tar:
            for member in tar:
                key, _, name = member.name.partition(".")
                content = tar.extractfile(member)
                assert content is not None
                samples.setdefault(key, {})[name] = content.read()
                assert (member.mtime, member.uid, member.uname) == (0, 0, "")
    assert list(samples) == [f"{i:06d}" for i in range(len(dataset))]
    for index, files in enumerate(samples.values()):
        assert list(files) == ["rgb.png", "depth.png", "mask.png", "mask_visib.png", "json"]
        np.testing.assert_array_equal(Image.open(io.BytesIO(files["rgb.png"])), dataset.images[index])
        label = json.loads(files["json"])
        assert label["row"]["index"] == index
        assert label["gt_info"][0]["px_count_visib"] == dataset.visible[index].sum()


def test_shards_are_the_same_bytes_again(made: Path, tmp_path: Path) -> None:
    one, two = (export_webdataset(made, tmp_path / name, shard=7) for name in ("one", "two"))
    assert all(path.read_bytes() == (two / path.name).read_bytes() for path in one.iterdir())


def test_a_shard_of_nothing_is_refused(made: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="shard must be at least 1"):
        export_webdataset(made, tmp_path / "out", shard=0)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("export", [export_coco, export_webdataset])
def test_an_export_goes_into_a_folder_of_its_own(made: Path, tmp_path: Path, export) -> None:
    """Two exports never mix, and a dataset is not exported into itself."""
    with pytest.raises(UserError, match="is the dataset itself"):
        export(made, made)
    export(made, tmp_path / "out")
    before = sorted((tmp_path / "out").rglob("*"))
    with pytest.raises(UserError, match="already holds"):
        export(made, tmp_path / "out")
    assert sorted((tmp_path / "out").rglob("*")) == before
