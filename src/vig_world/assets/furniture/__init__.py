"""Procedural furniture, each piece a pure function of a random generator."""

from collections.abc import Callable

import numpy as np

from vig_world.assets.furniture import beds, kitchen, seats, storage, tables
from vig_world.assets.furniture.furniture import Furniture, Support

FAMILIES: dict[str, Callable[[np.random.Generator], Furniture]] = {
    make.__name__: make
    for make in (
        tables.dining_table,
        tables.cafe_table,
        tables.coffee_table,
        tables.side_table,
        tables.desk,
        tables.console,
        tables.tea_trolley,
        kitchen.kitchen_counter,
        kitchen.sink_counter,
        kitchen.hob_counter,
        kitchen.kitchen_island,
        kitchen.wall_cupboard,
        kitchen.refrigerator,
        storage.bookshelf,
        storage.wall_shelf,
        storage.sideboard,
        storage.media_bench,
        storage.chest_of_drawers,
        storage.bedside_table,
        storage.wardrobe,
        storage.dresser,
        storage.fireplace,
        seats.chair,
        seats.stool,
        seats.bar_stool,
        seats.armchair,
        seats.sofa,
        seats.bench,
        seats.window_seat,
        beds.bed,
        beds.floor_lamp,
        beds.potted_tree,
    )
}
"""Every family of furniture by name: a function from a generator to a piece."""

__all__ = ["FAMILIES", "Furniture", "Support"]
