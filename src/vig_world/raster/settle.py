"""Moves items before an object until they hide a share of it, in one native call."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vig_native import engine
from vig_world.raster.items import Item
from vig_world.raster.view import View


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
    """Return the offset where items hide `level` of an object, with their depth there, as `depth` gives it.

    Args:
        items: The items at offset 0.
        view: The camera.
        motion: (3,) metres by which they move per unit of offset.
        ends: Least and greatest offset: there they hide most, and little or nothing.
        pixels: The object's.
        level: Share of its pixels that is to be hidden.
        tolerance: Largest difference from `level`.

    Returns:
        Offset and depth (H, W), or why there is none: "not out of the way" (too much is hidden at the
        greatest), "too small" (too little at the least), "no offset" (the search ended).
    """
    natives, own = [item.native for item in items], (pixels.indices, pixels.depths, pixels.hidden)
    reason, offset, far = engine.settle(natives, view.native, motion, ends, *own, level, tolerance)
    return reason or (offset, far)
