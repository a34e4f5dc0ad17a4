"""Paints a room in HDR: the surface that each ray from the viewpoint meets, and its light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vig_world.assets.panoramas.finishes import albedo_of, grain, outdoors
from vig_world.assets.panoramas.parts import FLOOR, OUTWARD, Panel, PanoramaRoom
from vig_world.assets.panoramas.rooms import draw
from vig_world.assets.panoramas.tracing import directions, first_met, seen

Array = np.ndarray

_SHADOWED = 6
"""Number of a room's strongest light sources that cast shadows."""
_BOUNCED = 0.55
"""Share of the light that a surface meets which comes back from the next, in the mean."""

_ELSEWHERE = 1e-3
"""Irradiance / pi that comes from other rooms, so that none is black."""


@dataclass(frozen=True)
class _Place:
    """Source of light: a point (3,), its intensity (3,) along `facing` (3,), or all round when None."""

    point: Array
    facing: Array | None
    intensity: Array


def panorama(rng: np.random.Generator, height: int = 64) -> Array:
    """Paint the light of one random room as seen from a table in it.

    Args:
        rng: Source of all randomness.
        height: Number of rows, at least 16. The same generator gives the same room at any height.

    Returns:
        (height, 2 height, 3) float32 linear radiance >= 0, equirectangular: row 0 straight up (+Z), column u
        at azimuth 2 pi (u + 0.5) / width counter-clockwise from +X. Its scale is arbitrary.

    Raises:
        ValueError: For a height below 16.
    """
    if height < 16:
        raise ValueError(f"height must be at least 16 rows; got {height}.")
    return paint(draw(rng), height)


def paint(room: PanoramaRoom, height: int) -> Array:
    """Return a room's panorama, (height, 2 height, 3) float32 linear radiance."""
    way = directions(height).reshape(-1, 3)
    solid_angle = np.hypot(way[:, 0], way[:, 1]) * (np.pi / height) ** 2
    distance, owner, side = first_met(way, room.reach, room.boxes)
    points = way * distance[:, None]
    normals = np.where((owner < 0)[:, None], -OUTWARD[side], OUTWARD[side])
    lifted = points + 0.004 * normals
    casting = [box for box in room.boxes if box.casts]

    direct = _sunlight(room, lifted, normals, casting)
    places = sorted(_places(room), key=lambda place: -float(place.intensity.sum()))
    for index, place in enumerate(places):
        arriving = _arriving(place, lifted, normals)
        if index < _SHADOWED:
            lit = np.nonzero(arriving[:, 1])[0]
            arriving[lit] *= seen(lifted[lit], place.point, casting)[:, None]
        direct += arriving
    slant = np.maximum(np.abs(np.einsum("ni,ni->n", way, normals)), 0.1)
    albedo = albedo_of(room, points, owner, side, distance * (np.pi / height) / slant)
    reflected = albedo * direct
    weighted = solid_angle[:, None] * reflected
    mean, slope = weighted.sum(0) / (4 * np.pi), way.T @ weighted * (3 / (4 * np.pi))
    around = np.maximum(mean + normals @ slope * (2 / 3), 0.2 * mean)
    ambient = room.ambient / (1 - _BOUNCED) * around + _ELSEWHERE
    nooks = _nooks(room, points, owner, side, casting)
    bright = way.T @ weighted.mean(1) + sum((_flux(place) for place in places), np.zeros(3))
    bright[2] *= 0.5  # the far side of a room lies in the dark, its floor less so
    bright /= max(float(np.linalg.norm(bright)), 1e-9)
    side_light = 1 + room.shade * (way @ bright.astype(np.float32))
    image = (reflected + albedo * ambient * nooks[:, None]) * (grain(points) * side_light)[:, None]
    _show_sources(room, image, way, distance, solid_angle, casting)
    return np.maximum(image, 0).astype(np.float32).reshape(height, 2 * height, 3)


def _places(room: PanoramaRoom) -> list[_Place]:
    """Return windows and lamps as points: two for those longer than a metre."""
    places = []
    for panel in room.panels:
        half = panel.half
        long = panel.across * half[0] if half[0] > half[1] else panel.over * half[1]
        offsets = (-0.5 * long, 0.5 * long) if half.max() > 0.5 and len(room.panels) < 8 else (0 * long,)
        glass = 0.75 * panel.radiance if panel.window else panel.radiance
        for offset in offsets:
            start = panel.centre + offset + 0.01 * panel.normal
            places.append(_Place(start, panel.normal, panel.area * glass / len(offsets)))
    places += [_Place(bulb.centre, None, np.pi * bulb.radius**2 * bulb.radiance) for bulb in room.bulbs]
    return places


def _arriving(place: _Place, points: Array, normals: Array) -> Array:
    """Return the irradiance / pi (N, 3) from a place at points (N, 3), nothing being in the way."""
    way = place.point - points
    square = np.einsum("ni,ni->n", way, way) + 0.08
    cosines = np.maximum(np.einsum("ni,ni->n", way, normals), 0)
    if place.facing is not None:
        cosines = cosines * np.maximum(-way @ place.facing, 0) / np.sqrt(square)
    return (cosines / (square * np.sqrt(square)))[:, None] * (place.intensity / np.pi)


def _flux(place: _Place) -> Array:
    """Return light that reaches the viewpoint from a place, as a vector (3,) towards it."""
    reach = float(np.linalg.norm(place.point))
    cosine = 1.0 if place.facing is None else max(float(-place.point @ place.facing) / reach, 0.0)
    return place.intensity.mean() * cosine / max(reach, 0.3) ** 3 * place.point


def _sunlight(room: PanoramaRoom, points: Array, normals: Array, casting: list) -> Array:
    """Return the irradiance / pi (N, 3) of the sun where it shines in through a window."""
    result = np.zeros_like(points)
    if room.sun is None:
        return result
    direction, strength = room.sun
    facing = normals @ direction
    lit = np.nonzero((facing > 0) & _through_glass(room, points, direction))[0]
    lit = lit[seen(points[lit], points[lit] + 20 * direction, casting)]
    result[lit] = facing[lit, None] * strength
    return result


def _through_glass(room: PanoramaRoom, points: Array, direction: Array) -> NDArray[np.bool_]:
    """Return from which points (N, 3) a direction leads out through a pane without a veil."""
    through = np.zeros(len(points), bool)
    for panel in room.panels:
        against = float(direction @ panel.normal)
        if panel.window and panel.veil == 0 and against < -1e-3:
            reach = ((panel.centre - points) @ panel.normal) / against
            met = points + reach[:, None] * direction - panel.centre
            inside = (np.abs(met @ panel.across) < panel.half[0]) & (np.abs(met @ panel.over) < panel.half[1])
            through |= inside & (reach > 0)
    return through


def _nooks(
    room: PanoramaRoom, points: Array, owner: NDArray[np.int_], side: NDArray[np.int_], casting: list
) -> Array:
    """Return the share (N,) of the room's light that reaches its corners and the space round furniture."""
    shade = np.ones(len(points), np.float32)
    shell = owner < 0
    low, high = points + room.reach[1::2], room.reach[::2] - points
    for axis in range(3):
        for gap in (low[:, axis], high[:, axis]):
            shade *= 1 - 0.35 * np.exp(-gap / 0.3) * (side // 2 != axis)
    near, dim = points[shell], np.ones(int(shell.sum()), np.float32)
    columns = np.ascontiguousarray(near.T)
    for box in casting:
        close = np.ones(len(near), bool)
        for axis in range(3):
            close &= (columns[axis] > box.low[axis] - 0.6) & (columns[axis] < box.high[axis] + 0.6)
        around = np.nonzero(close)[0]
        place = near[around]
        gap = np.maximum(np.maximum(box.low - place, place - box.high), 0)
        dim[around] *= 1 - 0.5 * np.exp(-np.sqrt(np.einsum("ni,ni->n", gap, gap)) / 0.15)
    shade[shell] *= dim
    under = ~shell & (side == FLOOR)
    shade[under] *= 0.3
    return shade


def _show_sources(
    room: PanoramaRoom, image: Array, way: Array, distance: Array, solid_angle: Array, casting: list
) -> None:
    """Paint light sources into the image (N, 3), each with the flux that it has, however small."""
    eye = np.zeros((1, 3), np.float32)
    for panel in room.panels:
        where, radiance = _panel(room, panel, way, distance)
        if len(where):
            image[where] = radiance
        elif not panel.window and seen(eye, panel.centre - 0.02 * panel.normal, casting)[0]:
            reach = float(np.linalg.norm(panel.centre))
            flux = panel.radiance * panel.area * max(float(-panel.centre @ panel.normal), 0) / reach**3
            _spot(image, way, solid_angle, panel.centre / reach, 0.0, flux)
    for bulb in room.bulbs:
        reach = float(np.linalg.norm(bulb.centre))
        if seen(eye, bulb.centre, casting)[0]:
            flux = np.pi * (bulb.radius / reach) ** 2 * bulb.radiance
            _spot(image, way, solid_angle, bulb.centre / reach, bulb.radius / reach, flux)
    if room.sun and _through_glass(room, eye, room.sun[0])[0] and seen(eye, 20 * room.sun[0], casting)[0]:
        _spot(image, way, solid_angle, room.sun[0], 0.03, 0.3 * np.pi * room.sun[1])


def _panel(room: PanoramaRoom, panel: Panel, way: Array, distance: Array) -> tuple[NDArray[np.int_], Array]:
    """Return which rays (M,) end on a panel, and the radiance (M, 3) they see there."""
    against = way @ panel.normal
    ahead = np.nonzero((against < -1e-4) if panel.centre @ panel.normal < 0 else against > 1e-4)[0]
    reach = float(panel.centre @ panel.normal) / against[ahead]
    met = way[ahead] * reach[:, None] - panel.centre
    u, v = met @ panel.across / panel.half[0], met @ panel.over / panel.half[1]
    inside = (np.abs(u) < 1) & (np.abs(v) < 1) & (reach < distance[ahead] + 0.03)
    where, u, v = ahead[inside], u[inside], v[inside]
    if panel.centre @ panel.normal > 0:  # a lamp from behind
        return where, np.full((len(where), 3), 0.01) * panel.radiance
    if not panel.window:
        return where, (1 - 0.15 * (u * u + v * v))[:, None] * panel.radiance
    view = outdoors(room.skyline, way[where])
    view = ((1 - panel.veil) * view + panel.veil * 0.6)[:, None] * panel.radiance
    size = 2 * panel.half
    bars = np.minimum(_to_bar(u, panel.bars[0], float(size[0])), _to_bar(v, panel.bars[1], float(size[1])))
    view[bars < 0.03] = 0.12 * panel.frame * panel.radiance
    return where, view


def _to_bar(share: Array, panes: int, size: float) -> Array:
    """Return metres to the next bar of a window `size` metres across, at shares in [-1, 1] of its half."""
    pane = (share + 1) / 2 * panes
    return np.abs(pane - np.round(pane)) * size / panes


def _spot(image: Array, way: Array, solid_angle: Array, direction: Array, angle: float, flux: Array) -> None:
    """Paint a disc of an angular radius, no smaller than a pixel, that holds the flux (3,)."""
    cosines = way @ direction.astype(np.float32)
    height = np.sqrt(len(way) / 2)
    shown = cosines > min(np.cos(max(angle, np.pi / height)), cosines.max() - 1e-6)
    image[shown] = flux / solid_angle[shown].sum()
