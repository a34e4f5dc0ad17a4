"""`vig bop` on a tiny data set in BOP's format: a scene of one image, whose object's model is a PLY file."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.vig.known_object.test_known_object import SIDES, K, carton, off, photo_of, pose_at
from vig.io.errors import UserError
from vig_app.cli.bop import bop
from vig_app.cli.common import BopCommand


def dump(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cartons")
    scene, models, surface = folder / "test/000003", folder / "models", carton()
    for each in (scene / "rgb", scene / "mask_visib", models):
        each.mkdir(parents=True)
    photo, mask = photo_of(pose_at(2))
    Image.fromarray(photo).save(scene / "rgb/000007.png")
    Image.fromarray(mask.astype(np.uint8) * 255).save(scene / "mask_visib/000007_000000.png")
    dump(scene / "scene_camera.json", {"7": {"cam_K": K.ravel().tolist(), "depth_scale": 1.0}})
    dump(scene / "scene_gt.json", {"7": [{"obj_id": 5}]})
    dump(
        models / "models_info.json",
        {"5": dict(zip(("size_x", "size_y", "size_z"), 1e3 * SIDES, strict=True))},
    )
    dump(folder / "test_targets_bop19.json", [{"scene_id": 3, "im_id": 7, "obj_id": 5, "inst_count": 1}])
    # a vertex of its own for each cell of the print, with its colour
    cells, colours = [], []
    for number, face in enumerate(surface.faces.reshape(6, 2, 3)):
        a, b, _, d = surface.vertices[[face[0, 0], face[0, 1], face[0, 2], face[1, 2]]]
        print_ = surface.texels.reshape(6, 32, 32, 3)[number, 4::8, 4::8][::-1]
        for row, column in np.ndindex(4, 4):
            corners = [(column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1)]
            cells.append([a + (b - a) * u / 4 + (d - a) * v / 4 for u, v in corners])
            colours += [print_[row, column]] * 4
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * n for n in range(len(cells))])
    mesh = trimesh.Trimesh(1e3 * np.concatenate(cells), faces, vertex_colors=np.array(colours), process=False)
    mesh.export(models / "obj_000005.ply")
    return folder


def pose_in(path: Path) -> tuple[dict[str, str], np.ndarray]:
    (row,) = csv.DictReader(path.read_text().splitlines())
    pose = np.eye(4)
    pose[:3, :3] = np.array(row["R"].split(), float).reshape(3, 3)
    pose[:3, 3] = np.array(row["t"].split(), float) / 1e3
    return row, pose


def test_the_pose_in_millimetres_is_found(dataset: Path, tmp_path: Path) -> None:
    assert bop(BopCommand(dataset, out=tmp_path)) == 0
    row, pose = pose_in(tmp_path / f"vig_{dataset.name}-test.csv")
    assert (row["scene_id"], row["im_id"], row["obj_id"]) == ("3", "7", "5")
    assert 0 < float(row["score"]) < 1 and float(row["time"]) > 0
    turned, moved = off(pose, pose_at(2))
    assert turned < 4 and moved < 0.01


def test_detections_are_taken_the_surest_first(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, mask = photo_of(pose_at(2))
    column_by_column = np.concatenate([[False], mask.T.ravel()])
    runs = np.diff([0, *(np.flatnonzero(np.diff(column_by_column.astype(int)))), mask.size])
    wrong = {"size": list(mask.shape), "counts": [0, 500, mask.size - 500]}
    right = {"size": list(mask.shape), "counts": runs.tolist()}
    place = {"scene_id": 3, "image_id": 7, "category_id": 5}
    found = [place | {"score": s, "segmentation": each} for s, each in ((0.3, wrong), (0.8, right))]
    dump(tmp_path / "detections.json", found)
    assert bop(BopCommand(dataset, detections=tmp_path / "detections.json", out=tmp_path, json=True)) == 0
    file = tmp_path / f"vig_{dataset.name}-test.csv"
    told = {"poses": 1, "missed": 0, "file": str(file), "folder": str(tmp_path)}
    assert json.loads(capsys.readouterr().out) == told
    row, pose = pose_in(file)
    assert off(pose, pose_at(2))[0] < 4 and float(row["score"]) < 0.8
    dump(tmp_path / "detections.json", [found[0] | {"segmentation": {"size": [4, 4], "counts": [3]}}])
    with pytest.raises(UserError, match="run lengths"):
        bop(BopCommand(dataset, detections=tmp_path / "detections.json", out=tmp_path))


def test_files_that_are_missing_are_named(dataset: Path, tmp_path: Path) -> None:
    for settings, words in (
        (BopCommand(dataset, split="val"), "a scene of BOP"),
        (BopCommand(dataset, targets=tmp_path / "none.json"), "targets of BOP"),
        (BopCommand(dataset, meshes=tmp_path), "the size of object 5"),
    ):
        with pytest.raises(UserError, match=words):
            bop(settings)


def test_what_cannot_be_fitted_is_named_and_the_others_go_on(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An object without a size in models_info.json, an image without a file, a mask of nothing."""
    _, mask = photo_of(pose_at(2))
    size = list(mask.shape)
    runs = np.diff([0, *np.flatnonzero(np.diff([0, *mask.T.ravel().astype(int)])), mask.size]).tolist()
    place = {"scene_id": 3, "image_id": 7, "score": 0.5}
    empty = {"size": size, "counts": [mask.size]}
    entries = [(5, {"size": size, "counts": runs}), (5, empty), (6, {"size": size, "counts": runs})]
    dump(tmp_path / "d.json", [place | {"category_id": n, "segmentation": each} for n, each in entries])
    targets = [{"scene_id": 3, "im_id": 7, "obj_id": n, "inst_count": 2} for n in (5, 6)]
    dump(tmp_path / "t.json", targets)
    out = tmp_path / "new"
    command = BopCommand(dataset, detections=tmp_path / "d.json", targets=tmp_path / "t.json", out=out)
    assert bop(command) == 0
    _, pose = pose_in(out / f"vig_{dataset.name}-test.csv")
    assert off(pose, pose_at(2))[0] < 4
    errors = capsys.readouterr().err
    assert "object 6" in errors and "its mesh cannot be used" in errors and "object 5: " in errors
