"""Measures a finished plan: the space above and behind its supports, and where its floor is free."""

from dataclasses import replace

import numpy as np

from vig_world.assets.own.supports import largest_rectangle
from vig_world.assets.things import Support
from vig_world.rooms.plan import Body, Plan

Array = np.ndarray
CELL = 0.1
NEAR = 0.6  # a side is open where the next thing is farther than this, metres: a person fits in
MIN_WIDTH = 0.5  # the least width, metres, of a free rectangle of the floor that counts as a support


def _rectangle(support: Support) -> Body:
    x, y = support.half
    return Body.of((-x, -y, x, y, 0.0, 0.3), support.centre, support.turn)


def measure_support(plan: Plan, support: Support) -> Support:
    """Return the support with `clearance` to things above it, and `behind` to things behind it.

    It ends before a narrow thing above its back edge, such as a window sill.
    """
    z = support.centre[2]
    above = [b for b in plan.bodies if b.low > z + 0.005]
    hanging = _under(above, support)
    for trim in (0.03, 0.06):  # metres along the back edge
        shorter = _trim_support(support, trim)
        clear = _under(above, shorter)
        if clear > hanging + 0.2 and shorter.half[1] > 0.06:
            support, hanging = shorter, clear
    behind = support.behind
    if behind == float("inf"):
        behind = behind_of(plan, support)
    return replace(support, clearance=min(support.clearance, hanging), behind=behind)


def _under(bodies: list[Body], support: Support) -> float:
    """Return the free height over a support under bodies that are all above it."""
    own = replace(_rectangle(support), low=-np.inf, high=np.inf)
    lows = [b.low for b in bodies if own.meets(b)]
    return min(lows, default=float("inf")) - support.centre[2] - 0.005


def _trim_support(support: Support, depth: float) -> Support:
    """Return the support without a strip along its +y edge."""
    x, y, z = support.centre
    back = depth / 2
    centre = (x + back * float(np.sin(support.turn)), y - back * float(np.cos(support.turn)), z)
    behind = support.behind + depth
    return replace(support, centre=centre, half=(support.half[0], support.half[1] - back), behind=behind)


def behind_of(plan: Plan, support: Support) -> float:
    """Return metres from the rectangle's +y edge to the wall or thing behind it, inf if farther than NEAR."""
    z = support.centre[2]
    others = [b for b in plan.bodies if b.low < z + 0.2 and b.high > z + 0.08]
    own = replace(_rectangle(support), low=z + 0.09, high=z + 0.1)
    rings = [plan.outline] + [b.corners for b in others if not own.meets(b)]
    a = np.concatenate(rings)
    b = np.concatenate([np.roll(ring, -1, 0) for ring in rings])
    c, s = np.cos(support.turn), np.sin(support.turn)
    ahead = np.array([-s, c])
    best = float("inf")
    for share in (-0.8, 0.0, 0.8):
        start = (
            np.array(support.centre[:2])
            + share * support.half[0] * np.array([c, s])
            + support.half[1] * ahead
        )
        edge, away = b - a, a - start
        cross = ahead[0] * edge[:, 1] - ahead[1] * edge[:, 0]
        usable = np.abs(cross) > 1e-9
        cross = np.where(usable, cross, 1.0)
        t = (away[:, 0] * edge[:, 1] - away[:, 1] * edge[:, 0]) / cross
        u = (away[:, 0] * ahead[1] - away[:, 1] * ahead[0]) / cross
        hits = t[usable & (u >= 0) & (u <= 1) & (t > -0.02)]
        best = min([best, *np.maximum(hits, 0.0).tolist()])
    return best if best < NEAR else float("inf")


def occupied_cells(plan: Plan, bodies: list[Body]) -> tuple[Array, Array]:
    """Return which cells (R, C) of the floor's bounding box are not free, and its lower corner (2,).

    A cell counts if any of it is in a body's bounding rectangle, or outdoors.
    """
    low, high = plan.outline.min(0), plan.outline.max(0)
    columns, rows = np.floor((high - low) / CELL + 1e-6).astype(int)
    taken = np.zeros((rows, columns), bool)
    for body in [*bodies, plan.notch] if plan.notch else bodies:
        x0, y0, x1, y1 = body.bounds
        a, b = np.floor((np.array([x0, y0]) - low) / CELL + 1e-6).astype(int).clip(0)
        c, d = np.ceil((np.array([x1, y1]) - low) / CELL - 1e-6).astype(int).clip(0)
        taken[b:d, a:c] = True
    return taken, low


def floor_supports(plan: Plan, avoid: list[Body], most: int = 4) -> list[Support]:
    """Return free rectangles of the bare floor, the larger first; their +y points to the nearest thing."""
    taken, low = occupied_cells(plan, [b for b in plan.bodies if b.low < 1.0] + avoid)
    result: list[Support] = []
    free = ~taken
    skirted = 0.05  # metres of floor along its edges that are left out: skirting, window sills, door frames
    while len(result) < most:
        row, row_end, column, column_end = largest_rectangle(free)
        size = CELL * np.array([column_end - column, row_end - row])
        if min(size) - 2 * skirted < MIN_WIDTH - 1e-6:
            break
        free[row:row_end, column:column_end] = False
        start = low + CELL * np.array([column, row])
        result.append(_facing_support(plan, start + size / 2, size / 2 - skirted))
    return result


def _facing_support(plan: Plan, centre: Array, half: Array, z: float = 0.0) -> Support:
    """Return a level rectangle whose +y points to the nearest thing that closes a side of it."""
    best: Support | None = None
    for quarter in range(4):
        own = (float(half[quarter % 2]), float(half[1 - quarter % 2]))
        support = Support("floor", (float(centre[0]), float(centre[1]), z), own, quarter * np.pi / 2)
        support = measure_support(plan, support)
        if best is None or support.behind < best.behind:
            best = support
    assert best is not None
    return best
