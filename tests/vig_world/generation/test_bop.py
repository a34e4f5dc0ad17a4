"""What each field of the BOP files means, found again without the code that wrote it."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial.distance import pdist

from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.dataset import Dataset, read_dataset
from vig_world.generation.bop import localisation_targets, visibility
from vig_world.generation.describe import depth_units

COUNT = 10  # of the fixture `made`


@pytest.fixture(scope="module")
def scene(made: Path) -> dict[str, dict]:
    names = ("scene_gt", "scene_gt_info", "scene_camera")
    folder = made / "train" / "000000"
    return {name: json.loads((folder / f"{name}.json").read_text()) for name in names}


def picture(made: Path, kind: str, number: int) -> np.ndarray:
    suffix = "_000000" if kind.startswith("mask") else ""
    return np.asarray(Image.open(made / "train" / "000000" / kind / f"{number:06d}{suffix}.png"))


def projected(scene: dict[str, dict], key: str, dataset: Dataset, teapot: ObjectClass) -> np.ndarray:
    """Pixel coordinates and depth in mm (V, 3) of the sample's own mesh, by the BOP files."""
    shape = np.array(dataset.latents[int(key), :10], np.float32)[None]
    model = 1000 * teapot.shape_model.vertices(shape)[0].astype(np.float64)
    (truth,) = scene["scene_gt"][key]
    rotation, translation = np.array(truth["cam_R_m2c"]).reshape(3, 3), np.array(truth["cam_t_m2c"])
    matrix = np.array(scene["scene_camera"][key]["cam_K"]).reshape(3, 3)
    points = (model @ rotation.T + translation) @ matrix.T
    return np.column_stack([points[:, :2] / points[:, 2:], points[:, 2]])


def test_every_image_has_its_entry_under_its_number(scene: dict[str, dict]) -> None:
    assert all(list(entries) == [str(i) for i in range(COUNT)] for entries in scene.values())


def test_pose_and_camera_project_the_samples_mesh_onto_its_silhouette(
    scene: dict[str, dict], dataset: Dataset, teapot: ObjectClass, made: Path
) -> None:
    """The mesh's extreme points, projected by the files alone, are the silhouette's box to within a pixel."""
    for key, (truth,) in scene["scene_gt"].items():
        (info,) = scene["scene_gt_info"][key]
        x, y, _ = projected(scene, key, dataset, teapot).T
        left, top, width, height = info["bbox_obj"]
        found = [left, top, left + width + 1, top + height + 1]  # of whole pixels
        np.testing.assert_allclose([x.min(), y.min(), x.max(), y.max()], found, atol=1.01)
        assert truth["obj_id"] == 1
        camera = scene["scene_camera"][key]
        assert (camera["cam_R_w2c"], camera["cam_t_w2c"]) == (truth["cam_R_m2c"], truth["cam_t_m2c"])


def test_depth_is_along_the_optical_axis_in_units_of_the_scale(
    scene: dict[str, dict], dataset: Dataset, teapot: ObjectClass, made: Path
) -> None:
    for key in scene["scene_gt"]:
        z = projected(scene, key, dataset, teapot)[:, 2]
        depth, seen = picture(made, "depth", int(key)), picture(made, "mask_visib", int(key)) > 0
        assert depth.dtype == np.uint16
        millimetres = depth[seen] * scene["scene_camera"][key]["depth_scale"]
        within = (millimetres > z.min() - 0.1) & (millimetres < z.max() + 0.1)
        assert within.mean() > 0.85  # a pixel at an edge has the depth of what hides the object


@pytest.mark.parametrize(
    ("farthest", "scale"), [(6.5534, 0.1), (6.5535, 0.2), (13.2, 0.5), (40.0, 1.0), (70.0, 1.0)]
)
def test_a_depth_image_has_the_finest_scale_that_holds_it(farthest: float, scale: float) -> None:
    """In units of .1 mm 65,534 is the last; what is beyond those of 1 mm is told from all that is nearer."""
    units, found = depth_units(np.array([[1.5, np.inf, farthest]]))
    assert found == scale and units.dtype == np.uint16
    assert units.tolist() == [[round(1500 / scale), 0, min(round(1000 * farthest / scale), 65535)]]


def test_depth_is_read_by_the_scale_of_its_image(made: Path, tmp_path: Path) -> None:
    root = Path(shutil.copytree(made, tmp_path / "d"))
    path = root / "train" / "000000" / "scene_camera.json"
    cameras = json.loads(path.read_text())
    before = read_dataset(root).read("depth", [2, 0])
    cameras["2"]["depth_scale"] *= 2
    path.write_text(json.dumps(cameras))
    np.testing.assert_array_equal(read_dataset(root).read("depth", [2, 0]), before * [[[2]], [[1]]])
    cameras["2"]["depth_scale"] = 0
    path.write_text(json.dumps(cameras))
    with pytest.raises(UserError, match="expected the cameras of a dataset at .*not above 0"):
        read_dataset(root).read("depth", [0])


def test_counts_are_those_of_the_masks_and_the_whole_silhouette(
    scene: dict[str, dict], made: Path, dataset: Dataset
) -> None:
    for key, (info,) in scene["scene_gt_info"].items():
        alone, seen = (picture(made, kind, int(key)) for kind in ("mask", "mask_visib"))
        assert set(np.unique(alone)) == {0, 255} and set(np.unique(seen)) <= {0, 255}
        assert not ((seen > 0) & (alone == 0)).any()
        assert info["px_count_visib"] == (seen > 0).sum()
        assert info["px_count_valid"] == (picture(made, "depth", int(key))[alone > 0] > 0).sum()
        assert info["px_count_all"] >= (alone > 0).sum() > 500
        if not dataset.truncated[int(key)]:
            assert info["px_count_all"] == (alone > 0).sum()
        assert info["visib_fract"] == pytest.approx(info["px_count_visib"] / info["px_count_all"])


def test_a_truncated_object_is_counted_on_the_canvas() -> None:
    """A silhouette of 4 x 6 pixels, half of it left of a 10 x 10 frame, a quarter of the rest hidden."""
    canvas = np.zeros((30, 30), bool)
    canvas[12:16, 7:13] = True
    amodal = canvas[10:20, 10:20]
    visible = amodal.copy()
    visible[2, :3] = False
    depth = np.where(visible, 4000, 0)
    depth[2, 0] = 3000  # a hider that the depth image knows
    assert visibility(canvas, amodal, visible, depth) == {
        "bbox_obj": [-3, 2, 5, 3],
        "bbox_visib": [0, 3, 2, 2],
        "px_count_all": 24,
        "px_count_valid": 10,
        "px_count_visib": 9,
        "visib_fract": 9 / 24,
    }


def test_of_an_object_that_is_not_seen_there_are_no_boxes() -> None:
    canvas = np.ones((9, 9), bool)
    info = visibility(canvas, np.ones((3, 3), bool), np.zeros((3, 3), bool), np.zeros((3, 3)))
    assert info["bbox_obj"] == info["bbox_visib"] == [-1, -1, -1, -1]
    assert info["visib_fract"] == 0


def test_the_model_is_the_mean_shape_in_millimetres(made: Path, teapot: ObjectClass) -> None:
    mesh = trimesh.load(made / "models" / "obj_000001.ply", process=False)
    np.testing.assert_allclose(mesh.vertices, 1000 * teapot.shape_model.mean, atol=1e-3)
    np.testing.assert_array_equal(mesh.faces, teapot.shape_model.faces)
    assert (mesh.vertex_normals[mesh.vertices[:, 2].argmax()] @ [0, 0, 1]) > 0.9  # outwards: up, at the top
    (info,) = json.loads((made / "models" / "models_info.json").read_text()).values()
    np.testing.assert_allclose([info[f"min_{a}"] for a in "xyz"], mesh.bounds[0], atol=1e-3)
    np.testing.assert_allclose([info[f"size_{a}"] for a in "xyz"], np.ptp(mesh.bounds, axis=0), atol=1e-3)
    assert info["diameter"] == pytest.approx(pdist(mesh.vertices).max(), abs=1e-3)


def test_camera_json_is_the_standard_camera_and_each_image_has_its_own(
    made: Path, scene: dict[str, dict], dataset: Dataset
) -> None:
    camera = json.loads((made / "camera.json").read_text())
    matrix = np.array([camera["fx"], 0, camera["cx"], 0, camera["fy"], camera["cy"], 0, 0, 1])
    for each, spec in zip(scene["scene_camera"].values(), dataset.specs(), strict=True):
        longer, size = spec.lens.farther * spec.lens.scale, camera["width"]
        own = matrix * [longer, 1, 1, 1, longer, 1, 1, 1, 1]
        own[[2, 5]] += np.array(spec.lens.shift) * size
        assert each["cam_K"] == pytest.approx(own.tolist())
    for key, each in scene["scene_camera"].items():
        units = picture(made, "depth", int(key)).max() * each["depth_scale"] / camera["depth_scale"]
        assert (each["depth_scale"] == camera["depth_scale"]) == (units < 65535), "the finest that holds it"
    assert (camera["width"], camera["height"]) == picture(made, "rgb", 0).shape[1::-1]


def test_targets_are_the_images_with_a_tenth_of_the_object_visible() -> None:
    infos = [{"visib_fract": share} for share in (0.5, 0.09, 0.1)]
    assert localisation_targets(infos) == [
        {"im_id": 0, "inst_count": 1, "obj_id": 1, "scene_id": 0},
        {"im_id": 2, "inst_count": 1, "obj_id": 1, "scene_id": 0},
    ]
