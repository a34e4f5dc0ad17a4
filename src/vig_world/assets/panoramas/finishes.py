"""Patterns of a painted room's surfaces, as functions of where they are: the same at any resolution."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vig_world.assets.panoramas.parts import CEILING, FLOOR, Finish, PanoramaRoom

Array = np.ndarray
Cells = NDArray[np.int_]


def hashed(*cells: Cells) -> Array:
    """Return a number in [0, 1) for each tuple of whole numbers, the same everywhere."""
    value = np.full(np.shape(cells[0]), 0x9E3779B9, np.uint64)
    for cell in cells:
        value = (value ^ np.asarray(cell).astype(np.int64).astype(np.uint64)) * np.uint64(0xBF58476D1CE4E5B9)
        value ^= value >> np.uint64(29)
    value = value * np.uint64(0x94D049BB133111EB)
    return ((value >> np.uint64(40)).astype(np.float32) / np.float32(2**24)).astype(np.float32)


def grain(points: Array) -> Array:
    """Return a factor (N,) near 1 that varies over centimetres and decimetres of points (N, 3)."""
    fine = hashed(*np.floor(points.T / 0.06).astype(np.int64))
    coarse = np.sin(points @ np.array([3.1, 5.3, 4.1], np.float32)) + np.sin(
        points @ np.array([-7.3, 4.7, 6.1], np.float32)
    )
    return 1 + 0.05 * (fine - 0.5) + 0.02 * coarse


def outdoors(seed: int, way: Array) -> Array:
    """Return the view out of a window along directions (N, 3): sky 1, ground and a skyline darker; (N,)."""
    azimuth = np.arctan2(way[:, 1], way[:, 0])
    block = np.floor(azimuth * 6).astype(int)
    roofs = 0.35 * hashed(block, np.full_like(block, seed)) ** 2
    trees = 0.12 * np.sin(9 * azimuth + seed % 7) + 0.06 * np.sin(31 * azimuth)
    skyline = np.where(seed % 3 == 0, roofs, 0.1 + trees)
    clouds = 0.1 * np.sin(5 * azimuth + 14 * way[:, 2] + seed % 5)
    sky = 0.95 + clouds + 0.2 * way[:, 2]
    speck = hashed(np.floor(azimuth * 40).astype(int), np.floor(way[:, 2] * 40).astype(int))
    ground = (0.25 + 0.25 * hashed(block, np.full_like(block, seed + 1))) * (0.7 + 0.6 * speck)
    return np.where(way[:, 2] > skyline, sky, ground)


def albedo_of(room: PanoramaRoom, points: Array, owner: Cells, side: Cells, size: Array) -> Array:
    """Return the albedo (N, 3) of the boxes (owner >= 0) and the room's sides at points (N, 3).

    Args:
        size: Metres (N,) that a pixel spans there; lines thinner than it fade into their surroundings.
    """
    result = np.empty_like(points)
    order = np.argsort(owner, kind="stable")
    bounds = np.searchsorted(owner[order], np.arange(-1, len(room.boxes) + 1))
    for index, box in enumerate(room.boxes):
        mine = order[bounds[index + 1] : bounds[index + 2]]
        if len(mine):
            relative = points[mine] - np.array([*box.low[:2], -room.reach[FLOOR]])
            result[mine] = _pattern(box.finish, relative, side[mine], size[mine])
    shell = order[: bounds[1]]
    height = points[:, 2] + room.reach[FLOOR]
    for one in range(6):
        mine = shell[side[shell] == one]
        relative = points[mine] + room.reach[1::2]
        finish = room.sides[one]
        result[mine] = _pattern(finish, relative, side[mine], size[mine])
        if one < CEILING:
            skirting = mine[height[mine] < 0.09]
            result[skirting] = finish.second
    for patch in room.patches:
        mine = shell[side[shell] == patch.side]
        place, axis = points[mine], patch.side // 2
        rim = np.minimum(place - patch.low, patch.high - place)
        rim[:, axis] = np.inf
        rim = rim.min(1)
        tone = 0.7 + 0.6 * hashed(*np.floor(place.T / 0.12).astype(np.int64))
        result[mine[rim > 0]] = patch.second
        inner = rim > patch.border
        wild = patch.side < CEILING and patch.border < 0.06
        result[mine[inner]] = patch.albedo * (tone[inner, None] if wild else 1.0)
    return result


def _line(result: Array, where: Array, width: float, size: Array, factor: float) -> Array:
    """Return the albedo (N, 3) darkened on a line of a width in metres, in proportion to the line's share of
    a pixel (N,).
    """
    return result * np.where(where, 1 - (1 - factor) * np.minimum(width / size, 1), 1)[:, None]


def _pattern(finish: Finish, at: Array, side: Cells, size: Array) -> Array:
    """Return the albedo (N, 3) of a finish at places (N, 3), metres from a corner, on sides (N,)."""
    x, y, z = at.T
    upright = side < CEILING
    along = np.where(side // 2 == 0, y, x)
    result: Array = np.repeat(finish.albedo[None].astype(np.float32), len(at), axis=0)
    p = finish.period
    if finish.pattern == "doors":
        line = (np.minimum(along % p, p - along % p) < 0.012) | (np.abs(z % 0.72 - 0.1) < 0.012)
        result = _line(result, line & upright, 0.024, size, 0.3)
    elif finish.pattern == "books":
        row, spine = np.floor(z / p).astype(int), np.floor(along / 0.045).astype(int)
        tall = (z / p - row) < 0.55 + 0.35 * hashed(row, spine)
        here = hashed(row, spine // 5) < 0.75
        colours = np.stack([0.04 + 0.5 * hashed(row, spine, np.full_like(row, k)) ** 2 for k in range(3)], 1)
        colours = 0.5 * colours + 0.5 * colours.mean(1, keepdims=True)
        filled = np.where((tall & here)[:, None], colours, 0.35 * result)
        shelf = z % p < 0.03
        result = np.where((upright & ~shelf)[:, None], filled, result)
    elif finish.pattern == "cushions":
        phase = np.abs(along / p - np.round(along / p)) * 2
        result = result * np.where(upright | (side == CEILING), 0.65 + 0.35 * phase, 1.0)[:, None]
    elif finish.pattern == "leaves":
        cells = np.floor(at.T / p).astype(int)
        light = hashed(*cells)
        result = result + (finish.second - finish.albedo) * light[:, None]
        result[hashed(*(cells + 17)) < 0.35] *= 0.25
    elif finish.pattern == "planks":
        row = np.floor(x / p).astype(int)
        plank = np.floor(y / 1.3 + hashed(row)).astype(int)
        result = result * (0.8 + 0.4 * hashed(row, plank))[:, None]
        result = _line(result, x % p < 0.006, 0.006, size, 0.4)
    elif finish.pattern == "tiles":
        column, row = np.floor(x / p).astype(int), np.floor(y / p).astype(int)
        if finish.second.mean() > 0.6 * finish.albedo.mean():
            result = np.where(((column + row) % 2 == 0)[:, None], finish.second, result)
        result = result * (0.92 + 0.16 * hashed(column, row))[:, None]
        result = _line(result, (x % p < 0.012) | (y % p < 0.012), 0.012, size, 0.5)
    elif finish.pattern == "carpet":
        result = result * (0.8 + 0.4 * hashed(*np.floor(at.T / 0.05).astype(int)))[:, None]
    elif finish.pattern == "brick":
        row = np.floor(z / p).astype(int)
        shifted = along / (3 * p) + 0.5 * (row % 2)
        result = result * (0.7 + 0.6 * hashed(row, np.floor(shifted).astype(int)))[:, None]
        result[(z % p < 0.01) | (shifted % 1 < 0.04)] = finish.second
    elif finish.pattern == "panelled":
        lower = z < 0.95
        result[lower] = finish.second
        result = _line(result, upright & (along % p < 0.015), 0.015, size, 0.6)
    return result
