"""Paints a room in HDR: the surface that each ray from the viewpoint meets, and its light."""

import numpy as np
from numpy.typing import NDArray

from vig_world.assets.panoramas.light import directions
from vig_world.assets.panoramas.rooms import FLOOR, OUTWARD, Box, PanoramaRoom, Source, draw

Array = np.ndarray


def panorama(rng: np.random.Generator, height: int = 64) -> Array:
    """Paint the light of one random room as seen from a table in it.

    Args:
        rng: Source of all randomness.
        height: Number of rows, at least 16. The same generator gives the same room at any height.

    Returns:
        (height, 2 height, 3) float32 linear radiance >= 0 from `directions`. Its scale is arbitrary.

    Raises:
        ValueError: For a height below 16.
    """
    if height < 16:
        raise ValueError(f"height must be at least 16 rows; got {height}.")
    return paint(draw(rng), height)


def paint(room: PanoramaRoom, height: int) -> Array:
    """Return a room's panorama, (height, 2 height, 3) float32 linear radiance."""
    way = directions(height, 2 * height).reshape(-1, 3).astype(np.float32)
    solid_angle = np.hypot(way[:, 0], way[:, 1]) * (np.pi / height) ** 2
    distance, owner, side = first_met(way, room)
    points = way * distance[:, None]
    normals = np.where((owner < 0)[:, None], -OUTWARD[side], OUTWARD[side])
    lifted = points + 0.004 * normals

    direct = _sunlight(room, lifted, normals)
    sources = sorted(room.sources, key=lambda source: -float(source.area * source.radiance.sum()))
    bright = np.zeros(3)
    for index, source in enumerate(sources):
        arriving = _arriving(source, lifted, normals)
        if index < 6:  # only the strongest cast shadows
            lit = np.nonzero(arriving[:, 1])[0]
            arriving[lit] *= visible_points(lifted[lit], source.centre + 0.01 * source.normal, room.boxes)[
                :, None
            ]
        direct += arriving
        reach = float(np.linalg.norm(source.centre))
        faced = max(float(-source.centre @ source.normal) / reach, 0.0)
        bright += source.area * source.radiance.mean() * faced / max(reach, 0.3) ** 3 * source.centre
    albedo = _albedo(room, points, owner, side, distance * (np.pi / height))
    reflected = albedo * direct
    weighted = solid_angle[:, None] * reflected
    mean, slope = weighted.sum(0) / (4 * np.pi), way.T @ weighted * (3 / (4 * np.pi))
    around = np.maximum(mean + normals @ slope * (2 / 3), 0.2 * mean)
    # .55 of the light comes back from the next surface, in the mean; a little comes from other rooms.
    ambient = room.ambient / (1 - 0.55) * around + 1e-3
    bright += way.T @ weighted.mean(1)
    bright[2] *= 0.5  # the far side of a room lies in the dark, its floor less so
    side_light = 1 + room.shade * (way @ (bright / max(float(np.linalg.norm(bright)), 1e-9)))
    nooks = _nooks(room, points, owner, side)
    image = (reflected + albedo * ambient * nooks[:, None]) * side_light[:, None]
    for source in room.sources:
        _show(room, source, image, way, distance, solid_angle)
    eye = np.zeros((1, 3), np.float32)
    if (
        room.sun
        and _through_glass(room, eye, room.sun[0])[0]
        and visible_points(eye, 20 * room.sun[0], room.boxes)[0]
    ):
        _spot(image, way, solid_angle, room.sun[0], 0.03, 0.3 * np.pi * room.sun[1])
    return np.maximum(image, 0).astype(np.float32).reshape(height, 2 * height, 3)


def first_met(way: Array, room: PanoramaRoom) -> tuple[Array, NDArray[np.int_], NDArray[np.int_]]:
    """Return the first hits of rays from the origin along `way` (N, 3).

    Returns:
        Distances (N,); the box's index (N,), -1 for the room itself; and the side (N,) of the box or room, in
        the order of `OUTWARD`.
    """
    speed = way @ OUTWARD.T
    distance = np.where(speed > 1e-6, room.reach / np.maximum(speed, 1e-6), np.inf)
    side, nearest = distance.argmin(1), distance.min(1)
    owner = np.full(len(way), -1)
    for index, box in enumerate(room.boxes):
        enter, leave = _slabs(box, np.zeros((3, 1), np.float32), way.T)
        entry = enter.max(0)
        met = (entry < leave.min(0)) & (entry > 0) & (entry < nearest)
        axis = enter[:, met].argmax(0)
        nearest[met], owner[met] = entry[met], index
        side[met] = 2 * axis + (way.T[axis, met] > 0)  # it meets the side that looks back
    return nearest, owner, side


def visible_points(points: Array, target: Array, boxes: list[Box]) -> NDArray[np.bool_]:
    """Return which points (N, 3) see the target: a place (3,), or places (N, 3), past the boxes."""
    start = np.ascontiguousarray(points.T, np.float32)
    way = target.reshape(-1, 3).T.astype(np.float32) - start
    free = np.ones(len(points), bool)
    for box in boxes:
        enter, leave = _slabs(box, start, way)
        free &= np.maximum(enter.max(0), 1e-4) >= np.minimum(leave.min(0), 0.999)
    return free


def _slabs(box: Box, start: Array, way: Array) -> tuple[Array, Array]:
    """Return where rays (3, N) enter and leave a box's three slabs: (3, N) each, in the rays' own units."""
    inverse = 1 / np.where(np.abs(way) < 1e-9, np.float32(1e-9), way)
    a, b = (box.low[:, None] - start) * inverse, (box.high[:, None] - start) * inverse
    return np.minimum(a, b), np.maximum(a, b)


def hash_numbers(*cells: NDArray[np.int_]) -> Array:
    """Return a number in [0, 1) for each tuple of whole numbers, the same everywhere."""
    value = np.full(np.shape(cells[0]), 0x9E3779B9, np.uint64)
    for cell in cells:
        value = (value ^ np.asarray(cell).astype(np.int64).astype(np.uint64)) * np.uint64(0xBF58476D1CE4E5B9)
        value ^= value >> np.uint64(29)
    return ((value * np.uint64(0x94D049BB133111EB)) >> np.uint64(40)).astype(np.float32) / np.float32(2**24)


def _albedo(
    room: PanoramaRoom, points: Array, owner: NDArray[np.int_], side: NDArray[np.int_], size: Array
) -> Array:
    """Return the albedo (N, 3) of the boxes (owner >= 0) and the room's sides at points (N, 3), where a pixel
    spans `size` metres (N,): smaller cells fade.
    """
    surfaces = [*room.boxes, *room.sides]
    number = np.where(owner < 0, len(room.boxes) + side, owner)
    albedo = np.array([surface.albedo for surface in surfaces], np.float32)[number]
    period = np.array([surface.period for surface in surfaces])[number]
    contrast = np.array([surface.contrast for surface in surfaces])[number]
    contrast = contrast * np.minimum(period / (3 * size), 1) ** 2
    tone = hash_numbers(number, *np.floor((points + 1e-3) / period[:, None]).astype(np.int64).T)
    grain = np.sin(points @ [3.1, 5.3, 4.1]) + np.sin(points @ [-7.3, 4.7, 6.1])
    return albedo * (1 + contrast * (tone - 0.5) + 0.03 * grain)[:, None].astype(np.float32)


def _arriving(source: Source, points: Array, normals: Array) -> Array:
    """Return the irradiance / pi (N, 3) from a source at points (N, 3), nothing being in the way."""
    way = source.centre - points
    square = np.einsum("ni,ni->n", way, way) + 0.08
    cosines = np.maximum(np.einsum("ni,ni->n", way, normals), 0)
    if source.over is not None:
        cosines = cosines * np.maximum(-way @ source.normal, 0) / np.sqrt(square)
    share = 0.75 if source.bars else 1.0
    return (cosines / (square * np.sqrt(square)))[:, None] * (share * source.area / np.pi * source.radiance)


def _sunlight(room: PanoramaRoom, points: Array, normals: Array) -> Array:
    """Return the irradiance / pi (N, 3) of the sun where it shines in through a window."""
    result = np.zeros(points.shape)
    if room.sun is not None:
        direction, strength = room.sun
        facing = normals @ direction
        lit = np.nonzero((facing > 0) & _through_glass(room, points, direction))[0]
        lit = lit[visible_points(points[lit], points[lit] + 20 * direction, room.boxes)]
        result[lit] = facing[lit, None] * strength
    return result


def _met(source: Source, points: Array, way: Array) -> tuple[Array, Array, Array]:
    """Return how far along rays (N, 3) a rectangle's plane is (N,), and its coordinates there, within +-1."""
    assert source.over is not None
    against = way @ source.normal
    against = np.where(np.abs(against) < 1e-6, 1e-6, against)
    reach = ((source.centre - points) @ source.normal) / against
    met = points + reach[:, None] * way - source.centre
    u, v = (met @ axis / (axis @ axis) for axis in (source.across, source.over))
    return np.where((np.abs(u) < 1) & (np.abs(v) < 1) & (reach > 0), reach, np.inf), u, v


def _through_glass(room: PanoramaRoom, points: Array, direction: Array) -> NDArray[np.bool_]:
    """Return from which points (N, 3) a direction leads out through a pane without a veil."""
    through = np.zeros(len(points), bool)
    for source in room.sources:
        if source.bars and source.veil == 0 and direction @ source.normal < -1e-3:
            through |= np.isfinite(_met(source, points, np.broadcast_to(direction, points.shape))[0])
    return through


def _nooks(room: PanoramaRoom, points: Array, owner: NDArray[np.int_], side: NDArray[np.int_]) -> Array:
    """Return the share (N,) of the room's light that reaches its corners and the space below furniture."""
    shade = np.ones(len(points))
    for axis in range(3):
        for gap in (points[:, axis] + room.reach[2 * axis + 1], room.reach[2 * axis] - points[:, axis]):
            shade *= 1 - 0.35 * np.exp(-gap / 0.3) * (side // 2 != axis)
    shade[(owner >= 0) & (side == FLOOR)] *= 0.3
    return shade


def _show(
    room: PanoramaRoom, source: Source, image: Array, way: Array, distance: Array, solid_angle: Array
) -> None:
    """Paint a source into the image (N, 3), with the flux that it has, however small."""
    reach = float(np.linalg.norm(source.centre))
    if source.over is not None:
        found, u, v = _met(source, np.zeros(3), way)
        where = np.nonzero(found < distance + 0.03)[0]
        if source.centre @ source.normal > 0:  # a lamp from behind
            image[where] = 0.01 * source.radiance
            return
        if source.bars is not None:
            image[where] = _view(room, source, u[where], v[where], way[where])
            return
        if len(where):
            image[where] = source.radiance
            return
    if visible_points(np.zeros((1, 3), np.float32), source.centre + 0.02 * source.normal, room.boxes)[0]:
        flux = source.area * source.radiance * max(float(-source.centre @ source.normal), 0) / reach**3
        angle = float(np.linalg.norm(source.across)) / reach if source.over is None else 0.0
        _spot(image, way, solid_angle, source.centre / reach, angle, flux)


def _view(room: PanoramaRoom, window: Source, u: Array, v: Array, way: Array) -> Array:
    """Return the radiance (N, 3) of a window's pane: sky over a skyline, darker ground, bars and a veil."""
    assert window.bars is not None and window.over is not None
    azimuth = np.arctan2(way[:, 1], way[:, 0])
    block = np.floor(azimuth * 6).astype(np.int64)
    roofs = 0.35 * hash_numbers(block, np.full_like(block, room.skyline)) ** 2
    trees = 0.1 + 0.12 * np.sin(9 * azimuth + room.skyline % 7)
    sky = 0.95 + 0.1 * np.sin(5 * azimuth + 14 * way[:, 2] + room.skyline % 5) + 0.2 * way[:, 2]
    ground = 0.25 + 0.25 * hash_numbers(block, np.full_like(block, room.skyline + 1))
    outside = np.where(way[:, 2] > (roofs if room.skyline % 3 == 0 else trees), sky, ground)
    view = (1 - window.veil) * outside + window.veil * 0.6
    for place, panes, half in zip((u, v), window.bars, (window.across, window.over), strict=True):
        pane = (place + 1) / 2 * panes
        view[np.abs(pane - np.round(pane)) * 2 * np.linalg.norm(half) / panes < 0.03] = 0.05
    return view[:, None] * window.radiance


def _spot(image: Array, way: Array, solid_angle: Array, direction: Array, angle: float, flux: Array) -> None:
    """Paint a disc of an angular radius, no smaller than a pixel, that holds the flux (3,)."""
    cosines = way @ np.asarray(direction, np.float32)
    height = np.sqrt(len(way) / 2)
    shown = cosines > min(np.cos(max(angle, np.pi / height)), cosines.max() - 1e-6)
    image[shown] = flux / solid_angle[shown].sum()
