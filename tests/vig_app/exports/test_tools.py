"""Exports read by the libraries of the tools that they are for."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

import vig
from vig_app.examples import example_photos
from vig_app.exports import export_run
from vig_app.results import write_table
from vig_app.runs.work import Task, row_of

NAME = "COCO_val2014_000000000139.png"


@pytest.fixture(scope="module")
def explanation() -> vig.Explanation:
    return vig.Explainer("teapot").explain(example_photos()[1].photo, camera=(300, 310, 90, 70))


@pytest.fixture(scope="module")
def run(explanation: vig.Explanation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of two photos, the second without the object."""
    out = tmp_path_factory.mktemp("run")
    absent = replace(explanation, fit=replace(explanation.fit, verdict=vig.Verdict.ABSENT, confidence=0.0))
    rows = []
    for name, saved in ((NAME, explanation), ("COCO_val2014_000000000285.png", absent)):
        task = Task(Path("photos") / name, out / Path(name).stem)
        saved.save(task.folder)
        rows.append(row_of(task, saved) | {"seconds": 0.5})
    write_table(out, rows)
    return out


def test_coco_tools_read_masks_and_results(explanation: vig.Explanation, run: Path, tmp_path: Path) -> None:
    coco = pytest.importorskip("pycocotools.coco")
    explanation.export(tmp_path, ["coco"], NAME)
    truth = coco.COCO(str(tmp_path / "coco.json"))
    assert truth.getImgIds() == [139]
    (annotation,) = truth.loadAnns(truth.getAnnIds(imgIds=[139]))
    np.testing.assert_array_equal(truth.annToMask(annotation).astype(bool), explanation.amodal)
    (written,) = export_run(run, ["coco"], tmp_path / "run")
    of_run = coco.COCO(str(written))
    (result,) = of_run.loadAnns(of_run.getAnnIds(imgIds=[139]))
    np.testing.assert_array_equal(of_run.annToMask(result).astype(bool), explanation.amodal)
    seen = result | {"segmentation": result["visible_segmentation"]}
    np.testing.assert_array_equal(of_run.annToMask(seen).astype(bool), explanation.mask)
    assert len(truth.loadRes(of_run.dataset["annotations"]).getAnnIds()) == 1


def test_opencv_projects_the_object_onto_the_photo_and_solves_for_its_pose(run: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    import trimesh

    folder = run / Path(NAME).stem
    described = json.loads((folder / "explanation.json").read_text())
    scene = trimesh.load_scene(folder / "object.glb", process=False)
    stored = np.concatenate([mesh.vertices for mesh in scene.geometry.values()]).astype(float)
    matrix, pose = np.array(described["camera"]["K"]), np.array(described["camera"]["camera_from_object"])
    turn = Rotation.from_matrix(pose[:3, :3]).as_rotvec()
    pixels, _ = cv2.projectPoints(stored, turn, pose[:3, 3], matrix, None)
    x, y, w, h = described["box"]
    low, high = pixels[:, 0].min(0), pixels[:, 0].max(0)
    np.testing.assert_allclose([*low, *(high - low)], [x, y, w, h], atol=2.5)
    solved, found_turn, place = cv2.solvePnP(stored, pixels, matrix, None)
    assert solved
    np.testing.assert_allclose(found_turn.ravel(), turn, atol=1e-4)
    np.testing.assert_allclose(place.ravel(), pose[:3, 3], atol=1e-4)


def test_usd_opens_the_object_with_its_extent_and_normals(
    explanation: vig.Explanation, tmp_path: Path
) -> None:
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom

    explanation.export(tmp_path, ["usd"])
    stage = Usd.Stage.Open(str(tmp_path / "object.usdc"))
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    bounds = cache.ComputeWorldBound(stage.GetDefaultPrim()).ComputeAlignedRange()
    np.testing.assert_allclose(bounds.GetMin(), explanation.vertices.min(0), atol=1e-6)
    np.testing.assert_allclose(bounds.GetMax(), explanation.vertices.max(0), atol=1e-6)
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            mesh = UsdGeom.Mesh(prim)
            points = np.array(mesh.GetPointsAttr().Get())
            normals = np.array(mesh.GetNormalsAttr().Get())
            assert normals.shape == points.shape and mesh.GetNormalsInterpolation() == "vertex"
            np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
            np.testing.assert_allclose(mesh.GetExtentAttr().Get(), [points.min(0), points.max(0)])


def test_nerfstudio_gets_the_photo_and_does_not_train_on_what_hides_the_object(
    explanation: vig.Explanation, tmp_path: Path
) -> None:
    explanation.export(tmp_path, ["nerfstudio"], NAME)
    (frame,) = json.loads((tmp_path / "transforms.json").read_text())["frames"]
    mask = np.asarray(Image.open(tmp_path / frame["mask_path"]))
    np.testing.assert_array_equal(mask > 0, explanation.mask)
    assert (explanation.amodal & ~explanation.mask).any(), "something hides a part of it"
    photo = np.asarray(Image.open(tmp_path / frame["file_path"]))
    np.testing.assert_array_equal(photo, explanation.picture)


def test_a_result_saved_again_leaves_no_export_of_the_one_before(
    explanation: vig.Explanation, tmp_path: Path
) -> None:
    """Exports of the same result stay, those of another go, and what is not vig's stays."""
    explanation.save(tmp_path)
    explanation.export(tmp_path, ["bop", "coco", "nerfstudio", "ros"])
    (tmp_path / "bop" / "mine.txt").write_text("mine")
    explanation.save(tmp_path)
    assert (tmp_path / "bop" / "scene_gt.json").exists() and (tmp_path / "pose.yaml").exists()
    moved = replace(explanation.fit, framing=explanation.fit.framing + np.array([0.1, 0, 0, 0], np.float32))
    replace(explanation, fit=moved).save(tmp_path)
    left = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    assert left == {
        "bop/mine.txt", "explanation.json", "mask.png", "object.glb", "overlay.png", "render.png",
        "report.html", "thumbnail.jpg",
    }  # fmt: skip
