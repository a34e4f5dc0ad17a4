"""Poses before the camera that took a photo, from those before the camera of a fit.

A fit's camera looks straight at the object, as if the photo had been cut from a larger one about it; the
camera that took the photo does not.
"""

import math
from collections.abc import Callable

import numpy as np

from vig.scene import Camera

STEPS = 10  # Gauss-Newton steps, at most; three are enough for most poses


def project(K: np.ndarray, pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return x, y in pixels and depth in metres, (N, 3), of points (N, 3) in a frame of a pose (4, 4)."""
    seen = (points @ pose[:3, :3].T + pose[:3, 3]) @ K.T
    return np.asarray(np.c_[seen[:, :2] / seen[:, 2:], seen[:, 2]])


def turned_pose(camera: Camera, pose: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return the pose (4, 4) before a camera with intrinsics (3, 3), nearly: exact for small objects.

    In it the object is turned with the ray that leads to it, at the distance that keeps its size.

    Args:
        camera: Camera of the fit, with the principal point on the object's axis.
        pose: (4, 4) camera_from_object in its frame.
        matrix: Intrinsics of a camera that sees the same picture.
    """
    focal_x, focal_y = matrix[0, 0], matrix[1, 1]
    ray = np.array([(camera.cx - matrix[0, 2]) / focal_x, (camera.cy - matrix[1, 2]) / focal_y, 1.0])
    length = float(np.linalg.norm(ray))
    forward = ray / length
    x, y, z = forward.tolist()
    level = math.hypot(x, z)
    turn = np.eye(4)  # columns: to the side and level; down; forward
    turn[:3, :3] = [[z / level, -x * y / level, x], [0.0, level, y], [-x / level, -y * z / level, z]]
    away = pose.copy()
    # A thing off the middle of a flat film is drawn larger by the ray's length.
    away[2, 3] += (math.sqrt(focal_x * focal_y) * length / camera.focal - 1) * camera.distance
    return np.asarray(turn @ away)


def sight_axes(pose: np.ndarray) -> np.ndarray:
    """Return axes (3, 3), columns, about the ray to an object: to the side, its vertical as seen, the ray.

    pose: (4, 4) camera_from_object.
    """
    ray = pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    vertical = pose[:3, 2] - (pose[:3, 2] @ ray) * ray
    # 1e-3: sine of the angle between the ray to an object and its vertical
    if np.linalg.norm(vertical) < 1e-3:  # it is seen from straight above
        vertical = np.cross(ray, pose[:3, 0])
    vertical /= np.linalg.norm(vertical)
    return np.stack([np.cross(vertical, ray), vertical, ray], axis=1)


def pose_covariance(
    moved: Callable[[np.ndarray], np.ndarray], at: np.ndarray, deviation: np.ndarray
) -> np.ndarray:
    """Return covariance (6, 6) of a pose from independent numbers: to first order, by differences.

    x, y, z in metres, then turns about these axes in radians.

    Args:
        moved: The pose (4, 4) of numbers (N,).
        at: (N,) in radians, logs, or widths.
        deviation: (N,) of these.
    """
    difference = 1e-4  # step of differences in radians, widths and logs
    here, there = moved(at), np.stack([moved(at + step) for step in difference * np.eye(len(at))])
    turned = there[:, :3, :3] @ here[:3, :3].T
    turns = (turned - turned.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]] / 2  # to first order in the steps
    columns = np.concatenate([there[:, :3, 3] - here[:3, 3], turns], axis=1) / difference
    spread = columns.T * deviation
    return np.asarray(spread @ spread.T)


def outline_weights(vertices: np.ndarray, faces: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Return weights (V,): 1 on the outline from `eye` (3,), between faces towards it and away; else 0.1."""
    a, b, c = (vertices[corner] for corner in faces.T)
    (x, y, z), (u, v, w), (i, j, k) = (b - a).T, (c - a).T, (eye - a).T
    towards = (y * w - z * v) * i + (z * u - x * w) * j + (x * v - y * u) * k > 0
    faces_eye, faces_away = np.zeros(len(vertices), bool), np.zeros(len(vertices), bool)
    faces_eye[faces[towards]] = True
    faces_away[faces[~towards]] = True
    # 0.1: weight of a vertex within the outline, whose own vertices count 1
    return np.where(faces_eye & faces_away, 1.0, 0.1)


def fit_pose(
    matrix: np.ndarray, pixels: np.ndarray, vertices: np.ndarray, weights: np.ndarray, start: np.ndarray
) -> np.ndarray:
    """Return the pose before a camera that projects points nearest to given pixels.

    Gauss-Newton on the weighted squared distances of projections, over rotation and translation.

    Args:
        matrix: (3, 3) intrinsics.
        pixels: (V, 2), target of each point's projection.
        vertices: (V, 3) metres, in the object's frame.
        weights: (V,) of each point's squared distance.
        start: (4, 4) camera_from_object to begin with; returned where no step makes it better.

    Returns:
        camera_from_object (4, 4).
    """
    root = np.sqrt(weights)[:, None]

    def residual(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = vertices @ pose[:3, :3].T + pose[:3, 3]
        projected = points @ matrix.T
        return points, root * (projected[:, :2] / projected[:, 2:] - pixels)

    pose, (points, off) = start, residual(start)
    for _ in range(STEPS):
        x, y, z = points.T
        # A turn w through the object's middle moves a point by w x (point - middle).
        arm_x, arm_y, arm_z = (points - points.mean(0)).T
        zero, by_x, by_y = np.zeros_like(z), matrix[0, 0] / z, matrix[1, 1] / z
        x_by_z, y_by_z = -by_x * x / z, -by_y * y / z
        jacobian = np.array(
            [
                [by_x, zero],
                [zero, by_y],
                [x_by_z, y_by_z],
                [arm_y * x_by_z, arm_y * y_by_z - arm_z * by_y],
                [arm_z * by_x - arm_x * x_by_z, -arm_x * y_by_z],
                [-arm_y * by_x, arm_x * by_y],
            ]
        )
        jacobian = (jacobian * root[:, 0]).reshape(6, -1)
        step = np.linalg.lstsq(jacobian @ jacobian.T, -jacobian @ off.T.ravel(), rcond=None)[0]
        moved = np.eye(4)
        moved[:3, :3] = _turn(step[3:])
        middle = points.mean(0)
        moved[:3, 3] = middle + step[:3] - moved[:3, :3] @ middle
        candidate = moved @ pose
        next_points, next_off = residual(candidate)
        before, after = np.square(off).sum(), np.square(next_off).sum()
        if not (next_points[:, 2] > 0).all() or after >= before:
            break
        pose, points, off = candidate, next_points, next_off
        # 1e-9: share of the squared distances by which a step must make them less, for another to follow
        if before - after < 1e-9 * before:
            break
    return pose


def _turn(vector: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) about a vector (3,) by its length in radians."""
    x, y, z = vector
    generator, angle = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], np.float64), math.hypot(x, y, z)
    # Rodrigues' formula; sin(a) / a and (1 - cos(a)) / a^2 = (sin(a / 2) / (a / 2))^2 / 2, also at 0.
    sine, half = np.sinc(angle / math.pi), np.sinc(angle / (2 * math.pi))
    return np.asarray(np.eye(3) + sine * generator + 0.5 * half**2 * generator @ generator)


def covariance_at(covariance: np.ndarray, offset: np.ndarray, unit: float = 1.0) -> np.ndarray:
    """Return a pose's covariance (6, 6) for another origin, `offset` (3,) metres from its own in the camera's
    axes, with positions in units of `unit` metres: a turn moves the one origin about the other.
    """
    x, y, z = offset
    change = np.eye(6)
    change[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    change[:3] /= unit
    return np.asarray(change @ covariance @ change.T)
