"""Explanations in the formats of other tools, read as those tools do."""

import io
import json
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import vig
from vig.inference.presence import judge_presence
from vig.io.errors import UserError
from vig_app.examples import example_photos
from vig_app.exports import FORMATS, formats_in, remove_exports


@pytest.fixture(scope="module")
def explanation() -> vig.Explanation:
    example = example_photos()[1]
    return vig.Explainer("teapot").explain(example.photo, focal=400.0)


@pytest.fixture(scope="module")
def folder(explanation: vig.Explanation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("pxr")
    return explanation.export(explanation.save(tmp_path_factory.mktemp("out")), FORMATS, "02_egg_cup.png")


def read_json(path: Path) -> dict:
    content: dict = json.loads(path.read_text())
    return content


def projected(k: np.ndarray, pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    projection = k @ (pose[:3, :3] @ points.T + pose[:3, 3:])
    return (projection[:2] / projection[2]).T


def test_a_positions_deviations_are_across_the_ray_and_along_it(explanation: vig.Explanation) -> None:
    """Of what the calibration adds: 2 % and 3 % of the length across the ray to the object, 5 % of the
    distance along it, or as much as the distance where the focal length is a guess.
    """
    without = replace(explanation, fit=replace(explanation.fit, position_deviation=np.zeros(3, np.float32)))
    widened = np.array([0.02, 0.03, 0.05], np.float32)
    wide = replace(explanation, fit=replace(explanation.fit, position_deviation=widened))
    guessed = replace(wide, focal_from="assumed")
    length = np.ptp(explanation.vertices, axis=0).max()
    for explained, depth in ((wide, 0.05), (guessed, 1.0)):
        _, pose, covariance = explained.pinhole_pose()
        added = covariance - without.pinhole_pose()[2]
        distance, ray = np.linalg.norm(pose[:3, 3]), pose[:3, 3] / np.linalg.norm(pose[:3, 3])
        assert ray @ added[:3, :3] @ ray == pytest.approx((depth * distance) ** 2, rel=1e-6)
        deviations = np.sqrt(np.linalg.eigvalsh(added[:3, :3]))
        assert deviations == pytest.approx([0.02 * length, 0.03 * length, depth * distance], rel=1e-3)
        side = np.cross(pose[:3, 2], ray)  # level with the object, across the ray
        side /= np.linalg.norm(side)
        assert side @ added[:3, :3] @ side == pytest.approx((0.02 * length) ** 2, rel=1e-3)
        assert not added[3:].any()
    assert wide.distance_known and not guessed.distance_known
    assert not guessed.to_dict()["pinhole"]["distance_known"]


def test_bops_model_pose_and_camera_put_the_object_on_the_photo(
    folder: Path, explanation: vig.Explanation
) -> None:
    (truth,) = read_json(folder / "bop/scene_gt.json")["0"]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.reshape(truth["cam_R_m2c"], (3, 3)), truth["cam_t_m2c"]
    k = np.reshape(read_json(folder / "bop/scene_camera.json")["0"]["cam_K"], (3, 3))
    model = trimesh.load(folder / "bop/models/obj_000001.ply", process=False)
    expected = projected(explanation.camera.K, explanation.camera_from_object, explanation.vertices)
    np.testing.assert_allclose(projected(k, pose, np.asarray(model.vertices)), expected, atol=1e-2)
    (info,) = read_json(folder / "bop/scene_gt_info.json")["0"]
    x, y, width, height = explanation.box or ()
    assert info["bbox_obj"] == [x, y, width - 1, height - 1]  # last minus first pixel, as the toolkit has it
    assert info["visib_fract"] == pytest.approx(1 - explanation.hidden_fraction)


def test_named_points_are_on_the_photo_and_say_whether_they_are_seen(explanation: vig.Explanation) -> None:
    """The camera is before the spout: it is seen, the handle behind the pot is not."""
    seen = {name: bool(flag) for name, (_, _, flag) in explanation.points.items()}
    assert seen["spout"] and not seen["handle"]
    numbers = [explanation.object_class.points[name] for name in explanation.points]
    places = projected(explanation.camera.K, explanation.camera_from_object, explanation.vertices[numbers])
    np.testing.assert_allclose([at[:2] for at in explanation.points.values()], places, atol=0.01)
    x, y = map(int, explanation.points["spout"][:2])
    assert explanation.mask[y - 2 : y + 3, x - 2 : x + 3].any()
    low, high = explanation.to_dict()["bounds"]
    assert np.array_equal([low, high], [explanation.vertices.min(0), explanation.vertices.max(0)])


def test_cocos_run_lengths_are_the_masks(folder: Path, explanation: vig.Explanation) -> None:
    described = read_json(folder / "coco.json")
    (annotation,) = described["annotations"]
    for name, mask in (("segmentation", explanation.amodal), ("visible_segmentation", explanation.mask)):
        counts, size = annotation[name]["counts"], annotation[name]["size"]
        flat = np.repeat(np.arange(len(counts)) % 2, counts).astype(bool)
        assert np.array_equal(flat.reshape(size, order="F"), mask)
    assert described["images"][0]["file_name"] == "02_egg_cup.png"


def test_nerfstudios_camera_is_that_of_the_photo(folder: Path, explanation: vig.Explanation) -> None:
    described = read_json(folder / "transforms.json")
    fx, fy, cx, cy = (described[name] for name in ("fl_x", "fl_y", "cx", "cy"))
    k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    pose = np.linalg.inv(np.array(described["frames"][0]["transform_matrix"]) @ np.diag([1, -1, -1, 1]))
    expected = projected(explanation.camera.K, explanation.camera_from_object, explanation.vertices)
    np.testing.assert_allclose(projected(k, pose, explanation.vertices), expected, atol=1e-6)
    assert (folder / described["frames"][0]["mask_path"]).is_file()


def test_a_robots_camera_sees_the_object_where_it_is(folder: Path, explanation: vig.Explanation) -> None:
    """With the true focal length and the principal point in the middle: within a few pixels of the fit's."""
    estimate, info = read_json(folder / "pose.yaml"), read_json(folder / "camera_info.yaml")
    from scipy.spatial.transform import Rotation

    place, turned = (estimate["pose"]["pose"][name] for name in ("position", "orientation"))
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([turned[axis] for axis in "xyzw"]).as_matrix()
    pose[:3, 3] = [place[axis] for axis in "xyz"]
    k = np.reshape(info["k"], (3, 3))
    assert k[0, 0] == pytest.approx(400) and tuple(k[:2, 2]) == (75, 75)
    pixels = projected(k, pose, explanation.vertices)
    expected = projected(explanation.camera.K, explanation.camera_from_object, explanation.vertices)
    assert np.abs(pixels - expected).max() < 4 and np.abs((pixels - expected).mean(0)).max() < 1
    covariance = np.reshape(estimate["pose"]["covariance"], (6, 6))
    np.testing.assert_allclose(covariance, covariance.T)
    assert (np.linalg.eigvalsh(covariance) > -1e-12).all() and covariance.any()


def test_a_covariance_is_that_of_many_poses_drawn(explanation: vig.Explanation) -> None:
    """Latents drawn from their deviations, small ones: the spread of the positions is the covariance's."""
    fit, rng = explanation.fit, np.random.default_rng(0)
    layout = vig.scene.latent_layout(explanation.object_class.shape_model.modes)
    deviation = np.zeros_like(fit.deviation)
    deviation[layout.indices("azimuth", "elevation")] = 0.02, 0.01
    framing = np.array([0.005, 0.003, 0.01, 0.02], np.float32)
    still = np.zeros(3, np.float32)
    narrow = replace(
        explanation,
        fit=replace(fit, deviation=deviation, framing_deviation=framing, position_deviation=still),
    )
    _, pose, covariance = narrow.pinhole_pose()
    places = []
    for _ in range(800):
        step = rng.standard_normal(6).astype(np.float32)
        latents = replace(
            fit.latents,
            azimuth=fit.latents.azimuth + 0.02 * step[0],
            elevation=fit.latents.elevation + 0.01 * step[1],
        )
        moved = replace(fit, latents=latents, framing=fit.framing + framing * step[2:])
        places.append(replace(explanation, fit=moved).pinhole_pose()[1][:3, 3])
    spread = np.cov(np.array(places).T)
    np.testing.assert_allclose(np.sqrt(np.diag(spread)), np.sqrt(np.diag(covariance)[:3]), rtol=0.1)


def test_usd_has_parts_materials_and_the_camera(folder: Path, explanation: vig.Explanation) -> None:
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(folder / "object.usdc"))
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 1
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert [mesh.GetPrim().GetName() for mesh in meshes] == ["body", "lid", "knob", "foot", "spout", "handle"]
    points = np.concatenate([np.array(mesh.GetPointsAttr().Get()) for mesh in meshes])
    np.testing.assert_allclose(points.min(0), explanation.vertices.min(0), atol=1e-6)
    assert sum(len(mesh.GetFaceVertexCountsAttr().Get()) for mesh in meshes) == len(
        explanation.object_class.shape_model.faces
    )
    (eye,) = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Camera)]
    camera = UsdGeom.Camera(eye).GetCamera(Usd.TimeCode.Default())
    projection = camera.frustum.ComputeViewMatrix() * camera.frustum.ComputeProjectionMatrix()
    homogeneous = np.c_[explanation.vertices, np.ones(len(explanation.vertices))] @ np.array(projection)
    normalised = homogeneous[:, :2] / homogeneous[:, 3:]
    pixels = (normalised * [1, -1] + 1) / 2 * [explanation.camera.width, explanation.camera.height]
    expected = projected(explanation.camera.K, explanation.camera_from_object, explanation.vertices)
    np.testing.assert_allclose(pixels, expected, atol=0.01)


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_names_the_files_that_it_writes(
    explanation: vig.Explanation, tmp_path: Path, name: str
) -> None:
    if name == "usd":
        pytest.importorskip("pxr")
    explanation.export(tmp_path, [name], "02_egg_cup.png")
    written = {path.relative_to(tmp_path) for path in tmp_path.rglob("*") if path.is_file()}
    patterns = import_module(f"vig_app.exports.formats.{name.replace('-', '_')}").FILES
    assert written and all(any(path.match(pattern) for pattern in patterns) for path in written)
    assert all(any(path.match(each) for path in written) for each in patterns if "*" not in each)
    assert formats_in(tmp_path) == (name,)
    remove_exports(tmp_path)
    assert not list(tmp_path.iterdir())


def test_an_absent_object_has_no_pose_and_what_was_exported_of_it_goes(
    explanation: vig.Explanation, tmp_path: Path
) -> None:
    formats = ("bop", "coco", "nerfstudio")
    explanation.export(tmp_path, formats)
    assert json.loads((tmp_path / "coco.json").read_text())["annotations"]
    absent = replace(explanation, fit=judge_presence(explanation.fit, 0.0, "teapot"))
    absent.export(tmp_path, formats)
    assert [path.name for path in tmp_path.iterdir()] == ["coco.json"]
    assert json.loads((tmp_path / "coco.json").read_text())["annotations"] == []


def test_unknown_formats_are_refused(explanation: vig.Explanation, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="expected a list of formats out of blender, bop, coco"):
        explanation.export(tmp_path, ["obj"])
    with pytest.raises(UserError, match="got 'bop'"):
        explanation.export(tmp_path, "bop")
    assert not list(tmp_path.iterdir())


def test_an_object_of_which_nothing_is_seen_is_no_visible_one(
    explanation: vig.Explanation, tmp_path: Path
) -> None:
    pytest.importorskip("cv2")
    hidden = replace(explanation, others=np.ones_like(explanation.mask))
    hidden.export(tmp_path, ["coco-annotations"])
    visible, amodal = (read_json(tmp_path / f"annotations_{name}.json") for name in ("visible", "amodal"))
    assert visible["annotations"] == [] and visible["categories"] == amodal["categories"]
    (annotation,) = amodal["annotations"]
    assert tuple(annotation["bbox"]) == explanation.box and annotation["id"] == 1


def test_a_gltf_library_reads_the_object(folder: Path, explanation: vig.Explanation) -> None:
    """Counts, bounds and sizes of all accessors hold, faces name vertices, materials and camera are there."""
    pygltflib = pytest.importorskip("pygltflib")
    read = pygltflib.GLTF2().load(str(folder / "object.glb"))
    data, vertices = read.binary_blob(), explanation.vertices
    assert read.buffers[0].byteLength == len(data)
    sizes, kinds = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}, {5125: "<u4", 5126: "<f4"}
    arrays = []
    for accessor in read.accessors:
        view = read.bufferViews[accessor.bufferView]
        count = accessor.count * sizes[accessor.type]
        assert view.byteOffset + view.byteLength <= len(data) and view.byteOffset % 4 == 0
        assert view.byteLength == 4 * count
        array = np.frombuffer(data, kinds[accessor.componentType], count, view.byteOffset)
        arrays.append(array.reshape(accessor.count, -1))
    # Along the seams of the texture vertices are there twice.
    used = vertices[np.unique(explanation.object_class.shape_model.faces)]
    assert {row.tobytes() for row in arrays[0]} == {row.tobytes() for row in used}
    assert read.accessors[0].min == arrays[0].min(0).tolist()
    assert read.accessors[0].max == arrays[0].max(0).tolist()
    np.testing.assert_allclose(np.linalg.norm(arrays[1], axis=1), 1, atol=1e-5)
    (mesh,), faces = read.meshes, 0
    for primitive in mesh.primitives:
        corners = arrays[primitive.indices]
        assert corners.max() < len(arrays[0]) and primitive.material < len(read.materials)
        faces += len(corners) // 3
    assert faces == len(explanation.object_class.shape_model.faces)
    assert [node.camera for node in read.nodes] == [None, 0]
    assert [image.mimeType for image in read.images] == ["image/jpeg", "image/png"]
    for image in read.images:
        view = read.bufferViews[image.bufferView]
        picture = Image.open(io.BytesIO(data[view.byteOffset : view.byteOffset + view.byteLength]))
        assert picture.size == (512, 512)
    coordinates = arrays[mesh.primitives[0].attributes.TEXCOORD_0]
    assert coordinates.min() >= 0 and coordinates.max() <= 1 and len(coordinates) == len(arrays[0])
