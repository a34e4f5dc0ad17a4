"""The kinds of rooms, and how each is furnished."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vig_world.rooms.plan import PlacedFurniture, Plan

FULL = 8000  # faces of a room to which nothing more is added


@dataclass(frozen=True)
class RoomKind:
    """A kind of room: the least and greatest sides in metres, its windows' sills, how it is furnished."""

    sides: tuple[tuple[float, float], tuple[float, float]]
    sill: tuple[float, float]
    furnish: Callable[[Plan], None]


def _longest(plan: Plan) -> list[int]:
    return np.argsort([-wall.length for wall in plan.walls]).tolist()


def _dine(plan: Plan, family: str = "dining_table") -> None:
    table = plan.amid(family, 0.62) or plan.amid(family, 0.35) or plan.amid("cafe_table", 0.5)
    if table is not None:
        plan.around(table, "chair", int(plan.rng.integers(2, 7)))


def _sit(plan: Plan, walls: list[int] | None = None) -> PlacedFurniture | None:
    """Return a sofa with its coffee table, armchairs, side table and lamp."""
    rng = plan.rng
    sofa = plan.against("sofa", 0.95, walls, tries=3) or plan.against("armchair", 0.6, walls)
    if sofa is None:
        return None
    side = int(rng.choice([-1, 1]))
    if rng.uniform() < 0.7:
        plan.beside(sofa, "side_table", side, 0.05)
    if rng.uniform() < 0.7:
        plan.beside(sofa, "floor_lamp", -side, 0.05, 0.0)
    table = plan.before(sofa, "coffee_table", float(rng.uniform(0.3, 0.42)))
    if table is not None:
        for aside in (-0.5, 0.5):
            if rng.uniform() < 0.5:
                plan.before(table, "armchair", float(rng.uniform(0.35, 0.6)), True, aside * 1.3, (sofa,))
    return sofa


def _cook(plan: Plan) -> None:
    rng = plan.rng
    walls = _longest(plan)[:4]
    first = plan.against("sink_counter", 0.9, walls, snug=True, tries=4)
    runs = walls if first is None else [first.wall, walls[int(rng.integers(len(walls)))]]
    for family in ("hob_counter", *["kitchen_counter"] * int(rng.integers(3, 7))):
        plan.against(family, 0.9, runs, snug=True)
    plan.against("refrigerator", 0.7, runs, snug=True)
    lift = float(rng.uniform(1.38, 1.5))
    if first is not None:
        for _ in range(2):
            if rng.uniform() < 0.75:
                plan.against("wall_cupboard", 0.0, runs, lift, True, gap=0.0)
            else:
                plan.against("wall_shelf", 0.0, runs, lift, gap=0.0)


def _some(plan: Plan, front: float = 0.6, **expected: float) -> list[PlacedFurniture]:
    """Stand pieces against walls while the room is not too full, and return them: of each family about
    `expected`, in the mean.
    """
    result: list[PlacedFurniture] = []
    for family, number in expected.items():
        for _ in range(int(number + plan.rng.uniform())):
            if sum(len(mesh.faces) for mesh, _ in plan.parts) > FULL:
                return result
            spot = plan.against(family, front)
            result += [spot] if spot is not None else []
    return result


def _shelf(plan: Plan, expected: float, walls: list[int] | None = None, at: float | None = None) -> None:
    """Hang shelves."""
    for _ in range(int(expected + plan.rng.uniform())):
        plan.against("wall_shelf", 0.0, walls, float(plan.rng.uniform(1.3, 1.5)), at=at, gap=0.0)


def kitchen(plan: Plan) -> None:
    """Place counters along one or two walls, and an island or a table."""
    _cook(plan)
    if plan.rng.uniform() < 0.4:
        island = plan.amid("kitchen_island", 0.85)
        if island is not None:
            low, high = island.piece.low, island.piece.high
            for x in (-0.25, 0.25):
                at = island.point(x * float(high[0] - low[0]), float(high[1]) + 0.25)
                plan.put(PlacedFurniture(plan.draw("bar_stool"), (*at, 0.0), island.turn))
    _dine(plan, "dining_table" if plan.rng.uniform() < 0.6 else "cafe_table")
    _some(plan, sideboard=0.8, stool=0.6, potted_tree=0.4)
    _shelf(plan, 0.7)


def dining_room(plan: Plan) -> None:
    """Place a table with its chairs, sideboards."""
    _dine(plan)
    _some(plan, 0.6, sideboard=1.6, fireplace=0.4, cafe_table=0.5, bench=0.5)
    _some(plan, 0.4, chair=0.8, bookshelf=0.6, potted_tree=0.6, floor_lamp=0.3)
    _shelf(plan, 0.4)


def living_room(plan: Plan) -> None:
    """Place a sofa with its tables, shelves, a hearth."""
    _sit(plan)
    _some(plan, 0.6, fireplace=0.5, media_bench=0.8, bookshelf=1.3, sideboard=1.0, armchair=0.8, bench=0.4)
    _some(plan, 0.5, side_table=1.0, potted_tree=0.8)
    _shelf(plan, 0.7)


def bedroom(plan: Plan) -> None:
    """Place a bed with its tables, a wardrobe, a sideboard."""
    bed = plan.against("bed", 0.6, tries=4)
    if bed is not None:
        for side in (-1, 1):
            plan.beside(bed, "bedside_table", side, 0.06)
    for desk in _some(plan, wardrobe=1.0, sideboard=1.0, desk=0.6):
        if desk.piece.furniture.family == "desk":
            plan.before(desk, "chair", 0.04, True)
    _some(plan, 0.5, armchair=0.5, bench=0.4, bookshelf=0.4, floor_lamp=0.5, side_table=0.4, chair=0.4)
    _shelf(plan, 0.6)


def study(plan: Plan) -> None:
    """Place a desk with its chair, bookshelves, an armchair to read in."""
    desk = plan.against("desk", 0.0, tries=3)
    if desk is not None:
        plan.before(desk, "chair", float(plan.rng.uniform(0.02, 0.2)), True)
        _shelf(plan, 0.7, [desk.wall], desk.along)
    _some(plan, 0.6, bookshelf=1.8, armchair=0.8, side_table=0.7, sideboard=0.6)
    _some(plan, 0.5, floor_lamp=0.7, cafe_table=0.4, potted_tree=0.5, chair=0.4)
    _shelf(plan, 0.5)


def hall(plan: Plan) -> None:
    """Place sideboards, a bench, a wardrobe."""
    _some(plan, 0.7, sideboard=1.4, bench=1.0, wardrobe=0.7, bookshelf=0.6, stool=0.6)
    _some(plan, 0.5, potted_tree=0.6, cafe_table=0.4, chair=0.6)
    _shelf(plan, 1.3)


def cafe(plan: Plan) -> None:
    """Place small tables with two or three chairs each, a counter."""
    counter = plan.against("kitchen_counter", 0.9, _longest(plan)[:3], tries=3)
    if counter is not None:
        _shelf(plan, 1.0, [counter.wall], counter.along)
    for _ in range(int(plan.rng.integers(2, 5))):
        table = plan.amid("cafe_table", 0.55)
        if table is not None:
            family = "chair" if plan.rng.uniform() < 0.8 else "stool"
            plan.around(table, family, int(plan.rng.integers(2, 4)))
    _some(plan, 0.5, bench=1.2, sideboard=0.9, potted_tree=0.8, sofa=0.4)
    _shelf(plan, 0.5)


def living_kitchen(plan: Plan) -> None:
    """Place a kitchen, a table and a sofa in one room."""
    _cook(plan)
    _dine(plan)
    _sit(plan)
    _some(plan, 0.6, bookshelf=0.8, sideboard=0.8, potted_tree=0.6)
    _shelf(plan, 0.5)


KINDS: dict[str, RoomKind] = {
    "kitchen": RoomKind(((3.0, 3.5), (4.6, 5.6)), (1.08, 1.2), kitchen),
    "dining room": RoomKind(((3.2, 3.6), (4.6, 5.5)), (0.5, 0.95), dining_room),
    "living room": RoomKind(((3.6, 4.2), (5.2, 6.2)), (0.45, 0.95), living_room),
    "bedroom": RoomKind(((3.0, 3.5), (4.4, 5.2)), (0.55, 1.0), bedroom),
    "study": RoomKind(((2.6, 3.0), (4.0, 4.8)), (0.8, 1.1), study),
    "hall": RoomKind(((2.0, 3.0), (3.0, 5.0)), (0.8, 1.2), hall),
    "cafe": RoomKind(((3.6, 4.4), (5.4, 7.0)), (0.6, 1.1), cafe),
    "living kitchen": RoomKind(((4.2, 5.4), (5.6, 7.2)), (1.0, 1.15), living_kitchen),
}
"""Every kind of room by name."""
