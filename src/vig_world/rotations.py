"""Rotations as matrices (3, 3) float64 and as vectors, axis times radians."""

import math

import numpy as np


def about_z(angle: float) -> np.ndarray:
    """Rotate by `angle` radians about +Z."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def matrix_of(vector: tuple[float, float, float]) -> np.ndarray:
    """Return the rotation of a vector: Rodrigues' formula."""
    x, y, z = vector
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = x / angle, y / angle, z / angle
    c, s = math.cos(angle), math.sin(angle)
    d = 1.0 - c
    return np.array([
        [c + d * x * x, d * x * y - s * z, d * x * z + s * y],
        [d * x * y + s * z, c + d * y * y, d * y * z - s * x],
        [d * x * z - s * y, d * y * z + s * x, c + d * z * z],
    ])  # fmt: skip


def turn_about_z(points: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return clouds of points (N, P, 3), each turned by its angle (N,) radians about +Z."""
    c, s = np.cos(angles), np.sin(angles)
    zero, one = np.zeros_like(c), np.ones_like(c)
    transposed = np.stack([c, s, zero, -s, c, zero, zero, zero, one], axis=1).reshape(-1, 3, 3)
    return points @ transposed


def vector_of(matrix: np.ndarray) -> tuple[float, float, float]:
    """Return the inverse of `matrix_of`, at most pi long, by way of the quaternion (Shepperd's method)."""
    m = matrix.tolist()
    trace = m[0][0] + m[1][1] + m[2][2]
    squares = [trace, m[0][0], m[1][1], m[2][2]]
    largest = max(range(4), key=squares.__getitem__)
    if largest == 0:
        q = [1.0 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]]
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q = [0.0, 0.0, 0.0, 0.0]
        q[0] = m[k][j] - m[j][k]
        q[i + 1] = 1.0 + m[i][i] - m[j][j] - m[k][k]
        q[j + 1] = m[j][i] + m[i][j]
        q[k + 1] = m[k][i] + m[i][k]
    length = math.sqrt(sum(x * x for x in q))
    w, x, y, z = (-value / length if q[0] < 0 else value / length for value in q)
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(sine, w) / sine if sine > 1e-12 else 2.0
    return x * scale, y * scale, z * scale
