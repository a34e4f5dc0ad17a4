"""Damaged datasets: everything that reads one returns sane arrays or refuses in one line."""

import hashlib
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image

from tests.fuzz.mutations import Damage, damaged, damaged_json, outcomes, read_damaged
from tests.vig_world.generation.labels import seal
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.dataset import read_dataset
from vig_world.dataset.format import COLUMNS
from vig_world.generation.check import check_dataset
from vig_world.generation.coco import export_coco
from vig_world.generation.describe import describe_split
from vig_world.generation.webdataset import export_webdataset
from vig_world.generation.write import alone, make_dataset

COUNT = 2


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_dataset(tmp_path_factory.mktemp("fuzz") / "d", COUNT, 3, workers=1, progress=False)


@pytest.fixture
def root(made: Path, tmp_path: Path) -> Path:
    return shutil.copytree(made, tmp_path / "d")


def trust(listed: Path) -> None:
    """Make info.json name a list of files as it is now."""
    info = json.loads((listed.parents[1] / "info.json").read_text())
    info["splits"]["train"]["manifest_sha256"] = hashlib.sha256(listed.read_bytes()).hexdigest()
    (listed.parents[1] / "info.json").write_text(json.dumps(info))


def everything(root: Path) -> None:
    """Read all that a training run or a report reads."""
    dataset = read_dataset(root, "train")
    assert len(dataset) == COUNT and np.isfinite(dataset.latents).all()
    assert dataset.images.shape == (COUNT, 150, 150, 3) and dataset.visible.shape == dataset.amodal.shape
    assert dataset.read("depth").dtype == np.float32
    assert len(dataset.specs()) == COUNT
    describe_split(root, "train")


@pytest.mark.parametrize(
    ("name", "damage", "count"),
    [
        ("info.json", damaged_json, 100),
        ("train/specs.jsonl", damaged, 40),
        ("train/latents.parquet", damaged, 100),
        ("train/000000/rgb/000001.png", damaged, 60),
        ("train/000000/depth/000000.png", damaged, 40),
        ("train/000000/mask_visib/000000_000000.png", damaged, 40),
    ],
)
def test_damaged_files(name: str, damage: Damage, count: int, root: Path) -> None:
    read_damaged(root / name, damage, lambda _: everything(root), count, len(name), count // 5)


def damaged_line(data: bytes, rng: np.random.Generator) -> bytes:
    """The first of several lines of JSON damaged."""
    first, *rest = data.splitlines(keepends=True)
    return damaged_json(first, rng).replace(b"\n", b"") + b"\n" + b"".join(rest)


def test_damaged_specs(root: Path) -> None:
    dataset = read_dataset(root)
    read_damaged(root / "train" / "specs.jsonl", damaged_line, lambda _: dataset.specs(), 150, 7, 40)


@pytest.mark.parametrize("key", ["camera", "gt", "gt_info"])
def test_damaged_labels(key: str, root: Path, tmp_path: Path) -> None:
    """The exports hand labels on; what they cannot read they refuse."""

    def exported(_: Path) -> None:
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        export_webdataset(root, tmp_path / "out")

    read_damaged(root / "train" / "000000" / f"scene_{key}.json", damaged_json, exported, 25, 8, 2)


@pytest.mark.parametrize(
    "name",
    ["train/000000/scene_gt.json", "train/000000/scene_gt_info.json", "train/specs.jsonl", "info.json"],
)
def test_the_check_of_a_damaged_dataset(name: str, root: Path, packaged: ObjectClass) -> None:
    """Whatever is in the labels, the check ends with findings, also where all hashes have been mended."""

    def checked(_: Path) -> None:
        if name != "info.json":
            seal(root)
        check_dataset(root, object_class=packaged)

    damage = damaged_line if name.endswith("specs.jsonl") else damaged_json
    read_damaged(root / name, damage, checked, 10, 9, -1)


def test_damaged_lists_of_files(root: Path, packaged: ObjectClass) -> None:
    whole = (root / "train" / "files.sha256").read_bytes()

    def checked(path: Path) -> None:
        trust(path)
        assert check_dataset(root, object_class=packaged).clean == (path.read_bytes() == whole)

    read_damaged(root / "train" / "files.sha256", damaged, checked, 15, 10, 1)


@pytest.mark.parametrize("name", ["/dev/zero", "../../../../dev/zero", "../info.json", "link", "pipe"])
def test_lists_that_name_files_elsewhere(name: str, root: Path, packaged: ObjectClass) -> None:
    """A list of files that named /dev/zero was read without end."""
    (root / "train" / "link").symlink_to("/dev/zero")
    os.mkfifo(root / "train" / "pipe")
    path = root / "train" / "files.sha256"
    with path.open("a") as file:
        file.write(f"{'0' * 64}  {name}\n")
    trust(path)
    if name == "pipe":
        found = check_dataset(root, object_class=packaged).problems
        assert "pipe: it is a folder, device or pipe, not a file" in found
    else:
        with pytest.raises(UserError, match="leads out of its folder"):
            check_dataset(root, object_class=packaged)


def test_pictures_that_are_links_are_not_followed_out(root: Path, tmp_path: Path) -> None:
    picture = root / "train" / "000000" / "rgb" / "000000.png"
    picture.rename(tmp_path / "elsewhere.png")
    picture.symlink_to(tmp_path / "elsewhere.png")
    with pytest.raises(UserError, match="a link that leads out of its folder"):
        read_dataset(root).read("rgb")


def with_column(table: pa.Table, name: str, values: pa.Array) -> pa.Table:
    return table.set_column(table.column_names.index(name), name, values)


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (
            lambda table: table.slice(0, 1).take(pa.array(np.zeros(300_000, np.int64))),
            "it has 300000 rows for 2 samples",
        ),
        (
            lambda table: with_column(table, "cause", pa.array(["x" * 10_000_000] * COUNT)),
            "cause has more than 16384 bytes of text a row",
        ),
        (
            lambda table: with_column(
                table, "assets", pa.array([["x"] * 1_000_000] * COUNT, table["assets"].type)
            ),
            "a list in it has more than 256 entries",
        ),
    ],
)
def test_what_repeats_is_refused_before_it_fills_the_memory(spoil: Callable, why: str, root: Path) -> None:
    """Rows, texts and lists that a small file holds."""
    path = root / "train" / "latents.parquet"
    pq.write_table(spoil(pq.read_table(path)), path)
    assert path.stat().st_size < 4 << 20
    with pytest.raises(UserError, match=why):
        read_dataset(root)


@pytest.mark.parametrize(
    "name", ["azimuth", "light_0_0", "occlusion", "truncated", "cause", "design", "hidden_by"]
)
def test_columns_of_other_types(name: str, root: Path) -> None:
    path = root / "train" / "latents.parquet"
    table = pq.read_table(path)
    others = [
        pa.array([None] * COUNT, table[name].type),
        pa.array([{"a": 1}] * COUNT),
        pa.array([[[1]]] * COUNT),
        pa.array([b"\xff\xfe"] * COUNT),
        pa.array([float("nan")] * COUNT),
        pa.array([10**30] * COUNT, pa.decimal128(38)),
        pa.array([0] * COUNT, pa.timestamp("us")),
    ]

    def written(values: pa.Array) -> None:
        pq.write_table(with_column(table, name, values), path)
        everything(root)

    counts = outcomes(others, written)
    assert counts["refused"] >= (0 if name == "hidden_by" else 6)  # which only the check and an export read
    pq.write_table(table.drop_columns([name]), path)
    with pytest.raises(UserError, match="its columns are not those of a dataset"):
        read_dataset(root)
    assert name in COLUMNS or name in ("azimuth", "light_0_0")


@pytest.mark.parametrize("size", [(20_000, 20_000), (151, 150)])
def test_a_picture_of_another_size_is_not_decoded(size: tuple[int, int], root: Path, tmp_path: Path) -> None:
    picture = root / "train" / "000000" / "mask" / "000000_000000.png"
    Image.new("1", size).save(tmp_path / "big.png")
    shutil.copy(tmp_path / "big.png", picture)
    with pytest.raises(UserError, match=f"got a damaged file .*({size[0]} x {size[1]}|exceeds limit)"):
        read_dataset(root).read("mask")
    found = check_dataset(root).problems
    assert any("000000_000000.png: " in problem for problem in found)
    with pytest.raises(UserError):
        export_coco(root, tmp_path / "coco")


def test_the_lock_neither_follows_a_link_nor_empties_a_file(tmp_path: Path) -> None:
    (tmp_path / "d").mkdir()
    (tmp_path / "precious").write_text("keep")
    (tmp_path / "d" / ".train.lock").symlink_to(tmp_path / "precious")
    with pytest.raises(UserError, match="cannot write"), alone(tmp_path / "d", "train"):
        pytest.fail("the lock must not be taken")
    assert (tmp_path / "precious").read_text() == "keep"
    (tmp_path / ".train.lock").write_text("keep")
    with alone(tmp_path, "train"):
        assert (tmp_path / ".train.lock").read_text() == "keep"
