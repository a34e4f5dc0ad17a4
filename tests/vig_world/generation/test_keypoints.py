"""Keypoints, and the exports that hold them, read back by other readers than vig's."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pycocotools.coco import COCO

from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.assets.target import target_vertices
from vig_world.dataset import Dataset, read_dataset
from vig_world.generation.coco import export_coco_keypoints
from vig_world.generation.keypoints import EDGES, HIDDEN, SEEN, keypoints, mirror_order, names_of, points_of
from vig_world.generation.write import make_dataset
from vig_world.generation.yolo import export_yolo_pose

NAMED = 3  # spout, handle, knob


@pytest.fixture(scope="module")
def teapot(packaged: ObjectClass) -> ObjectClass:
    """The packaged class, which names points."""
    return packaged


@pytest.fixture(scope="module")
def wide(tmp_path_factory: pytest.TempPathFactory, teapot: ObjectClass) -> Path:
    out = tmp_path_factory.mktemp("wide") / "d"
    make_dataset(out, 8, 5, workers=1, progress=False, object_class=teapot, size=(320, 240))
    return make_dataset(
        out, 2, 5, workers=1, progress=False, object_class=teapot, size=(320, 240), split="validation"
    )


@pytest.fixture(scope="module")
def photos(wide: Path) -> Dataset:
    return read_dataset(wide)


def test_points_are_the_named_vertices_and_the_box(packaged: ObjectClass) -> None:
    mean = packaged.shape_model.mean
    points = points_of(packaged, mean)
    named = dict(zip(names_of(packaged), points, strict=True))
    np.testing.assert_allclose(named["spout"], mean[packaged.points["spout"]])
    np.testing.assert_allclose(named["corner_101"], [mean[:, 0].max(), mean[:, 1].min(), mean[:, 2].max()])
    np.testing.assert_allclose(named["centre"], (mean.min(0) + mean.max(0)) / 2)
    corners = points[NAMED : NAMED + 8]
    sides = np.array([np.abs(corners[i] - corners[j]) for i, j in EDGES])
    assert len(EDGES) == 12 and ((sides > 1e-6).sum(1) == 1).all()


def test_a_mirror_image_swaps_left_and_right(packaged: ObjectClass) -> None:
    flipped = mirror_order(packaged)
    names = names_of(packaged)
    assert flipped is not None
    pairs = {names[i]: names[j] for i, j in enumerate(flipped)}
    assert pairs["spout"] == "spout" and pairs["centre"] == "centre"
    assert pairs["corner_000"] == "corner_010" and pairs["corner_111"] == "corner_101"
    assert mirror_order(replace(packaged, mirror=False)) is None


def test_places_are_projections(photos: Dataset, wide: Path, teapot: ObjectClass) -> None:
    """By BOP's numbers in the files, millimetres and K."""
    scene = wide / "train/000000"
    poses = json.loads((scene / "scene_gt.json").read_text())
    cameras = json.loads((scene / "scene_camera.json").read_text())
    for index, located in enumerate(keypoints(photos, teapot, range(8))):
        points = 1000 * points_of(teapot, target_vertices(photos.specs()[index], teapot))
        truth = poses[str(index)][0]
        inside = points @ np.reshape(truth["cam_R_m2c"], (3, 3)).T + truth["cam_t_m2c"]
        homogeneous = inside @ np.reshape(cameras[str(index)]["cam_K"], (3, 3)).T
        place = homogeneous[:, :2] / homogeneous[:, 2:]
        framed = ((place >= 0) & (place < [320, 240])).all(1)
        np.testing.assert_array_equal(located.seen > 0, framed)
        np.testing.assert_allclose(located.place, place, atol=1e-6)
        rows = np.array(located.rows())
        assert not rows[~framed].any() and (rows[framed, :2] == located.place[framed]).all()


def test_seen_points_lie_on_the_visible_mask(photos: Dataset, teapot: ObjectClass) -> None:
    """A named point that is seen is at most a pixel from the mask; one that props hide is not seen."""
    counts = np.zeros(3, int)
    for mask, alone, located in zip(
        photos.visible, photos.amodal, keypoints(photos, teapot, range(8)), strict=True
    ):
        for (x, y), seen in zip(located.place[:NAMED], located.seen[:NAMED], strict=True):
            counts[seen] += 1
            near = slice(max(int(y) - 1, 0), int(y) + 2), slice(max(int(x) - 1, 0), int(x) + 2)
            if seen == SEEN:
                assert mask[near].any()
            if seen and (alone & ~mask)[near].all():
                assert seen == HIDDEN
    assert counts[SEEN] >= 5 and counts[HIDDEN] >= 5


def test_pycocotools_reads_the_keypoints(
    wide: Path, photos: Dataset, teapot: ObjectClass, tmp_path: Path
) -> None:
    out = export_coco_keypoints(wide, tmp_path / "out", "train", teapot)
    read = COCO(out / "annotations" / "keypoints_train.json")
    (category,) = read.loadCats([1])
    assert tuple(category["keypoints"]) == names_of(teapot)
    assert np.array(category["skeleton"]).min() == NAMED + 1 and len(category["skeleton"]) == 12
    for index, located in enumerate(keypoints(photos, teapot, range(8))):
        (annotation,) = read.loadAnns(read.getAnnIds([index]))
        (image,) = read.loadImgs([index])
        assert (image["width"], image["height"]) == Image.open(out / "images/train" / image["file_name"]).size
        np.testing.assert_array_equal(read.annToMask(annotation), photos.visible[index])
        x, y, seen = np.reshape(annotation["keypoints"], (-1, 3)).T
        np.testing.assert_allclose(np.column_stack([x, y]), np.array(located.rows())[:, :2], atol=0.006)
        np.testing.assert_array_equal(seen, located.seen)
        assert annotation["num_keypoints"] == (seen > 0).sum()


def yaml_of(path: Path) -> dict[str, object]:
    """The little YAML of data.yaml: a key and a value a line, values plain words or JSON."""
    lines = (line.split(" #")[0] for line in path.read_text().splitlines())
    pairs = (line.split(": ", 1) for line in lines)
    return {key: json.loads(text) if text[0] in "[{" else text for key, text in pairs}


def test_ultralytics_format(wide: Path, photos: Dataset, teapot: ObjectClass, tmp_path: Path) -> None:
    """docs.ultralytics.com/datasets/pose: data.yaml; labels beside images, `class cx cy w h (px py v) ...`,
    all within [0, 1], 5 + 3 N columns."""
    out = export_yolo_pose(wide, tmp_path / "out", "train", teapot)
    assert yaml_of(out / "data.yaml")["val"] == "images/train"
    export_yolo_pose(wide, out, "validation", teapot)
    described = yaml_of(out / "data.yaml")
    assert (described["train"], described["val"]) == ("images/train", "images/validation")
    assert described["kpt_shape"] == [NAMED + 9, 3] and described["names"] == [teapot.name]
    assert sorted(described["flip_idx"]) == list(range(NAMED + 9))  # type: ignore[call-overload]
    for image in sorted((out / str(described["train"])).glob("*.png")):
        label = Path(str(image).replace("/images/", "/labels/")).with_suffix(
            ".txt"
        )  # as Ultralytics finds it
        table = np.loadtxt(label, ndmin=2)
        index = int(image.stem)
        assert table.shape == (1, 5 + 3 * (NAMED + 9)) and table.min() >= 0 and table[:, 1:5].max() <= 1
        points = table[0, 5:].reshape(-1, 3)
        assert points[:, :2].max() <= 1 and set(points[:, 2]) <= {0, 1, 2}
        located = next(keypoints(photos, teapot, [index]))
        np.testing.assert_allclose(points[:, :2] * [320, 240], np.array(located.rows())[:, :2], atol=0.001)
        np.testing.assert_array_equal(points[:, 2], located.seen)
        x, y, width, height = table[0, 1:5] * [320, 240, 320, 240]
        rows, columns = np.nonzero(photos.visible[index])
        edges = x - width / 2, x + width / 2, y - height / 2, y + height / 2
        true = columns.min(), columns.max() + 1, rows.min(), rows.max() + 1
        np.testing.assert_allclose(edges, true, atol=0.001)


@pytest.mark.parametrize("export", [export_coco_keypoints, export_yolo_pose])
def test_exports_refuse_what_they_would_spoil(
    export, wide: Path, teapot: ObjectClass, packaged: ObjectClass, tmp_path: Path
) -> None:
    with pytest.raises(UserError, match="another class than this"):
        export(wide, tmp_path / "out", "train", ObjectClass.load("mug"))
    assert not (tmp_path / "out").exists()
    export(wide, tmp_path / "out", "train", teapot)
    with pytest.raises(UserError, match="already holds"):
        export(wide, tmp_path / "out", "train", teapot)


def test_classes_do_not_share_a_folder(wide: Path, teapot: ObjectClass, tmp_path: Path) -> None:
    (tmp_path / "data.yaml").write_text('train: images/train\nnames: ["mug"]\n')
    with pytest.raises(UserError, match="holds one of another class"):
        export_yolo_pose(wide, tmp_path, "train", teapot)
    assert not (tmp_path / "images").exists()
