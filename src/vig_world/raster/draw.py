"""Draws items on one thread: the whole picture, or depth alone for the search of a layout."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from vig.scene.light import COSINE_LOBE, Y1, linear_from_srgb
from vig_world.raster.items import HARMONICS, Item, Target, item_table
from vig_world.raster.native import workspace
from vig_world.raster.packed import PackedAsset
from vig_world.raster.picture import CANVAS, Picture
from vig_world.raster.records import BINS, DRAWN, FRAGMENT, SAMPLES, TASK, VISIBLE_PART, address
from vig_world.raster.shadows import cast_shadows
from vig_world.raster.view import View

SUN_SHARE = 0.2
"""Share of the light's first degree that shows in highlights."""
_MARGIN = 16
"""Samples that must follow an image's last, as they are drawn eight at a time."""


@dataclass(frozen=True)
class SurfaceSamples:
    """Where on the object's surface the N samples that show it lie; arrays are valid during the call only.

    Attributes:
        points: (3, N) float32, the world, metres.
        normals: (3, N) float32, interpolated, about unit length.
        irradiance: (N,) float32, over pi.
        vertices: (N,) int32, a vertex of each one's face.
    """

    points: np.ndarray
    normals: np.ndarray
    irradiance: np.ndarray
    vertices: np.ndarray


Colouring = Callable[[SurfaceSamples], np.ndarray]
"""Linear RGB (N, 3) of an object's samples."""


def depth(items: Sequence[Item], view: View) -> tuple[np.ndarray, np.ndarray]:
    """Depth (H, W) float32 metres along the optical axis, inf = nothing; and its item's owner, -1 = nothing.

    One sample in the middle of each pixel of the view's camera. owner is (H, W) int32.
    """
    _, _table = scene_of(items, view)
    workspace.launch("draw", "task")
    camera = view.camera
    ids = workspace.buffer("ids", 0, np.int32)[: camera.height * camera.width]
    return depths_of(view), ids.reshape(camera.height, camera.width).copy()


def scene_of(items: Sequence[Item], view: View) -> tuple[np.ndarray, np.ndarray]:
    """A TASK record (1,) prepared for drawing the depth of items, and the table that must outlive it."""
    table, _ = item_table(items, None)
    return _prepared(table, [item.packed for item in items], view, 1, keep=False), table


def depths_of(view: View) -> np.ndarray:
    """The depth (H, W) that was drawn last, in this view; see `depth`."""
    camera = view.camera
    q = workspace.buffer("q", 0, np.float32)[: camera.height * camera.width]
    with np.errstate(divide="ignore"):
        far: np.ndarray = 1 / q
    return far.reshape(camera.height, camera.width)


def draw(
    items: Sequence[Item],
    target: Target,
    view: View,
    light: ArrayLike,
    colouring: Colouring | None = None,
    normals: bool = False,
) -> Picture:
    """The picture of an object and items, as the view's camera sees them, in SH light (9,).

    The object shows its vertices' light without cast shadows or gloss. Items get the same light less shadows
    of object and props and the ambient occlusion of rooms, with a little gloss. Four samples a pixel,
    averaged in linear light clipped to [0, 1]. colouring: gives the object's colour in place of its vertices'
    light. normals: whether the picture is to have normals.
    """
    camera, coefficients = view.camera, np.asarray(light, np.float64)
    height, width = camera.height, camera.width
    pixels = height * width
    table, finishes = item_table(items, target)
    shadow = cast_shadows(table, coefficients, float(np.abs(target.vertices).max()))
    _rasterise(table, [target.packed, *(item.packed for item in items)], view, SAMPLES, keep=True)
    samples = pixels * SAMPLES**2
    record = workspace.record("task", TASK)
    encode, thresholds = srgb_tables()
    image, depths = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.float32)
    visible, support = np.empty((height, width), np.uint8), np.empty((height, width), np.uint8)
    linear = workspace.buffer("linear", 3 * pixels, np.float32)
    direction = coefficients[[3, 1, 2]]
    strength = float(np.linalg.norm(direction))
    for name, array in (
        ("fragments", workspace.buffer("fragments", samples, FRAGMENT)),
        ("sorted", workspace.buffer("sorted", samples, np.int32)),
        ("linear", linear),
        ("image", image),
        ("depth", depths),
        ("seen", visible),
        ("support", support),
        ("encode", encode),
        ("thresholds", thresholds),
        ("shadow", shadow),
    ):
        record[name] = address(array)
    record["irradiance"] = coefficients * COSINE_LOBE * HARMONICS
    record["radiance"] = coefficients * HARMONICS
    record["sun"][0, :3] = direction / max(strength, 1e-9)
    record["sun"][0, 3] = SUN_SHARE * strength / Y1 / (2 * np.pi)
    record["albedo"] = target.albedo if colouring is None else 0.0
    workspace.launch("collect", "task")
    workspace.launch("shade", "task")
    if colouring is not None:
        _add_colours(record, colouring)
    workspace.launch("encode", "task")
    directions = np.empty((height, width, 3), np.float32) if normals else None
    if directions is not None:
        record["normals"] = address(directions)
        workspace.launch("normals", "task")
    del finishes
    canvas = silhouette(target, view.widened(CANVAS))
    aside = (CANVAS - 1) // 2
    amodal = canvas[aside * height : (aside + 1) * height, aside * width : (aside + 1) * width]
    half = SAMPLES**2 / 2
    return Picture(
        image=image,
        depth=depths,
        amodal=amodal,
        visible=(visible >= half) & amodal,
        by_support=(support >= half) & amodal,
        canvas=canvas,
        light=coefficients.astype(np.float32),
        normals=directions,
    )


def _add_colours(record: np.ndarray, colouring: Colouring) -> None:
    """Add the object to the pixels of a TASK that was shaded without it."""
    size = int(record["width"][0]) * int(record["height"][0])
    surface = workspace.buffer("surface", 7 * size, np.float32)
    places = workspace.buffer("places", 2 * size, np.int32)
    record["surface"], record["places"] = address(surface), address(places)
    workspace.launch("surface", "task")
    count = int(record["surface_count"][0])
    rows = surface[: 7 * size].reshape(7, size)[:, :count]
    vertices = places[size : size + count]
    colours = colouring(SurfaceSamples(rows[:3], rows[3:6], rows[6], vertices))
    channels = np.ascontiguousarray(colours.T, np.float32)
    record["colours"] = address(channels)
    workspace.launch("spread", "task")


def silhouette(target: Target, view: View) -> np.ndarray:
    """The object alone (H, W) bool: where it covers at least half of a pixel's samples."""
    table, _ = item_table([], target)
    rows, columns = _window(target, view)
    height, width = rows.stop - rows.start, columns.stop - columns.start
    result = np.zeros((view.camera.height, view.camera.width), bool)
    if height > 0 and width > 0:
        camera = replace(
            view.camera,
            width=width,
            height=height,
            cx=view.camera.cx - columns.start,
            cy=view.camera.cy - rows.start,
        )
        part = View(camera, view.rotation, view.translation)
        ids = _rasterise(table, [target.packed], part, SAMPLES, keep=False)
        covered = (ids >= 0).view(np.uint8).reshape(height * SAMPLES, width * SAMPLES)
        offsets = range(SAMPLES)
        count = sum(covered[row::SAMPLES, column::SAMPLES] for row in offsets for column in offsets)
        result[rows, columns] = count >= SAMPLES**2 / 2
    return result


def _window(target: Target, view: View) -> tuple[slice, slice]:
    """Rows and columns of the frame that can show the object, all of it in front of the camera."""
    rotation, translation = view.rotation.astype(np.float32), view.translation.astype(np.float32)
    x, y, z = rotation @ target.vertices.T + translation[:, None]
    camera, less = view.camera, np.float32(view.camera.focal) / z
    ends = []
    for along, middle, size in ((y * less, camera.cy, camera.height), (x * less, camera.cx, camera.width)):
        first, last = float(along.min()) + middle, float(along.max()) + middle
        ends.append(slice(min(max(int(first) - 1, 0), size), min(max(int(last) + 2, 0), size)))
    return ends[0], ends[1]


def _rasterise(
    table: np.ndarray, assets: Sequence[PackedAsset], view: View, samples: int, keep: bool
) -> np.ndarray:
    """Owner, or face to be shaded, of each sample (N,): a view of the thread's buffer."""
    _prepared(table, assets, view, samples, keep)
    workspace.launch("draw", "task")
    return workspace.buffer("ids", 0, np.int32)[: view.camera.width * view.camera.height * samples**2]


def _prepared(
    table: np.ndarray, assets: Sequence[PackedAsset], view: View, samples: int, keep: bool
) -> np.ndarray:
    """The thread's TASK record (1,) with what drawing reads."""
    camera = view.camera
    width, height = camera.width * samples, camera.height * samples
    parts = sum(packed.counts[0] for packed in assets)
    vertices = max((packed.counts[1] for packed in assets), default=0)
    faces = sum(packed.counts[2] for packed in assets)
    size = width * height
    workspace.fields("task", TASK, DRAWN)[0] = (
        view.rotation,
        view.translation,
        address(table),
        len(table),
        width,
        height,
        camera.focal * samples,
        camera.cx * samples,
        camera.cy * samples,
        view.near,
        keep,
        workspace.place("q", size + _MARGIN, np.float32),
        workspace.place("ids", size + _MARGIN, np.int32),
        workspace.place("screen", 3 * vertices, np.float32),
        workspace.place("parts", 2 * parts, VISIBLE_PART),
        workspace.place("faces", 16 * 2 * faces if keep else 0, np.float32),
        workspace.place("clipped", 5 * 4 * faces, np.float32),
    )
    return workspace.record("task", TASK)


@functools.cache
def srgb_tables() -> tuple[np.ndarray, np.ndarray]:
    """The 8-bit sRGB level of each bin's lower edge (BINS + 1,), and the lower bound of each level (257,)."""
    thresholds = np.full(257, np.inf, np.float32)
    thresholds[:256] = linear_from_srgb((np.arange(256) - 0.5) / 255)
    thresholds[0] = 0
    edges = np.arange(BINS + 1, dtype=np.float32) / BINS
    return (np.searchsorted(thresholds, edges, side="right") - 1).astype(np.uint8), thresholds
