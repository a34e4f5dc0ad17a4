"""Datasets of other sizes than the standard one: the same scenes, with every label in the new frame."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from tests.vig_world.generation.labels import normal_problems, problems_of
from vig.io.errors import UserError
from vig.scene import ObjectClass, srgb8_from_linear
from vig_train.evaluation.fits import frame_images
from vig_train.training.examples import Examples
from vig_world.composition.sampling import sample
from vig_world.dataset import Dataset, read_dataset
from vig_world.dataset.format import image_paths
from vig_world.generation.check import check_dataset
from vig_world.generation.describe import normal_units
from vig_world.generation.write import make_dataset
from vig_world.library import Library
from vig_world.raster.view import View
from vig_world.renderers.rasterized import render, with_surroundings

COUNT, SEED = 4, 5  # the scenes of the fixture `made`
SIZES = [(240, 180), (120, 200)]


@pytest.fixture(scope="module", params=SIZES, ids=["wide", "tall"])
def other(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, teapot: ObjectClass
) -> Path:
    out = tmp_path_factory.mktemp("size") / "d"
    return make_dataset(
        out, COUNT, SEED, workers=1, progress=False, object_class=teapot, size=request.param, normals=True
    )


def cameras(root: Path) -> list[dict]:
    return list(json.loads((root / "train/000000/scene_camera.json").read_text()).values())


def test_scenes_are_those_of_the_standard_size(other: Path, dataset: Dataset) -> None:
    assert read_dataset(other).specs() == dataset.specs()[:COUNT]


def test_the_standard_picture_is_the_square_in_the_middle(other: Path, made: Path) -> None:
    """The shorter side has the standard field of view; the pose is the same, the middle the middle."""
    width, height = read_dataset(other).size
    scale = min(width, height) / 150
    for wide, square in zip(cameras(other), cameras(made), strict=False):
        expected = scale * np.array(square["cam_K"])
        expected[[2, 5]] += (width - min(width, height)) / 2, (height - min(width, height)) / 2
        expected[8] = 1
        np.testing.assert_allclose(wide["cam_K"], expected, atol=1e-9)
        for name in ("cam_R_w2c", "cam_t_w2c"):
            assert wide[name] == square[name]
    described = json.loads((other / "camera.json").read_text())
    assert (described["width"], described["height"]) == (width, height)
    assert (described["cx"], described["cy"]) == (width / 2, height / 2)
    assert described["fx"] == pytest.approx(1.12 * min(width, height))


def test_every_label_is_right_and_renders_again(other: Path, teapot: ObjectClass) -> None:
    found = check_dataset(other, render=2, object_class=teapot)
    assert found.problems == () and found.files == 5 * COUNT + 5
    assert problems_of(other, teapot) == []


def test_pictures_have_the_size(other: Path) -> None:
    dataset = read_dataset(other)
    shape = (COUNT, *dataset.size[::-1])
    assert dataset.images.shape == (*shape, 3) and dataset.read("normal").shape == (*shape, 3)
    assert dataset.amodal.shape == dataset.visible.shape == dataset.read("depth").shape == shape


def test_what_the_middle_shows_is_the_standard_picture(other: Path, dataset: Dataset) -> None:
    """Other pixels sample other points: edges differ, which are few."""
    cut = read_dataset(other).at_network_size()
    assert cut.images.shape == (COUNT, 150, 150, 3)
    difference = np.abs(cut.images.astype(int) - dataset.images[:COUNT]).mean()
    assert difference < 4  # 2.0 and 2.8 of 255
    for kind in ("mask", "mask_visib"):
        one, two = cut.read(kind), dataset.read(kind, range(COUNT))
        assert (one != two).sum() <= 0.045 * two.sum()  # 0.035 and 0.036, some of the outline
        middles = [np.argwhere(masks)[:, 1:].mean(0) for masks in (one, two)]
        np.testing.assert_allclose(*middles, atol=0.15)
    np.testing.assert_allclose(cut.occlusion, dataset.occlusion[:COUNT], atol=0.02)
    assert dataset.at_network_size() is dataset and cut.at_network_size() is cut


def test_networks_train_and_are_evaluated_on_the_middle(other: Path) -> None:
    dataset = read_dataset(other)
    examples = Examples.of(dataset)
    assert examples.images.shape == (COUNT, 150, 150, 3) and examples.visible.shape == (COUNT, 150, 150)
    plain = Dataset(**{**vars(dataset), "world": "paper"})
    images, visible = frame_images(plain, None)  # type: ignore[arg-type]
    np.testing.assert_array_equal(images, examples.images.numpy())
    np.testing.assert_array_equal(visible, examples.visible.numpy() > 127)


def test_beyond_the_room_lies_the_panorama(teapot: ObjectClass) -> None:
    """Where depth is unknown, by a look-up of one direction after the other; elsewhere nothing changes."""
    library = Library("train")
    spec = sample(library, teapot, SEED, 1)
    view = View.of_scene(spec, teapot, (96, 64))
    picture = render(library, spec, teapot, view)
    depth = picture.depth.copy()
    depth[:20, 70:] = np.inf
    shown = with_surroundings(replace(picture, depth=depth), library, spec, view).image
    changed = (shown != picture.image).any(-1)
    assert not changed[np.isfinite(depth)].any() and changed[~np.isfinite(depth)].mean() > 0.9
    radiance, camera = library.radiance(spec.panorama), view.camera
    for row, column in ((0, 70), (19, 95), (7, 81)):
        inside = np.array([column + 0.5 - camera.cx, row + 0.5 - camera.cy, camera.focal])
        x, y, z = view.rotation.T @ inside / np.linalg.norm(inside)
        expected = library.ground_albedo(spec.room) * radiance[: len(radiance) // 2].mean((0, 1))
        if z >= 0:
            down = math.acos(z) / math.pi * len(radiance)
            along = (math.atan2(y, x) - spec.panorama_angle) / (2 * math.pi) % 1 * radiance.shape[1]
            expected = radiance[int(down), int(along)]
        np.testing.assert_allclose(shown[row, column], srgb8_from_linear(expected), atol=1)


def test_normals_are_those_of_the_depth_image(other: Path) -> None:
    """Against cross products of neighbours in space, where depth is smooth: most agree, as faces are flat
    and normals are interpolated between vertices; all have unit length.
    """
    dataset = read_dataset(other)
    depth, normals = dataset.read("depth"), dataset.read("normal")
    angles = []
    for z, normal, described in zip(depth, normals, cameras(other), strict=True):
        known = np.isfinite(z)
        np.testing.assert_array_equal(known, normal.any(-1))
        assert np.abs(np.linalg.norm(normal[known], axis=1) - 1).max() < 0.01
        K = np.array(described["cam_K"]).reshape(3, 3)
        rows, columns = np.mgrid[: z.shape[0], : z.shape[1]] + 0.5
        points = np.stack([(columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1], 0 * rows + 1], -1)
        points = points * np.where(known, z, 1)[..., None]
        along, down = points[1:-1, 2:] - points[1:-1, :-2], points[2:, 1:-1] - points[:-2, 1:-1]
        across = np.cross(down, along)
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        z = np.where(known, z, 0)
        inner = z[1:-1, 1:-1]
        curved = np.abs(z[1:-1, 2:] + z[1:-1, :-2] - 2 * inner) + np.abs(
            z[2:, 1:-1] + z[:-2, 1:-1] - 2 * inner
        )
        smooth = known[1:-1, 1:-1] & (curved < 0.001 * inner)
        cosine = (across * normal[1:-1, 1:-1]).sum(-1)[smooth]
        angles.append(np.degrees(np.arccos(cosine.clip(-1, 1))))
    angle = np.concatenate(angles)
    assert len(angle) > 20_000 and np.median(angle) < 3 and (angle < 20).mean() > 0.9


def test_normals_that_cannot_be_are_found(other: Path, teapot: ObjectClass) -> None:
    dataset = read_dataset(other)
    view = View.of_scene(dataset.specs()[1], teapot, dataset.size)
    path = image_paths(dataset.folder, 1, normals=True)
    normal, depth = (np.asarray(Image.open(path[kind])) for kind in ("normal", "depth"))
    assert list(normal_problems(normal, depth, view)) == []
    for damaged, expected in (
        (np.where(normal > 0, 255 - normal, 0), "too many are turned away from the camera"),
        (normal // 2, "some are not of unit length"),
        (np.zeros_like(normal), "it is not known where depth is"),
    ):
        assert f"normal: {expected}" in list(normal_problems(damaged, depth, view))


def test_opencv_reads_depth_and_normals(other: Path) -> None:
    """16 bits, in millimetres by the scale of the metadata; normals in the order of the file's channels."""
    dataset = read_dataset(other)
    scale = cameras(other)[2]["depth_scale"]
    path = image_paths(dataset.folder, 2, normals=True)
    depth = cv2.imread(str(path["depth"]), cv2.IMREAD_UNCHANGED)
    metres = dataset.read("depth", [2])[0]
    assert depth.dtype == np.uint16
    np.testing.assert_allclose(depth[depth > 0] * scale / 1000, metres[depth > 0], rtol=1e-6)
    blue_first = cv2.imread(str(path["normal"]), cv2.IMREAD_UNCHANGED)
    read = blue_first[..., ::-1] / 127.5 - 1
    np.testing.assert_allclose(read[depth > 0], dataset.read("normal", [2])[0][depth > 0], atol=1e-6)


def test_normals_are_stored_to_less_than_half_a_degree() -> None:
    normals = np.random.default_rng(0).normal(size=(100, 100, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals[0, 0] = 0
    units = normal_units(normals)
    read = units / 127.5 - 1
    cosine = (read * normals).sum(-1) / np.linalg.norm(read, axis=-1)
    assert not units[0, 0].any()
    assert np.degrees(np.arccos(np.delete(cosine.ravel(), 0).clip(-1, 1))).max() < 0.4


def test_datasets_of_before_are_of_the_standard_size(made: Path, tmp_path: Path, teapot: ObjectClass) -> None:
    copy = shutil.copytree(made, tmp_path / "d")
    info = json.loads((copy / "info.json").read_text())
    del info["splits"]["train"]["size"], info["splits"]["train"]["normals"]
    (copy / "info.json").write_text(json.dumps(info))
    assert read_dataset(copy).size == (150, 150) and not read_dataset(copy).normals
    assert check_dataset(copy, render=1, object_class=teapot).clean
    make_dataset(copy, 10, SEED, workers=1, progress=False, object_class=teapot)  # complete: nothing to make


@pytest.mark.parametrize("size", [(0, 0), (10, 10), (99_999, 1), (640, 159), (5000, 4000)])
def test_other_sizes_are_refused(size: tuple[int, int], tmp_path: Path) -> None:
    with pytest.raises(UserError, match=rf"expected a size of 32 to 4096 .*; got {size[0]}x{size[1]}\."):
        make_dataset(tmp_path / "d", 1, 0, size=size)
    assert not (tmp_path / "d").exists()


def test_splits_of_a_dataset_have_one_size(made: Path, tmp_path: Path, teapot: ObjectClass) -> None:
    copy = shutil.copytree(made, tmp_path / "d")
    with pytest.raises(UserError, match=r"already holds a train split with size \[150, 150\]"):
        make_dataset(copy, 1, 0, split="test", object_class=teapot, size=(64, 48), workers=1)


def test_pictures_of_another_size_than_stated_are_damaged(made: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(made, tmp_path / "d")
    path = copy / "train/000000/rgb/000002.png"
    Image.open(path).resize((151, 150)).save(path)
    with pytest.raises(UserError, match="151 x 150 RGB, not 150 x 150 RGB"):
        read_dataset(copy).read("rgb", [2])
    with pytest.raises(UserError, match="got nothing of that name"):
        read_dataset(copy).read("normal", [2])
