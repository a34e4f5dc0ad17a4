"""Procedural indoor environment maps: a box-shaped room with windows and lamps, painted in HDR.

Each pixel's ray is cast to the room's walls. What it meets there is either a source (window, lamp) or a
surface: albedo times the irradiance that the sources send to that point, plus a constant indirect part.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vig.scene.light import Y00, Y1, exposed, grey, project_panorama
from vig.synthesis.textures import colour, near, noise

Array = np.ndarray

_DAYLIGHT = np.array([[1.0, 0.96, 0.88], [0.80, 0.92, 1.10], [0.95, 1.0, 1.05]], np.float32)
_LAMPLIGHT = np.array([[1.25, 0.95, 0.55], [1.1, 0.98, 0.8], [0.95, 1.0, 1.05]], np.float32)
_OUTWARD = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float32)
_CEILING, _FLOOR = 4, 5  # sides of the room, in the order of _OUTWARD


@dataclass(frozen=True)
class _Window:
    """A bright rectangle in a side of the room: centre (3,), half extents (3,), metres, and radiance (3,)."""

    side: int
    centre: Array
    half: Array
    radiance: Array


@dataclass(frozen=True)
class _Lamp:
    """A small bright sphere: its centre (3,) and radius, metres, and radiance (3,)."""

    centre: Array
    radius: float
    radiance: Array


@lru_cache(maxsize=4)
def directions(height: int) -> Array:
    """Unit directions (height, 2 height, 3) of the pixels: row 0 up, columns counter-clockwise from +X."""
    theta = (np.arange(height) + 0.5) * np.pi / height
    phi = (np.arange(2 * height) + 0.5) * np.pi / height
    ring = np.sin(theta)[:, None]
    xyz = np.broadcast_arrays(ring * np.cos(phi), ring * np.sin(phi), np.cos(theta)[:, None])
    result = np.stack(xyz, -1).astype(np.float32)
    result.setflags(write=False)
    return result


def _rectangle(
    rng: np.random.Generator, reach: Array, side: int, size: Array, sill: float
) -> tuple[Array, Array]:
    """Centre and half extents of a rectangle (width, height) somewhere on a side, `sill` above the floor."""
    low, high = -reach[1::2], reach[::2]
    axis = side // 2
    half = np.zeros(3, np.float32)
    half[[a for a in range(3) if a != axis]] = np.asarray(size) / 2
    half = np.minimum(half, 0.4 * (high - low))
    centre = low + half + rng.uniform(0, 1, 3) * (high - low - 2 * half)
    if side != _CEILING:
        centre[2] = low[2] + half[2] + min(sill, high[2] - low[2] - 2 * half[2])
    centre[axis] = reach[side] * _OUTWARD[side, axis]
    return centre.astype(np.float32), half


def _windows(rng: np.random.Generator, reach: Array, radiance: float) -> list[_Window]:
    """One to three windows, mostly in one wall; some reach to the floor, a few are skylights."""
    main = int(rng.integers(4))
    tint = near(_DAYLIGHT[rng.integers(len(_DAYLIGHT))], rng, 0.1)
    windows = []
    for _ in range(rng.integers(1, 4)):
        draw = rng.uniform()
        side = main if draw < 0.65 else int(rng.integers(4)) if draw < 0.94 else _CEILING
        sill = 0.0 if rng.uniform() < 0.2 else rng.uniform(0.5, 1.2)
        place = _rectangle(rng, reach, side, rng.uniform([0.8, 0.9], [3.2, 2.2]), sill)
        windows.append(_Window(side, *place, radiance * rng.uniform(0.5, 1.3) * tint))
    return windows


def _lamps(rng: np.random.Generator, reach: Array, power: float) -> list[_Lamp]:
    """Zero to four lamps: under the ceiling or standing about, at least 0.8 m away."""
    lamps = []
    tint = near(_LAMPLIGHT[rng.integers(len(_LAMPLIGHT))], rng, 0.1)
    for _ in range(rng.integers(0, 5)):
        centre = rng.uniform(-0.85 * reach[1::2], 0.85 * reach[::2])
        centre[2] = (
            rng.uniform(0.6, 0.92) * reach[_CEILING] if rng.uniform() < 0.65 else rng.uniform(-0.3, 0.6)
        )
        centre *= max(1.0, 0.8 / float(np.linalg.norm(centre)))
        radius = rng.uniform(0.05, 0.16)
        radiance = power * rng.uniform(0.4, 1.5) / (np.pi * radius**2)
        lamps.append(_Lamp(centre.astype(np.float32), float(radius), radiance * tint))
    return lamps


def _direct(points: Array, inward: Array, windows: list[_Window], lamps: list[_Lamp]) -> Array:
    """Irradiance / pi (N, 3) that the sources send to points (N, 3) with normals (N, 3)."""
    total = np.zeros_like(points)

    def add(centre: Array, facing: Array | None, power: Array) -> None:
        way = centre - points
        square = np.einsum("ni,ni->n", way, way) + 0.05
        cosines = np.maximum(np.einsum("ni,ni->n", way, inward), 0)
        if facing is not None:
            cosines = cosines * np.maximum(way @ facing, 0) / np.sqrt(square)
        total[:] += (cosines / (square * np.sqrt(square)))[:, None] * (power / np.pi)

    for w in windows:
        longest = np.zeros(3, np.float32)
        longest[w.half.argmax()] = w.half.max() / 2
        area = 4 * np.prod(np.sort(w.half)[1:])
        for centre in (w.centre - longest, w.centre + longest):
            add(centre, _OUTWARD[w.side], 0.5 * area * w.radiance)
    for lamp in lamps:
        add(lamp.centre, None, np.pi * lamp.radius**2 * lamp.radiance)
    return total


def _albedo(rng: np.random.Generator, reach: Array, points: Array, side: NDArray[np.int_]) -> Array:
    """Albedo (N, 3) of the room at points (N, 3): walls, floor, ceiling, and flat furniture on them."""
    paint = near(np.full(3, rng.uniform(0.35, 0.85), np.float32), rng, 0.25)
    sides = np.stack([near(paint, rng, 0.2) if rng.uniform() < 0.75 else colour(rng) for _ in range(6)])
    sides[_CEILING] = near(np.full(3, rng.uniform(0.55, 0.9), np.float32), rng, 0.1)
    floor = np.array([1.0, 0.8, 0.6] if rng.uniform() < 0.6 else [1.0, 1.0, 1.0])
    sides[_FLOOR] = near(floor * rng.uniform(0.08, 0.6), rng, 0.2)
    albedo = sides[side]
    for _ in range(rng.integers(3, 10)):  # cupboards, doors, pictures, sofas, rugs
        place = int(rng.integers(6))
        if place == _CEILING:
            continue
        sill = 0.0 if rng.uniform() < 0.6 else rng.uniform(0.8, 1.6)
        centre, half = _rectangle(rng, reach, place, rng.uniform([0.4, 0.4], [2.2, 2.0]), sill)
        if place == _FLOOR:
            centre[2] = -reach[_FLOOR]
        inside = (np.abs(points - centre) <= half + 1e-3).all(-1) & (side == place)
        albedo[inside] = 0.8 * colour(rng)
    return albedo


def panorama(rng: np.random.Generator, height: int = 64) -> Array:
    """Paints the light of one random room as seen from a table in it.

    Args:
        rng: everything random comes from it.
        height: rows; at least 16.

    Returns:
        (height, 2 height, 3) float32 linear radiance >= 0, equirectangular: row 0 straight up (+Z), column u
        at azimuth 2 pi (u + 0.5) / width counter-clockwise from +X. Its scale is arbitrary.

    Raises:
        ValueError: height below 16.
    """
    if height < 16:
        raise ValueError(f"height must be at least 16 rows; got {height}.")
    reach = rng.uniform([0.6, 0.6, 0.6, 0.6, 1.3, 0.6], [4.0, 4.0, 4.0, 4.0, 2.4, 1.1]).astype(np.float32)
    day, evening = rng.uniform(size=2) < [0.8, 0.55]
    windows = _windows(rng, reach, float(np.exp(rng.uniform(*np.log([0.7, 10])))) if day else 0.05)
    lamps = _lamps(rng, reach, float(np.exp(rng.uniform(*np.log([0.2, 100]))))) if evening or not day else []
    indirect = float(np.exp(rng.uniform(*np.log([0.3, 1.5]))))

    way = directions(height).reshape(-1, 3)
    solid_angle = np.hypot(way[:, 0], way[:, 1]) * (np.pi / height) ** 2
    speed = way @ _OUTWARD.T
    distance = np.where(speed > 1e-6, reach / np.maximum(speed, 1e-6), np.inf)
    side = distance.argmin(1)
    points = way * distance.min(1)[:, None]

    light = _direct(points, -_OUTWARD[side], windows, lamps)
    light += indirect * (solid_angle @ light) / (4 * np.pi) + 0.02
    bright = (solid_angle * light.mean(1)) @ way / (solid_angle @ light.mean(1)) + 0.1 * rng.standard_normal(
        3
    )
    facing = way @ (bright / np.linalg.norm(bright)).astype(np.float32)
    light *= (1 + rng.uniform(0.2, 0.95) * facing)[:, None]  # corners away from the light lie in the dark
    image = _albedo(rng, reach, points, side) * light
    sunny, aim, sun = rng.uniform() < 0.1, rng.uniform(-0.7, 0.7, 3), rng.uniform(0.3, 4.0)
    # The grain takes a number of draws that depends on the height: it comes last, so that the room does not.
    image *= np.maximum(1 + 0.08 * noise(rng, 2 * height, 1.4)[:height].reshape(-1, 1), 0.3)

    for w in windows:
        inside = (np.abs(points - w.centre) <= w.half + 1e-3).all(-1) & (side == w.side)
        outdoors = 0.75 + 0.35 * np.clip(3 * way[inside, 2:], -1, 1)  # ground darker than sky
        image[inside] = outdoors * w.radiance

    def disc(centre: Array, angle: float, flux: Array) -> None:
        """Paints a disc of the given angular radius, no smaller than a pixel, that holds the flux (3,)."""
        cosines = way @ (centre / np.linalg.norm(centre)).astype(np.float32)
        seen = cosines > min(np.cos(max(angle, np.pi / height)), cosines.max() - 1e-6)
        image[seen] = flux / solid_angle[seen].sum()

    if day and sunny:  # the sun itself, seen through a window
        tint = windows[0].radiance / windows[0].radiance.mean()
        disc(windows[0].centre + aim * windows[0].half, 0.04, sun * (solid_angle @ image.mean(1)) * tint)
    for lamp in lamps:
        angle = lamp.radius / float(np.linalg.norm(lamp.centre))
        disc(lamp.centre, angle, np.pi * angle**2 * lamp.radiance)
    return np.maximum(image, 0).astype(np.float32).reshape(height, 2 * height, 3)


def grey_light(image: Array) -> NDArray[np.float64]:
    """Grey light of a panorama (H, W, 3): nine SH coefficients, scaled so that L00 = 0.75 pi."""
    return exposed(grey(project_panorama(image)))


def light_parts(radiance: Array) -> NDArray[np.float64]:
    """What a panorama gives a place on a level support: (2, 9) grey SH of radiance, unexposed.

    radiance: (H, W, 3), H even. First the panorama's upper hemisphere alone, then what a white support that
    fills the lower one sends up: everywhere E / pi, E being the irradiance from above. Both turn with
    `rotate_z`, so they are computed once per panorama.
    """
    rows = len(radiance)
    if rows % 2:
        raise ValueError(f"a panorama needs an even number of rows to be cut at its horizon; got {rows}.")
    above = np.array(radiance)
    above[rows // 2 :] = 0
    upper = grey(project_panorama(above))
    # Row by row the integral of cosine over solid angle, and over all directions below of Y00 and Y10.
    sine = np.sin(np.linspace(0, np.pi / 2, rows // 2 + 1))
    cosines = np.pi * (sine[1:] ** 2 - sine[:-1] ** 2)
    reflected = cosines @ grey(above[: rows // 2].mean(axis=1, dtype=np.float64)) / np.pi
    white = np.zeros(9)
    white[0], white[2] = 2 * np.pi * Y00 * reflected, -np.pi * Y1 * reflected
    return np.stack([upper, white])


def local_light(radiance: Array, ground_albedo: float) -> NDArray[np.float64]:
    """Grey light (9,) at a place on a level support of this albedo, at the paper's exposure.

    radiance: (H, W, 3), H even, or its `light_parts` (2, 9). The support hides the lower hemisphere and
    sends back albedo x E / pi, E the irradiance from above. Turning it by `rotate_z` is the same as turning
    the panorama. Raises ValueError when no light comes from above.
    """
    upper, white = radiance if radiance.shape == (2, 9) else light_parts(radiance)
    return exposed(upper + ground_albedo * white)
