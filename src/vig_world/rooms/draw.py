"""Draws a furnished room."""

import numpy as np
from scipy import ndimage

from vig_world.assets.joinery import by_finish
from vig_world.assets.materials import plain, slot_material
from vig_world.assets.shapes import move_mesh, scale_mesh
from vig_world.assets.things import Furniture, Material
from vig_world.rooms import fittings, openings
from vig_world.rooms.kinds import KINDS
from vig_world.rooms.layout import Layout
from vig_world.rooms.measures import CELL, floor_supports, measure_support, occupied_cells
from vig_world.rooms.plan import HEADROOM, Body, Make, Plan
from vig_world.rooms.shell import Opening, Wall, shell, walls_of

Array = np.ndarray


def draw_layout(rng: np.random.Generator, furniture: Make) -> Layout:
    """Return a furnished room drawn from a generator.

    Args:
        furniture: Gives a piece of a family of the packaged catalogue from a generator of its own. It stands
            on z = 0, centred, with its front to -Y. Pieces that do not fit are left out.
    """

    def make(family: str, own: np.random.Generator) -> Furniture:
        return fittings.wall_shelf(own) if family == "wall_shelf" else furniture(family, own)

    name = str(rng.choice(list(KINDS), p=[0.2, 0.16, 0.18, 0.1, 0.1, 0.06, 0.08, 0.12]))
    attempts = 8
    for attempt in range(attempts):
        layout = _attempt(name, np.random.default_rng(rng.integers(2**63)), make, attempt == attempts - 1)
        if layout is not None:
            return layout
    raise AssertionError("the last attempt always gives a layout")


def _attempt(name: str, rng: np.random.Generator, make: Make, always: bool) -> Layout | None:
    """Return one attempt; None if the room is not walkable."""
    kind = KINDS[name]
    outline = _outline(rng, kind.sides)
    height = float(rng.uniform(2.4, 3.0))
    walls = walls_of(outline)
    doors, windows = _openings(rng, walls, kind.sill, height)
    plan = Plan(rng, outline, height, make)
    paint = plain(np.array([0.8, 0.79, 0.75]) * rng.uniform(0.85, 1.0), "wood", 0.5)
    if rng.uniform() < 0.25:
        paint = slot_material("wood", rng)
    depth = float(rng.uniform(0.16, 0.28))
    plan.parts += shell(rng, outline, height, doors + windows, depth, paint)
    for opening in doors:
        wall = walls[opening.wall]
        plan.parts += [(wall.place_mesh(mesh), stuff) for mesh, stuff in openings.door(rng, opening, paint)]
        plan.kept.append(_zone(wall, opening.left - 0.08, opening.right + 0.08, 0.9, 0.0, HEADROOM))
    curtained = name not in ("kitchen", "cafe", "living kitchen") and rng.uniform() < 0.7
    for opening in windows:
        _add_window(plan, opening, depth, paint, curtained)
    kind.furnish(plan)
    _hang(plan)
    rugs = _lay_rugs(plan, name)
    _light(plan, name)
    supports = [measure_support(plan, support) for support in plan.supports]
    supports = [s for s in supports if s.clearance > 0.1]
    supports += floor_supports(plan, rugs + [_zone(walls[o.wall], o.left, o.right, 0.5, 0, 1) for o in doors])
    if not always and not (len(plan.placed) > 2 and walkable(plan)):
        return None
    solids = [np.vstack([b.corners, [b.low, b.high]]) for b in plan.bodies]
    return Layout(name, tuple(by_finish(plan.parts)), tuple(supports), outline, height, np.array(solids))


def _outline(rng: np.random.Generator, sides: tuple[tuple[float, float], tuple[float, float]]) -> Array:
    """Return a box, or an L if it is large enough, turned any way, centred."""
    wide, deep = rng.uniform(sides[0], sides[1])
    if rng.uniform() < 0.35 and min(wide, deep) > 3.2:
        a, b = wide * rng.uniform(0.25, 0.42), deep * rng.uniform(0.25, 0.42)
        corners = np.array(
            [[0, 0], [wide, 0], [wide, deep - b], [wide - a, deep - b], [wide - a, deep], [0, deep]]
        )
    else:
        corners = np.array([[0, 0], [wide, 0], [wide, deep], [0, deep]])
    corners = corners - [wide / 2, deep / 2]
    for _ in range(int(rng.integers(4))):
        corners = np.stack([-corners[:, 1], corners[:, 0]], -1)
    return corners + 0.0


def _openings(
    rng: np.random.Generator, walls: list[Wall], sill: tuple[float, float], height: float
) -> tuple[list[Opening], list[Opening]]:
    """Return one or two doors near corners, and one to three windows in other walls or beside them."""
    order = rng.permutation(len(walls)).tolist()
    doors: list[Opening] = []
    for number in order[: 1 if rng.uniform() < 0.7 else 2]:
        wide, high = float(rng.uniform(0.78, 0.92)), float(rng.uniform(1.98, 2.1))
        room = walls[number].length - wide - 0.4
        if room <= 0:
            continue
        left = 0.2 + room * (float(rng.choice([0.0, 1.0])) if rng.uniform() < 0.6 else float(rng.uniform()))
        doors.append(Opening("door", number, left, left + wide, 0.0, high))
    windows: list[Opening] = []
    low, high = float(rng.uniform(*sill)), float(rng.uniform(2.05, min(2.3, height - 0.15)))
    wanted = int(rng.integers(1, 4))
    for number in order[::-1]:
        taken = [o for o in doors if o.wall == number]
        wall = walls[number]
        if taken or wall.length < 1.6 or len(windows) == wanted:
            continue
        wide = float(rng.uniform(0.7, min(2.2, wall.length - 0.8)))
        left = float(rng.uniform(0.4, wall.length - wide - 0.4))
        windows.append(Opening("window", number, left, left + wide, low, high))
    return doors, windows


def _zone(wall: Wall, left: float, right: float, deep: float, low: float, high: float) -> Body:
    """Return the space before a stretch of a wall, `deep` metres into the room."""
    return Body.of((left, 0.0, right, deep, low, high), (*wall.start, 0.0), wall.angle)


def _add_window(plan: Plan, opening: Opening, depth: float, paint: Material, curtained: bool) -> None:
    """Add a window with its curtains, perhaps a radiator, and room before it."""
    rng, wall = plan.rng, plan.walls[opening.wall]
    left, right = openings.reach(opening, curtained)
    fits = left > 0.02 and right < wall.length - 0.02
    parts, sill = openings.window(rng, opening, depth, paint, curtained and fits)
    plan.parts += [(wall.place_mesh(mesh), stuff) for mesh, stuff in parts]
    plan.supports.append(sill.move((*wall.start, 0.0), wall.angle))
    # Furniture before a window may reach .3 m above its sill.
    plan.kept.append(_zone(wall, opening.left, opening.right, 0.35, opening.low + 0.3, opening.high))
    sill_low = opening.low - openings.SILL
    plan.bodies.append(
        _zone(wall, opening.left - 0.03, opening.right + 0.03, openings.NOSE, sill_low, opening.low)
    )
    if curtained and fits:
        rod = opening.high + 0.09
        plan.bodies.append(_zone(wall, left, right, openings.CURTAIN, rod, rod + 0.04))
        for a, b in ((left, opening.left + 0.1), (opening.right - 0.1, right)):
            box = (a, openings.NOSE, b, openings.CURTAIN, 0.02, rod)
            plan.bodies.append(Body.of(box, (*wall.start, 0.0), wall.angle))
    radiator = 0.1  # metres that a radiator takes up from the wall
    if opening.low < 1.0 and rng.uniform() < 0.4:
        wide = min(opening.right - opening.left, float(rng.uniform(0.6, 1.2)))
        high = min(0.7, opening.low - 0.1)
        a = (opening.left + opening.right - wide) / 2
        body = _zone(wall, a, a + wide, radiator, 0.0, high)
        if high > 0.35 and plan.free([body]):
            piece = plan.draw("radiator")
            size = np.array([wide, radiator - 0.005, high]) / (piece.high - piece.low)
            middle = (a + wide / 2, radiator / 2, 0.0)
            for mesh, stuff in piece.furniture.parts:
                plan.parts.append((wall.place_mesh(move_mesh(scale_mesh(mesh, size), middle, np.pi)), stuff))
            plan.bodies.append(body)


def _hang(plan: Plan) -> None:
    """Hang pictures where the walls are free."""
    rng = plan.rng
    for _ in range(int(rng.integers(1, 5))):
        wall = plan.walls[int(rng.integers(len(plan.walls)))]
        wide, high = rng.uniform([0.25, 0.3], [0.8, 0.7]).tolist()
        if wall.length < wide + 0.5:
            continue
        along, middle = (
            float(rng.uniform(0.25 + wide / 2, wall.length - 0.25 - wide / 2)),
            float(rng.uniform(1.4, 1.65)),
        )
        body = _zone(wall, along - wide / 2, along + wide / 2, 0.03, middle - high / 2, middle + high / 2)
        wider = _zone(wall, along - wide / 2 - 0.05, along + wide / 2 + 0.05, 0.1, body.low - 0.05, body.high)
        if not plan.free([wider]):
            continue
        parts = [(move_mesh(m, (along, 0, middle)), stuff) for m, stuff in fittings.picture(rng, wide, high)]
        plan.parts += [(wall.place_mesh(mesh), stuff) for mesh, stuff in parts]
        plan.bodies.append(body)


def _lay_rugs(plan: Plan, name: str) -> list[Body]:
    """Lay a rug under a low table, by a bed or in the middle; return its body, if any."""
    rng = plan.rng
    if rng.uniform() > {"kitchen": 0.1, "cafe": 0.15, "living kitchen": 0.6}.get(name, 0.65):
        return []
    low_tables = [
        p for p in plan.placed if p.piece.furniture.family in ("coffee_table", "dining_table", "bed")
    ]
    half = rng.uniform([0.6, 0.5], [1.2, 0.85])
    turn, at = 0.0, np.array([0.0, 0.0])
    if low_tables:
        chosen = low_tables[int(rng.integers(len(low_tables)))]
        low, high = chosen.piece.low, chosen.piece.high
        half, turn = np.maximum(half, (high - low)[:2] / 2 + 0.25), chosen.turn
        at = np.array(chosen.offset[:2])
    for shrink in (1.0, 0.8, 0.6):
        x, y = (half * shrink).tolist()
        body = Body.of((-x, -y, x, y, 0.0, fittings.RUG), (float(at[0]), float(at[1]), 0.0), turn)
        if plan.indoors(body):
            plan.parts += [(move_mesh(m, (*at, 0.0), turn), stuff) for m, stuff in fittings.rug(rng, (x, y))]
            return [body]
    return []


def _light(plan: Plan, name: str) -> None:
    """Hang lamps over tables, and on the ceiling elsewhere."""
    rng, height = plan.rng, plan.height
    tables = [
        p for p in plan.placed if p.piece.furniture.family in ("dining_table", "cafe_table", "kitchen_island")
    ]
    for table in tables:
        if rng.uniform() < 0.6:
            _hang_lamp(plan, "pendant", table.offset[:2], height - float(rng.uniform(1.42, 1.75)))
    spots = [(0.0, 0.0)] if not tables or rng.uniform() < 0.5 else []
    for x, y in spots:
        _hang_lamp(plan, "ceiling_lamp", (x, y))


def _hang_lamp(plan: Plan, family: str, at: tuple[float, float], drop: float | None = None) -> None:
    """Hang a lamp below the ceiling where nothing is in its way, `drop` metres high or as its model is."""
    piece = plan.draw(family)
    x, y, z = (piece.high - piece.low).tolist()
    stretch = 1.0 if drop is None else drop / z
    z *= stretch
    body = Body.of((-x / 2, -y / 2, x / 2, y / 2, plan.height - z, plan.height), (*at, 0.0))
    # A lamp ends 1.35 m above the floor or higher.
    if plan.height - z > 1.35 and plan.free([body]):
        place = (*at, plan.height - z)
        plan.parts += [
            (move_mesh(scale_mesh(mesh, (1, 1, stretch)), place), stuff)
            for mesh, stuff in piece.furniture.parts
        ]
        plan.bodies.append(body)


def walkable(plan: Plan) -> bool:
    """Return whether from the first door a person reaches most of the floor wide enough to stand on."""
    taken, _ = occupied_cells(plan, [b for b in plan.bodies if b.low < HEADROOM and b.high > 0.05])
    wide = round(0.5 / CELL)  # half a metre: what a person needs to walk
    stand = ndimage.binary_opening(np.pad(~taken, wide), np.ones((wide, wide)))
    labels, count = ndimage.label(stand)
    if count == 0:
        return False
    sizes = np.bincount(labels.ravel())[1:]
    return bool(sizes.max() > 0.85 * sizes.sum())
