import math

import numpy as np
import pytest

from vig.scene import Camera, camera_rotation


def eye(camera: Camera, azimuth: float, elevation: float) -> np.ndarray:
    rotation, translation = camera.pose(np.array([azimuth]), np.array([elevation]))
    return -rotation[0].T @ translation[0]


def pixel(camera: Camera, azimuth: float, elevation: float, point: tuple[float, float, float]) -> np.ndarray:
    rotation, translation = camera.pose(np.array([azimuth]), np.array([elevation]))
    seen = camera.K @ (rotation[0] @ point + translation[0])
    return seen[:2] / seen[2]


CAMERA = Camera.standard(target_height=0.08)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "expected"),
    [
        (0, 0, (0, -0.4, 0.08)),
        (90, 0, (0.4, 0, 0.08)),  # counter-clockwise about +Z
        (180, 0, (0, 0.4, 0.08)),
        (0, 90, (0, 0, 0.48)),
        (90, 30, (0.4 * math.cos(math.pi / 6), 0, 0.08 + 0.2)),
    ],
)
def test_the_eye_is_on_its_sphere(azimuth: float, elevation: float, expected: tuple[float, ...]) -> None:
    found = eye(CAMERA, math.radians(azimuth), math.radians(elevation))
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_target_is_at_the_centre_and_up_is_up() -> None:
    rng = np.random.default_rng(1)
    for azimuth, elevation in zip(rng.uniform(0, 7, 10), rng.uniform(-1.4, 1.4, 10), strict=True):
        np.testing.assert_allclose(pixel(CAMERA, azimuth, elevation, (0, 0, 0.08)), (75, 75))
        rotation = camera_rotation(np.array([azimuth]), np.array([elevation]))[0]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)
        above = pixel(CAMERA, azimuth, elevation, (0, 0, 0.10))
        assert above[0] == pytest.approx(75) and above[1] < 75  # rows are counted downwards


def test_azimuth_0_has_plus_x_on_the_right() -> None:
    # f x / z = 168 x 0.1 / 0.4 = 42 pixels.
    np.testing.assert_allclose(pixel(CAMERA, 0, 0, (0.1, 0, 0.08)), (75 + 42, 75))
    np.testing.assert_allclose(pixel(CAMERA, 0, 0, (0, 0, 0.18)), (75, 75 - 42))


def test_standard_is_the_papers() -> None:
    camera = Camera.standard()
    assert (camera.width, camera.height, camera.cx, camera.cy) == (150, 150, 75, 75)
    assert camera.focal == pytest.approx(168)
    assert camera.distance == 0.4


def test_a_scaled_camera_sees_the_same_at_another_size() -> None:
    camera = CAMERA.scale(8)
    assert (camera.width, camera.height) == (1200, 1200)
    point = (0.03, -0.05, 0.1)
    np.testing.assert_allclose(pixel(camera, 1.0, 0.4, point), 8 * pixel(CAMERA, 1.0, 0.4, point))
