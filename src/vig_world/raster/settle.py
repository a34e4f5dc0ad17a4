"""Moves items before an object until they hide a share of it, in one native call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vig_world.raster.draw import depths_of, scene_of
from vig_world.raster.items import Item
from vig_world.raster.native import workspace
from vig_world.raster.records import NO_OFFSET, NOT_OUT_OF_THE_WAY, SEARCH, TOO_SMALL, address
from vig_world.raster.view import View

REASONS = {NOT_OUT_OF_THE_WAY: "not out of the way", TOO_SMALL: "too small", NO_OFFSET: "no offset"}
"""Why there is no offset: too much is hidden at the greatest, too little at the least, the search ended."""


@dataclass(frozen=True)
class ObjectPixels:
    """The N pixels of a view that show an object.

    Attributes:
        indices: (N,) int64, flat.
        depths: (N,) float32 metres, the object's.
        hidden: (N,) bool, whether something is before it already.
    """

    indices: np.ndarray
    depths: np.ndarray
    hidden: np.ndarray


def settle(
    items: Sequence[Item],
    view: View,
    motion: np.ndarray,
    ends: tuple[float, float],
    pixels: ObjectPixels,
    level: float,
    tolerance: float,
) -> tuple[float, np.ndarray] | str:
    """The offset at which items hide `level` of an object, with their depth there, as `depth` gives it.

    Args:
        items: Where they are at offset 0.
        view: The camera.
        motion: (3,) metres by which they move per unit of offset.
        ends: Least and greatest offset: there they hide most, and little or nothing.
        pixels: The object's.
        level: Share of its pixels that is to be hidden.
        tolerance: By which that may differ.

    Returns:
        Offset and depth (H, W), or one of `REASONS`.
    """
    scene, table = scene_of(items, view)
    starts = np.array([item.translation for item in items])
    record = workspace.record("search", SEARCH)
    addresses = map(address, (scene, starts, pixels.indices, pixels.depths, pixels.hidden))
    record[0] = (*addresses, len(pixels.indices), 0, motion, *ends, level, tolerance, 0.0)
    workspace.launch("settle", "search")
    del table  # the search moved the items in it
    outcome, offset = int(record["outcome"][0]), float(record["offset"][0])
    return REASONS[outcome] if outcome in REASONS else (offset, depths_of(view))
