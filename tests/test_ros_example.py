"""The ROS 2 node of the examples, with stand-ins for rclpy and the message definitions that rosbags has."""

import dataclasses
import importlib.util
import sys
from collections import defaultdict
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import vig
from vig.photo.images import as_srgb, coded_photo
from vig_app.examples import example_photos

typesys = pytest.importorskip("rosbags.typesys")
STORE = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
FOLDER = Path(__file__).parents[1] / "examples/ros2"
KINDS = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo", "geometry_msgs/msg/PoseWithCovarianceStamped")


def message(name: str) -> SimpleNamespace:
    """A message of that definition with rclpy's defaults."""
    return SimpleNamespace(
        kind=name, **{field: default(*definition) for field, definition in STORE.fielddefs[name][1]}
    )


def default(node: Any, detail: Any) -> Any:
    if node.name == "NAME":
        return message(detail)
    if node.name == "BASE":
        return "" if detail[0] == "string" else 0.0 if "float" in detail[0] else 0
    return [default(*detail[0])] * detail[1] if node.name == "ARRAY" else []


def typed(name: str, given: Any) -> Any:
    """The message as the typestore's class has it, which can be serialised."""
    fields = {}
    for field, (node, detail) in STORE.fielddefs[name][1]:
        value = getattr(given, field)
        if node.name == "NAME":
            value = typed(detail, value)
        elif node.name != "BASE" and detail[0][0].name == "BASE" and detail[0][1][0] != "string":
            data = list(value) if not isinstance(value, bytes) else np.frombuffer(value, np.uint8)
            value = np.array(data, detail[0][1][0])
            assert node.name != "ARRAY" or value.shape == (detail[1],)
        fields[field] = value
    return STORE.types[name](**fields)


class StandInNode:
    """What the node uses of rclpy's: one parameter, publishers that keep what is published."""

    parameters = {"object": "teapot"}

    def __init__(self, name: str) -> None:
        self.name, self.published, self.taken = name, defaultdict[str, list[Any]](list), {}
        self.logged: list[str] = []

    def declare_parameter(self, name: str, value: str) -> Any:
        return SimpleNamespace(value=self.parameters.get(name, value))

    def create_publisher(self, kind: Any, topic: str, depth: int) -> Any:
        return SimpleNamespace(publish=self.published[topic].append)

    def create_subscription(self, kind: Any, topic: str, take: Any, quality: Any) -> None:
        self.taken[topic] = take

    def get_logger(self) -> Any:
        def log(words: str, **_: Any) -> None:
            self.logged.append(words)

        return SimpleNamespace(error=log, warning=log)


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    modules: dict[str, dict[str, Any]] = {
        "rclpy": {},
        "rclpy.node": {"Node": StandInNode},
        "rclpy.qos": {"qos_profile_sensor_data": SimpleNamespace(depth=5)},
        "sensor_msgs": {},
        "geometry_msgs": {},
        "sensor_msgs.msg": {},
        "geometry_msgs.msg": {},
    }
    for name in KINDS:
        package, _, kind = name.partition("/msg/")
        modules[f"{package}.msg"][kind] = lambda name=name: message(name)
    for module, names in modules.items():
        stand_in = ModuleType(module)
        vars(stand_in).update(names)
        monkeypatch.setitem(sys.modules, module, stand_in)
    spec = importlib.util.spec_from_file_location("vig_node", FOLDER / "vig_node.py")
    assert spec is not None and spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def image_of(picture: np.ndarray, encoding: str = "bgr8", padding: int = 6) -> SimpleNamespace:
    image = message(KINDS[0])
    image.header.frame_id, image.header.stamp.sec = "camera_optical", 7
    image.height, image.width = picture.shape[:2]
    pixels = picture[..., ::-1] if encoding == "bgr8" else picture
    rows = pixels.reshape(image.height, -1)
    image.data = np.pad(rows, ((0, 0), (0, padding))).tobytes()
    image.encoding, image.step = encoding, rows.shape[1] + padding
    return image


def info_of(K: tuple[float, float, float, float], width: int, height: int) -> SimpleNamespace:
    info = message(KINDS[1])
    fx, fy, cx, cy = K
    info.width, info.height = width, height
    info.k = [fx, 0, cx, 0, fy, cy, 0, 0, 1]
    info.p = [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]
    return info


def test_poses_and_masks_are_those_of_the_tracker(example: ModuleType) -> None:
    picture = as_srgb(coded_photo(example_photos()[1].photo))
    height, width = picture.shape[:2]
    K = 400.0, 400.0, width / 2, height / 2
    node = example.VigNode()
    node.taken["image"](image_of(picture))
    assert node.logged == ["waiting for camera_info"] and not node.published["pose"]
    node.taken["camera_info"](info_of(K, width, height))
    for _ in range(4):
        node.taken["image"](image_of(picture))
    tracker = vig.Tracker("teapot", K=K)
    expected = [tracker(picture) for _ in range(4)][-1]
    poses, masks = node.published["pose"], node.published["mask"]
    assert len(poses) == len(masks) == 4 and expected is not None
    for name, sent in ((KINDS[2], poses[-1]), (KINDS[0], masks[-1])):
        data = STORE.serialize_cdr(typed(name, sent), name)
        again = STORE.deserialize_cdr(data, name)
        assert again.header.frame_id == "camera_optical" and again.header.stamp.sec == 7
        if name == KINDS[2]:
            place = dataclasses.astuple(again.pose.pose.position)[:3]
            np.testing.assert_allclose(place, expected.camera_from_object[:3, 3], rtol=1e-4)
            covariance = np.reshape(again.pose.covariance, (6, 6))
            np.testing.assert_allclose(covariance, expected.covariance, rtol=1e-3, atol=1e-9)
            assert (np.linalg.eigvalsh(covariance) > -1e-12).all()
        else:
            pixels = np.reshape(again.data, (height, width))
            np.testing.assert_array_equal(pixels == 255, expected.mask)


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8"])
def test_rows_may_be_padded_and_channels_in_any_order(example: ModuleType, encoding: str) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (5, 7, 3), np.uint8)
    np.testing.assert_array_equal(example.picture_of(image_of(picture, encoding)), picture)


def test_images_and_cameras_that_cannot_be_used_are_logged_in_a_line(example: ModuleType) -> None:
    node = example.VigNode()
    node.taken["camera_info"](info_of((0.0, 0.0, 75.0, 75.0), 150, 150))
    cut = info_of((400.0, 400.0, 75.0, 75.0), 150, 150)
    cut.binning_x = 2
    node.taken["camera_info"](cut)
    cut.binning_x = 0
    node.taken["camera_info"](cut)
    picture = np.zeros((150, 150, 3), np.uint8)
    for change in ({"encoding": "bayer_rggb8"}, {"data": b"short"}, {"step": 3}):
        image = image_of(picture)
        vars(image).update(change)
        node.taken["image"](image)
    assert [words.split("; got")[0] for words in node.logged] == [
        "expected the camera_info of a calibrated camera",
        "expected whole images",
        "expected an image in rgb8, bgr8, rgba8, bgra8, mono8",
        "expected 150 rows of 456 bytes",
        "expected 150 rows of 3 bytes",
    ]
    assert not node.published["pose"]


def test_the_launch_file_is_valid_python() -> None:
    compile((FOLDER / "vig.launch.py").read_text(), "vig.launch.py", "exec")
