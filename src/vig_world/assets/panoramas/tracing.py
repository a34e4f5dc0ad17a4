"""Rays among boxes that lie along the axes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vig_world.assets.panoramas.parts import OUTWARD, Box

Array = np.ndarray


@lru_cache(maxsize=4)
def directions(height: int) -> Array:
    """Return unit directions (height, 2 height, 3) of the pixels: row 0 up, columns counter-clockwise from
    +X.
    """
    theta = (np.arange(height) + 0.5) * np.pi / height
    phi = (np.arange(2 * height) + 0.5) * np.pi / height
    ring = np.sin(theta)[:, None]
    xyz = np.broadcast_arrays(ring * np.cos(phi), ring * np.sin(phi), np.cos(theta)[:, None])
    result = np.stack(xyz, -1).astype(np.float32)
    result.setflags(write=False)
    return result


def first_met(way: Array, reach: Array, boxes: list[Box]) -> tuple[Array, NDArray[np.int_], NDArray[np.int_]]:
    """Return the first hits of rays from the origin along `way` (N, 3) in a room of sides at `reach` (6,).

    Returns:
        Distances (N,); the box's index (N,), -1 for the room itself; and the side (N,) of the box or room, in
        the order of `OUTWARD`.
    """
    speed = way @ OUTWARD.T
    distance = np.where(speed > 1e-6, reach / np.maximum(speed, 1e-6), np.inf)
    side = distance.argmin(1)
    nearest = distance.min(1)
    owner = np.full(len(way), -1)
    inverse = _inverse(way.T)
    for index, box in enumerate(boxes):
        near = _toward(box, way)
        enter, leave = _slabs(box, np.zeros((3, 1), np.float32), inverse[:, near])
        entry = _largest(enter)
        met = np.nonzero((entry < -_largest(-leave)) & (entry > 0) & (entry < nearest[near]))[0]
        rays = near[met]
        nearest[rays], owner[rays] = entry[met], index
        axis = enter[:, met].argmax(0)
        side[rays] = 2 * axis + (inverse[axis, rays] > 0)  # it meets the side that looks back
    return nearest, owner, side


def seen(points: Array, target: Array, boxes: list[Box]) -> NDArray[np.bool_]:
    """Return which points (N, 3) see the target: a place (3,), or places (N, 3), past the boxes."""
    start = np.ascontiguousarray(points.T)
    inverse = _inverse(target.reshape(-1, 3).T - start)
    free = np.ones(len(points), bool)
    for box in boxes:
        enter, leave = _slabs(box, start, inverse)
        free &= np.maximum(_largest(enter), 1e-4) >= np.minimum(-_largest(-leave), 0.999)
    return free


def _toward(box: Box, way: Array) -> NDArray[np.int_]:
    """Return which rays from the origin (N, 3) point to the ball round a box."""
    centre, half = (box.low + box.high) / 2, (box.high - box.low) / 2
    sine = float(np.linalg.norm(half) / np.linalg.norm(centre))
    if sine >= 1:
        return np.arange(len(way))
    return np.nonzero(way @ (centre / np.linalg.norm(centre)) >= np.sqrt(1 - sine**2))[0]


def _largest(values: Array) -> Array:
    return np.maximum(np.maximum(values[0], values[1]), values[2])  # many times as fast as max(0)


def _inverse(way: Array) -> Array:
    return 1 / np.where(np.abs(way) < 1e-9, np.float32(1e-9), way)


def _slabs(box: Box, start: Array, inverse: Array) -> tuple[Array, Array]:
    """Return where rays (3, N) enter and leave the three slabs of a box: (3, N) each, in the rays' own
    units.
    """
    a = (box.low[:, None] - start) * inverse
    b = (box.high[:, None] - start) * inverse
    return np.minimum(a, b), np.maximum(a, b)
