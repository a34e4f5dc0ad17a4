"""`check_dataset` calls a whole dataset clean, and names every kind of damage."""

import hashlib
import io
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image

from tests.vig_world.generation.labels import problems_of, seal, silhouette
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.assets.target import target_vertices
from vig_world.composition.sampling import sample
from vig_world.dataset.spec import Split
from vig_world.generation.check import check_dataset
from vig_world.library import Library
from vig_world.renderers.rasterized import render

COUNT = 10  # of the fixture `made`
AGAIN = 5  # samples that are rendered again: 0, 2, 4, 7 and 9
SCENE = Path("train/000000")


@pytest.fixture
def copy(made: Path, tmp_path: Path) -> Path:
    return shutil.copytree(made, tmp_path / "copy")


def test_a_whole_dataset_is_clean_and_renders_to_the_same_bytes(made: Path, teapot: ObjectClass) -> None:
    found = check_dataset(made, render=3, object_class=teapot)
    assert found.problems == ()
    assert (found.samples, found.rendered) == (COUNT, 3)
    assert found.files == 4 * COUNT + 5
    assert found.summary() == "train: 10 samples, 45 files, 3 rendered again: clean"


def test_the_manifest_is_what_sha256sum_reads(made: Path) -> None:
    for line in (made / "train" / "files.sha256").read_text().splitlines():
        digest, name = line.split("  ")
        assert hashlib.sha256((made / "train" / name).read_bytes()).hexdigest() == digest


@pytest.mark.parametrize("split", ["train", "test"])
def test_the_silhouette_is_the_renderers(split: Split, teapot: ObjectClass) -> None:
    """Two renderers, and in the test split a shape beyond the model: at most a few pixels differ."""
    library = Library(split)
    spec = sample(library, teapot, 5, 0)
    canvas = silhouette(teapot, target_vertices(spec, teapot), spec)
    assert (canvas != render(library, spec, teapot).canvas).sum() <= 0.002 * canvas.sum()


@pytest.mark.parametrize(
    ("damage", "expected"),
    [
        (lambda f: (f / "000000/rgb/000003.png").unlink(), "000000/rgb/000003.png: No such file"),
        (
            lambda f: (f / "000000/depth/000001.png").write_bytes(b"x"),
            "000001.png: changed since it was written",
        ),
        (lambda f: (f / "000000/notes.txt").write_text("x"), "notes.txt: an unexpected file"),
        (lambda f: (f / "specs.jsonl").write_text(""), "specs.jsonl: changed since it was written"),
        (lambda f: (f.parent / "camera.json").unlink(), "camera.json: missing or not"),
        (lambda f: (f.parent / "models/obj_000001.ply").write_bytes(b""), "obj_000001.ply: missing or not"),
    ],
)
def test_damaged_files_are_named(
    damage: Callable[[Path], object], expected: str, copy: Path, teapot: ObjectClass
) -> None:
    damage(copy / "train")
    problems = check_dataset(copy, object_class=teapot).problems
    assert any(expected in problem for problem in problems), problems


def picture(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(array).save(buffer, "PNG")
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("name", "change", "expected"),
    [
        ("mask/000002_000000.png", lambda a: a // 2, "masks are not of 0 and 255"),
        ("mask/000002_000000.png", lambda a: a * 0, "the whole one around"),
        ("mask_visib/000002_000000.png", lambda a: 255 - a, "the whole one around the visible"),
        ("rgb/000002.png", lambda a: a[:, :, 0], "150 x 150 L, not 150 x 150 RGB"),
        ("rgb/000002.png", lambda a: a[1:], "150 x 149 RGB"),
    ],
)
def test_pictures_that_cannot_be_are_found(
    name: str, change: Callable[[np.ndarray], np.ndarray], expected: str, copy: Path, teapot: ObjectClass
) -> None:
    path = copy / SCENE / name
    path.write_bytes(picture(change(np.asarray(Image.open(path)))))
    seal(copy)
    problems = check_dataset(copy, object_class=teapot).problems
    assert any(expected in problem for problem in problems), problems
    assert all("sample 2" in problem or "000002" in problem for problem in problems)


def test_all_labels_agree_with_each_other(made: Path, teapot: ObjectClass) -> None:
    assert problems_of(made, teapot) == []


@pytest.mark.parametrize(
    ("name", "change", "expected"),
    [
        ("mask", lambda a: a[::-1, ::-1], "are not where the mesh projects"),
        ("mask_visib", lambda a: a * 0, "the masks give 1.0000"),
        ("depth", lambda a: a * 0, "px_count_valid"),
        ("depth", lambda a: (a * 0.5).astype(a.dtype), "are within the object's depth"),
    ],
)
def test_pictures_that_contradict_the_labels_are_found(
    name: str, change: Callable[[np.ndarray], np.ndarray], expected: str, copy: Path, teapot: ObjectClass
) -> None:
    path = copy / SCENE / name / ("000002.png" if name == "depth" else "000002_000000.png")
    path.write_bytes(picture(change(np.asarray(Image.open(path))).copy()))
    seal(copy)
    assert any(expected in problem for problem in problems_of(copy, teapot))
    problems = check_dataset(copy, render=AGAIN, object_class=teapot).problems
    named = path.relative_to(copy / "train").as_posix()
    assert f"{named}: differs when rendered again from its spec" in problems
    assert all("sample 2" in problem or "000002" in problem for problem in problems)


@pytest.mark.parametrize(
    ("column", "value", "expected"),
    [
        ("shape_0", 3.5, "not within 3 standard deviations"),
        ("azimuth", 1.0, "latents differ from the spec's"),
        ("albedo_g", float("nan"), "a latent is not finite"),
        ("albedo_b", 1.5, "albedo is not in"),
        ("light_0_0", -1.0, "the light has no mean"),
        ("occlusion", 0.123, "the masks give"),
        ("visib_fract", 0.123, "do not add up to 1"),
        ("share_truncation", 0.5, "share_truncation is 0.5000"),
        ("cause", "weather", "cause is weather"),
        ("target_occlusion", 0.123, "differs from the spec's"),
    ],
)
def test_wrong_rows_are_found(
    column: str, value: object, expected: str, copy: Path, teapot: ObjectClass
) -> None:
    path = copy / "train" / "latents.parquet"
    rows = pq.read_table(path).to_pylist()
    rows[2][column] = value
    pq.write_table(pa.Table.from_pylist(rows), path)
    seal(copy)
    assert any(expected in problem for problem in problems_of(copy, teapot))
    problems = check_dataset(copy, render=AGAIN, object_class=teapot).problems
    assert problems == (f"sample 2: rendered again from its spec, these columns differ: {column}",)


@pytest.mark.parametrize(
    ("name", "key", "value", "expected"),
    [
        ("scene_gt", "cam_R_m2c", [1, 0, 0, 0, 1, 0, 0, 0, 2], "not a rotation"),
        ("scene_gt", "cam_R_m2c", [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_R_m2c does not agree"),
        ("scene_gt", "cam_t_m2c", [0, 0, 400], "cam_t_m2c does not agree"),
        ("scene_gt", "obj_id", 2, "obj_id does not agree"),
        ("scene_gt_info", "px_count_all", 7, "px_count_all is 7"),
        ("scene_gt_info", "bbox_visib", [0, 0, 1, 1], "bbox_visib is [0, 0, 1, 1]"),
        ("scene_gt_info", "visib_fract", 2.0, "visib_fract is 2.0"),
    ],
)
def test_wrong_bop_entries_are_found(
    name: str, key: str, value: object, expected: str, copy: Path, teapot: ObjectClass
) -> None:
    path = copy / SCENE / f"{name}.json"
    entries = json.loads(path.read_text())
    entries["2"][0][key] = value
    path.write_text(json.dumps(entries))
    seal(copy)
    assert any(expected in problem for problem in problems_of(copy, teapot))
    problems = check_dataset(copy, render=AGAIN, object_class=teapot).problems
    assert f"sample 2: rendered again from its spec, its {name.removeprefix('scene_')} differs" in problems


def test_rendering_again_finds_a_picture_of_something_else(copy: Path, teapot: ObjectClass) -> None:
    """And not one that is only compressed otherwise."""
    other = copy / SCENE / "rgb" / "000001.png"
    Image.open(other).copy().save(other)
    path = copy / SCENE / "rgb" / "000000.png"
    path.write_bytes((copy / SCENE / "rgb" / "000001.png").read_bytes())
    seal(copy)
    assert check_dataset(copy, object_class=teapot).clean
    problems = check_dataset(copy, render=2, object_class=teapot).problems
    assert problems == ("000000/rgb/000000.png: differs when rendered again from its spec",)


def test_another_class_or_a_damaged_manifest_is_told(copy: Path, teapot: ObjectClass) -> None:
    other = ObjectClass(
        "teapot", teapot.shape_model, 0.5, teapot.light_prior_mean, teapot.light_prior_covariance
    )
    with pytest.raises(UserError, match="another class"):
        check_dataset(copy, object_class=other)
    (copy / "train" / "files.sha256").write_text("")
    with pytest.raises(UserError, match="changed after it was written"):
        check_dataset(copy, object_class=teapot)
