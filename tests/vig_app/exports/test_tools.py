"""Exports read by the libraries of the tools that they are for."""

import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

import vig
from vig.scene.light import linear_from_srgb, sh_basis
from vig_app.examples import example_photos
from vig_app.exports import export_run, remove_exports
from vig_app.exports.formats import blender
from vig_app.labels import fill_polygon, read_labels
from vig_app.results import write_table
from vig_app.runs.work import Task, row_of
from vig_world.renderers.cycles.renderer import find_python

NAME = "COCO_val2014_000000000139.png"


@pytest.fixture(scope="module")
def explanation() -> vig.Explanation:
    return vig.Explainer("teapot").explain(example_photos()[1].photo, K=(300, 310, 90, 70))


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


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


def test_coco_tools_read_polygons_of_both_sets_and_keypoints(
    explanation: vig.Explanation, run: Path, tmp_path: Path
) -> None:
    coco = pytest.importorskip("pycocotools.coco")
    pytest.importorskip("cv2")
    visible, amodal = export_run(run, ["coco-annotations"], tmp_path)
    for path, mask in ((visible, explanation.mask), (amodal, explanation.amodal)):
        read = coco.COCO(str(path))
        assert sorted(read.getImgIds()) == [139, 285] and not read.getAnnIds(imgIds=[285])
        (annotation,) = read.loadAnns(read.getAnnIds(imgIds=[139]))
        assert overlap(read.annToMask(annotation).astype(bool), mask) > 0.99
        (category,) = read.loadCats(read.getCatIds())
        assert category["keypoints"] == ["spout", "handle", "knob"] == [*explanation.points]
        places = np.reshape(annotation["keypoints"], (3, 3))
        np.testing.assert_allclose(places, np.array([*explanation.points.values()]) + (0, 0, 1))


def test_labels_of_every_tool_come_back_as_the_masks_that_were_exported(
    explanation: vig.Explanation, run: Path, tmp_path: Path
) -> None:
    pytest.importorskip("cv2")
    export_run(run, ["coco", "coco-annotations", "cvat", "labelme"], tmp_path)
    height, width = explanation.mask.shape
    for name in ("coco.json", "annotations_visible.json", "cvat_visible.xml", "labelme"):
        ((label,),) = (found for found in read_labels(tmp_path / name, pytest.fail).values() if found)
        hints = label.hints(width, height)
        assert label.name == "teapot" and overlap(np.asarray(hints.mask), explanation.mask) > 0.99
        assert hints.points.keys() == (set() if "cvat" in name else explanation.points.keys())
    ((label,),) = (
        found for found in read_labels(tmp_path / "cvat_cuboids.xml", pytest.fail).values() if found
    )
    x, y, right, bottom = np.array(label.box) + (0, 0, *label.box[:2])
    corners = projected_bounds(explanation)
    np.testing.assert_allclose([x, y, right, bottom], [*corners.min(0), *corners.max(0)], atol=0.02)


def projected_bounds(explanation: vig.Explanation) -> np.ndarray:
    low, high = explanation.vertices.min(0), explanation.vertices.max(0)
    places = np.array(
        [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )
    pose = explanation.camera_from_object
    seen = (places @ pose[:3, :3].T + pose[:3, 3]) @ explanation.camera.K.T
    return seen[:, :2] / seen[:, 2:]


def test_cvat_and_labelme_read_their_own_formats(
    explanation: vig.Explanation, run: Path, tmp_path: Path
) -> None:
    masks, label_file = pytest.importorskip("cvat_sdk.masks"), pytest.importorskip("labelme._label_file")
    export_run(run, ["cvat", "labelme"], tmp_path)
    height, width = explanation.mask.shape
    for name, mask in (("visible", explanation.mask), ("amodal", explanation.amodal)):
        first, _ = ElementTree.parse(tmp_path / f"cvat_{name}.xml").getroot().iter("image")
        at = first.find("mask").attrib
        left, top, columns, rows = (int(at[side]) for side in ("left", "top", "width", "height"))
        runs = [*map(float, at["rle"].split(",")), left, top, left + columns - 1, top + rows - 1]
        decoded = masks.decode_mask(runs, image_width=width, image_height=height)
        np.testing.assert_array_equal(decoded, mask)
    path = tmp_path / "labelme" / f"{Path(NAME).stem}.json"
    Image.fromarray(np.zeros((height, width), np.uint8)).save(path.with_name(NAME))
    read = label_file.read_label_file(str(path))
    assert {shape["shape_type"] for shape in read.shapes} == {"polygon", "point"}


def test_fiftyone_reads_masks_and_keypoints(explanation: vig.Explanation, run: Path, tmp_path: Path) -> None:
    reader = pytest.importorskip("fiftyone.utils.coco")
    path, _ = export_run(run, ["coco-annotations"], tmp_path)
    _, classes, _, _, annotations = reader.load_coco_detection_annotations(str(path))
    size = explanation.mask.shape[::-1]
    (read,) = annotations[139]
    detection = read.to_detection(size, classes_map=classes, load_segmentation=True)
    left, top = (round(at * side) for at, side in zip(detection.bounding_box, size, strict=False))
    mask = np.zeros_like(explanation.mask)
    part = np.asarray(detection.mask)
    mask[top : top + part.shape[0], left : left + part.shape[1]] = part
    assert detection.label == "teapot" and overlap(mask, explanation.mask) > 0.99
    assert len(read.to_keypoints(size, classes_map=classes).points) == 3


def test_label_studio_converts_polygons_and_keypoints(run: Path, tmp_path: Path) -> None:
    converter = pytest.importorskip("label_studio_sdk.converter.imports.coco")
    path, _ = export_run(run, ["coco-annotations"], tmp_path)
    converter.convert_coco_to_ls(str(path), str(tmp_path / "tasks.json"))
    first, second = json.loads((tmp_path / "tasks.json").read_text())
    kinds = [each["type"] for each in first["annotations"][0]["result"]]
    assert (
        set(kinds) == {"rectanglelabels", "polygonlabels", "keypointlabels"}
        and kinds.count("keypointlabels") == 3
    )
    assert second["annotations"][0]["result"] == []


def test_datumaro_reads_cvats_masks(explanation: vig.Explanation, run: Path, tmp_path: Path) -> None:
    datumaro = pytest.importorskip("datumaro.components.dataset")
    path, *others = export_run(run, ["cvat"], tmp_path)
    for other in others:  # it would join all files
        other.unlink()
    (tmp_path / "images").mkdir()
    for name in (NAME, "COCO_val2014_000000000285.png"):
        Image.fromarray(np.zeros(explanation.mask.shape, np.uint8)).save(tmp_path / "images" / name)
    read = {
        Path(item.id).name: item.annotations for item in datumaro.Dataset.import_from(str(tmp_path), "cvat")
    }
    (mask,) = read[Path(NAME).stem]
    np.testing.assert_array_equal(np.asarray(mask.image).astype(bool), explanation.mask)
    assert len(read) == 2


def test_a_file_that_was_edited_in_labelme_stays(run: Path, tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    (path, *_) = export_run(run, ["labelme"], tmp_path)
    export_run(run, ["labelme"], tmp_path)  # as it was written
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"version": "5.5.0"}))
    with pytest.raises(vig.UserError, match="got it edited"):
        export_run(run, ["labelme"], tmp_path)
    remove_exports(tmp_path, of_run=True)
    assert [*tmp_path.rglob("*.json")] == [path]


def test_yolo_has_polygons_and_boxes_and_validates_on_other_photos(
    explanation: vig.Explanation, run: Path, tmp_path: Path
) -> None:
    pytest.importorskip("cv2")
    export_run(run, ["yolo"], tmp_path)
    first, second = Path(NAME).stem, "COCO_val2014_000000000285"
    height, width = explanation.mask.shape
    for kind in ("boxes", "segments"):
        folder = tmp_path / "yolo" / kind
        assert (
            (folder / "data.yaml")
            .read_text()
            .endswith("train: images/train\nval: images/val\nnames:\n  0: teapot\n")
        )
        assert (folder / f"labels/val/{second}.txt").read_text() == ""
        (line,) = (folder / f"labels/train/{first}.txt").read_text().splitlines()
        number, *values = map(float, line.split())
        assert number == 0
        if kind == "boxes":
            x, y, across, down = np.array(values) * [width, height, width, height]
            np.testing.assert_allclose(
                [x - across / 2, y - down / 2, across, down], explanation.box, atol=1e-3
            )
        else:
            outline = tuple(map(tuple, (np.reshape(values, (-1, 2)) * [width, height]).tolist()))
            assert overlap(fill_polygon(outline, width, height), explanation.mask) > 0.99


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


def test_blenders_panorama_has_the_light_that_falls_on_the_turned_object(
    explanation: vig.Explanation, tmp_path: Path
) -> None:
    """Its middle column is +X, columns go clockwise, rows up; the object is turned by minus the azimuth."""
    folder = explanation.export(tmp_path, ["blender"], NAME) / "blender"
    assert sorted(path.name for path in folder.iterdir()) == sorted(path[8:] for path in blender.FILES)
    compile((folder / "scene.py").read_text(), "scene.py", "exec")
    radiance, turn = (
        np.load(folder / "light.npy"),
        Rotation.from_euler("z", explanation.azimuth_deg, degrees=True),
    )
    for row, column, place in (
        (16, 32, (1, 0, 0)),
        (16, 16, (0, 1, 0)),
        (16, 48, (0, -1, 0)),
        (31, 0, (0, 0, 1)),
    ):
        expected = sh_basis(turn.apply(place)) @ explanation.latents.light[0]
        assert radiance[row, column, :3] == pytest.approx(max(expected, 0.0), abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("focal", [None, (300.0, 310.0, 90.0, 70.0)])
def test_blenders_render_lies_on_the_object(focal: tuple | None, tmp_path: Path) -> None:
    try:
        python = find_python()
    except vig.UserError as error:
        pytest.skip(str(error))
    explanation = vig.Explainer("teapot").explain(example_photos()[1].photo, K=focal)
    folder = explanation.export(tmp_path, ["blender"], NAME) / "blender"
    (tmp_path / "render.py").write_text(
        f"import runpy\nscene = runpy.run_path({str(folder / 'scene.py')!r})['scene']\n"
        f"scene.cycles.samples, scene.render.filepath = 16, {str(tmp_path / 'render.png')!r}\n"
        "import bpy\nbpy.ops.render.render(write_still=True, scene=scene.name)\n"
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    subprocess.run([python, tmp_path / "render.py"], check=True, env=environment, capture_output=True)
    rendered, own = np.asarray(Image.open(tmp_path / "render.png")), explanation.render()
    covered = rendered[..., 3] > 127
    assert overlap(covered, own[..., 3] > 0.5) > 0.99 and overlap(covered, explanation.amodal) > 0.97
    colours = linear_from_srgb(rendered[covered & explanation.mask][:, :3] / 255)
    np.testing.assert_allclose(
        colours.mean(0), explanation.photo[covered & explanation.mask].mean(0), rtol=0.1
    )


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
