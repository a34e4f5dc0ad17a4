"""The families of props: each maker registers itself, with the zones in which such props belong."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from vig_world.assets.props.material import Prop

Maker = Callable[[np.random.Generator], Prop]

FAMILIES: dict[str, Maker] = {}
"""Every family of props by name: a function from a generator to a Prop."""

ZONES: dict[str, tuple[str, ...]] = {}
"""The zones in which each family of props belongs."""

ZONE_NAMES = (
    "cooking", "dining", "drinks", "desk", "reading", "display", "storage", "bedside", "washing", "floor",
)  # fmt: skip
"""The functional zones of rooms."""


ALIKE = {"mug": {"cup_saucer"}, "cup": {"mug", "teacups"}, "car": {"vehicle"}}
"""Families of props, by a word of a class's name, that look like it under another name."""


def is_of_class(family: str, name: str) -> bool:
    """Whether a family of props, such as `mug`, is named like a class or known to be alike."""
    words = {word.removesuffix("s") for word in re.split(r"[^a-z]+", name.lower())} - {""}
    return bool({word.removesuffix("s") for word in family.lower().split("_")} & words) or any(
        family in ALIKE.get(word, ()) for word in words
    )


def family(*zones: str) -> Callable[[Maker], Maker]:
    """Register the decorated function as the maker of a family, named like the function.

    Args:
        zones: Where such props belong: some of `ZONE_NAMES`.
    """
    if not zones or not set(zones) <= set(ZONE_NAMES):
        raise ValueError(f"zones must be some of {', '.join(ZONE_NAMES)}; got {zones}.")

    def register(make: Maker) -> Maker:
        FAMILIES[make.__name__] = make
        ZONES[make.__name__] = zones
        return make

    return register
