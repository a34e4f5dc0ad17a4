from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vig.dataset import make_dataset
from vig.dataset.write import _Job, _sidecar
from vig.errors import UserError
from vig.scene import ObjectClass

COUNT, SEED = 10, 5  # of the fixture `made`


def contents(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()}


def test_the_bytes_do_not_depend_on_the_number_of_workers(
    made: Path, tmp_path: Path, teapot: ObjectClass
) -> None:
    other = make_dataset(tmp_path / "two", COUNT, SEED, workers=2, progress=False, object_class=teapot)
    assert contents(other) == contents(made)


def test_a_killed_run_is_completed_with_the_same_bytes(
    made: Path, tmp_path: Path, teapot: ObjectClass, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, calls = _Job.make, []

    def killed_at_the_fourth(job: _Job, indices: list[int]) -> int:
        calls.append(indices)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return whole(job, indices)

    out = tmp_path / "killed"
    monkeypatch.setattr(_Job, "make", killed_at_the_fourth)
    with pytest.raises(KeyboardInterrupt):
        make_dataset(out, COUNT, SEED, workers=1, progress=False, object_class=teapot)
    assert [_sidecar(out / "train", i).is_file() for i in range(5)] == [True, True, True, False, False]
    half_written = out / "train" / "000000" / "rgb" / ".0123456789ab.png"
    half_written.write_bytes(b"half")
    make_dataset(out, COUNT, SEED, workers=1, progress=False, object_class=teapot)
    assert sum(len(indices) for indices in calls[4:]) == COUNT - 3
    assert contents(out) == contents(made)


def test_a_complete_dataset_is_left_as_it_is(
    made: Path, teapot: ObjectClass, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(_Job, "make")
    before = contents(made)
    make_dataset(made, COUNT, SEED, progress=False, object_class=teapot)
    assert contents(made) == before


def test_bop_files_agree_with_the_masks(made: Path) -> None:
    scene = made / "train" / "000000"
    truth, info, cameras = (
        json.loads((scene / f"{name}.json").read_text())
        for name in ("scene_gt", "scene_gt_info", "scene_camera")
    )
    assert list(truth) == list(info) == list(cameras) == [str(i) for i in range(COUNT)]
    for key in truth:
        number = int(key)
        alone = np.asarray(Image.open(scene / "mask" / f"{number:06d}_000000.png")) > 0
        seen = np.asarray(Image.open(scene / "mask_visib" / f"{number:06d}_000000.png")) > 0
        assert not (seen & ~alone).any()
        (described,) = info[key]
        assert described["px_count_all"] == alone.sum() > 500
        assert described["px_count_visib"] == seen.sum()
        assert described["visib_fract"] == pytest.approx(seen.sum() / alone.sum())
        x, y, width, height = described["bbox_obj"]
        assert alone[y : y + height, x : x + width].sum() == alone.sum()
        assert alone[y].any() and alone[:, x].any()
        (pose,) = truth[key]
        rotation = np.array(pose["cam_R_m2c"]).reshape(3, 3)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(rotation) == pytest.approx(1)
        assert pose["obj_id"] == 1
        # The eye is 400 mm from the point on the object's axis at which it looks.
        eye = -rotation.T @ np.array(pose["cam_t_m2c"])
        assert np.linalg.norm(eye - [0, 0, eye[2] - 400 * -rotation[2, 2]]) == pytest.approx(400)
        assert cameras[key]["cam_K"] == pytest.approx([168, 0, 75, 0, 168, 75, 0, 0, 1])


def test_depth_is_in_units_of_the_scale(made: Path) -> None:
    """The object's nearest visible point is less than 0.4 m and more than 0.15 m from the eye."""
    scene = made / "train" / "000000"
    for number in range(COUNT):
        depth = np.asarray(Image.open(scene / "depth" / f"{number:06d}.png"))
        seen = np.asarray(Image.open(scene / "mask_visib" / f"{number:06d}_000000.png")) > 0
        assert depth.dtype == np.uint16
        millimetres = depth[seen] * json.loads((scene / "scene_camera.json").read_text())["0"]["depth_scale"]
        assert 80 < millimetres.min() < 400
        assert millimetres.min() < np.median(millimetres) < 450


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"count": 0}, "count must be at least 1; got 0"),
        ({"seed": -1}, "seed must be"),
        ({"split": "validation"}, "split must be one of train, test; got 'validation'"),
        ({"tier": "oil"}, "tier must be one of raster; got 'oil'"),
        ({"workers": 0}, "workers must be at least 1"),
    ],
)
def test_wrong_arguments_are_refused_before_anything_is_written(
    settings: dict[str, object], expected: str, tmp_path: Path, teapot: ObjectClass
) -> None:
    arguments: dict[str, object] = {
        "count": 1,
        "seed": 0,
        "object_class": teapot,
        "progress": False,
        **settings,
    }
    with pytest.raises(UserError, match=expected):
        make_dataset(tmp_path / "out", **arguments)  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()


def test_a_folder_of_something_else_is_refused(tmp_path: Path, teapot: ObjectClass) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(UserError, match=r"expected a dataset folder with info\.json"):
        make_dataset(tmp_path, 1, 0, object_class=teapot, progress=False)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize(("settings", "word"), [((COUNT, SEED + 1), "seed"), ((COUNT + 1, SEED), "count")])
def test_a_dataset_of_other_settings_is_refused(
    settings: tuple[int, int], word: str, made: Path, tmp_path: Path, teapot: ObjectClass
) -> None:
    copy = shutil.copytree(made, tmp_path / "copy")
    with pytest.raises(UserError, match=f"already holds a train split with {word}"):
        make_dataset(copy, *settings, object_class=teapot, progress=False)
    assert contents(copy) == contents(made)
