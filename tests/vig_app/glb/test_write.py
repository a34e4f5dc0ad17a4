"""Files of objects and cameras: what stands in them, and how other libraries read it."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.support import latents
from vig import Camera
from vig.record import glb_from_object
from vig.scene import ObjectClass
from vig_app.glb.files import MAX_SCALED, GlbObject, on_one_ground, write_glb


def write(
    path: Path,
    vertices: np.ndarray,
    colours: np.ndarray,
    object_class: ObjectClass,
    camera: Camera,
    azimuth: float,
    elevation: float,
) -> None:
    """An object as `write_object` places it."""
    node = glb_from_object(azimuth)
    each = GlbObject(object_class.name, object_class, vertices, colours, node)
    write_glb(path, [each], camera, node @ np.linalg.inv(camera.camera_from_world(azimuth, elevation)))


def test_the_object_stands_upright_and_is_seen_from_the_front(teapot: ObjectClass, tmp_path: Path) -> None:
    """Y up, metres; what was towards the eye is towards +Z; positions as stored are in the object's frame."""
    one, model = latents(), teapot.shape_model
    z_up = model.vertices(one.shape)[0]
    colours = np.linspace(0.1, 0.9, 3 * len(model.part_names)).reshape(-1, 3)
    azimuth, elevation = one.azimuth.item(), one.elevation.item()
    camera = Camera(640, 480, 900.0, 300.0, 250.0, distance=0.5, target_height=0.08)
    write(tmp_path / "object.glb", z_up, colours, teapot, camera, azimuth, elevation)
    scene = trimesh.load(tmp_path / "object.glb")
    assert set(scene.geometry) and len(scene.geometry) == len(np.unique(model.parts))
    assert sum(len(mesh.faces) for mesh in scene.geometry.values()) == len(model.faces)
    whole = scene.to_geometry()
    assert whole.bounds[0][1] == pytest.approx(z_up[:, 2].min(), abs=1e-6)  # it stands on y = 0
    assert whole.volume > 0  # outward faces: turned, not mirrored
    # The eye of the photo is in the plane x = 0, before the object and above it.
    eye = (
        glb_from_object(azimuth) @ np.linalg.inv(camera.camera_from_world(azimuth, elevation)) @ [0, 0, 0, 1]
    )
    assert eye[0] == pytest.approx(0, abs=1e-9) and eye[2] > 0.3
    assert eye[1] == pytest.approx(0.08 + 0.5 * math.sin(elevation))
    for mesh in scene.geometry.values():
        (part,) = [n for n, name in enumerate(model.part_names) if name == mesh.visual.material.name]
        found = np.asarray(mesh.visual.material.baseColorFactor) / 255
        np.testing.assert_allclose(found[:3], colours[part], atol=1 / 255)
        assert mesh.visual.material.metallicFactor == 0 and mesh.visual.material.roughnessFactor == 1
        assert (np.einsum("ij,ij->i", mesh.vertex_normals, mesh.vertex_normals) > 0.99).all()


def test_the_cameras_node_sees_the_photo(teapot: ObjectClass, tmp_path: Path) -> None:
    """Through glTF's own camera a vertex comes to lie where K and camera_from_object put it."""
    one = latents()
    vertices = teapot.shape_model.vertices(one.shape)[0]
    camera = Camera(640, 480, 900.0, 300.0, 250.0, distance=0.5, target_height=0.08, roll=0.2)
    azimuth, elevation = one.azimuth.item(), one.elevation.item()
    colours = np.full((len(teapot.shape_model.part_names), 3), 0.5)
    write(tmp_path / "object.glb", vertices, colours, teapot, camera, azimuth, elevation)
    data = (tmp_path / "object.glb").read_bytes()
    described = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    stands, eye = (np.array(node["matrix"]).reshape(4, 4).T for node in described["nodes"])
    perspective = described["cameras"][0]["perspective"]
    homogeneous = np.c_[vertices, np.ones(len(vertices))].T
    seen = np.linalg.inv(eye) @ stands @ homogeneous
    half = math.tan(perspective["yfov"] / 2)
    # Of the frame of glTF, whose middle is the principal point, in pixels of the photo.
    x = 300 + 640 * (340 / 320) / 2 * seen[0] / -seen[2] / half / perspective["aspectRatio"]
    y = 250 - 250 * seen[1] / -seen[2] / half
    put = camera.K @ (camera.camera_from_world(azimuth, elevation) @ homogeneous)[:3]
    np.testing.assert_allclose(np.stack([x, y]), put[:2] / put[2], atol=1e-6)


def looking_down(distance: float, aside: float, degrees: float) -> np.ndarray:
    """camera_from_object (4, 4) of an object at some place before a camera that looks down by an angle."""
    pose = Camera.standard(distance=distance).camera_from_world(0.3, math.radians(degrees))
    pose[0, 3] += aside
    return pose


def test_objects_of_a_scene_stand_on_one_ground_and_the_picture_stays() -> None:
    """At 20 degrees the camera is .4 sin 20 above the first one's foot, .5 sin 20 above the other's."""
    poses = [looking_down(0.4, -0.1, 20), looking_down(0.5, 0.2, 20)]
    scales, world_from_camera = on_one_ground(poses)
    assert scales[0] / scales[1] == pytest.approx(5 / 4)
    assert scales[0] * scales[1] == pytest.approx(1)
    points = np.c_[np.random.default_rng(0).normal(size=(20, 3)) / 10, np.ones(20)].T
    for pose, scale in zip(poses, scales, strict=True):
        node = world_from_camera @ np.diag([scale, scale, scale, 1]) @ pose
        assert node[1, 3] == pytest.approx(0, abs=1e-12), "its foot is on the ground"
        np.testing.assert_allclose(node[:3, 2], [0, scale, 0], atol=1e-12)  # and it stands upright
        seen, before = np.linalg.inv(world_from_camera) @ node @ points, pose @ points
        np.testing.assert_allclose(seen[:2] / seen[2], before[:2] / before[2], atol=1e-9)
    np.testing.assert_allclose(world_from_camera[:3, :3] @ world_from_camera[:3, :3].T, np.eye(3), atol=1e-12)
    assert world_from_camera[1, 3] > 0 and np.linalg.det(world_from_camera) == pytest.approx(1)
    assert (world_from_camera @ [0, 0, 1, 0])[2] < 0, "it looks towards -Z"


def test_what_stands_much_higher_is_not_brought_down() -> None:
    scales, _ = on_one_ground([looking_down(0.4, -0.1, 60), looking_down(2.0, 0.2, 60)])
    assert max(scales) == pytest.approx(MAX_SCALED) and min(scales) == pytest.approx(1 / MAX_SCALED)


@pytest.mark.parametrize("degrees", [90.0, -10.0, 0.0])
def test_a_camera_that_does_not_see_the_ground_aslant_is_placed_all_the_same(degrees: float) -> None:
    scales, world_from_camera = on_one_ground([looking_down(0.4, 0.0, degrees)] * 2)
    np.testing.assert_allclose(scales, 1)
    assert np.isfinite(world_from_camera).all()
