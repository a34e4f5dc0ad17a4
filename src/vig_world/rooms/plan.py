"""Places furniture in a room without collisions and with free aisles."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vig_world.assets.shapes import move_mesh
from vig_world.assets.things import Furniture, Support
from vig_world.rooms.shell import Part, Wall, walls_of

Array = np.ndarray
Make = Callable[[str, np.random.Generator], Furniture]
Box = tuple[float, float, float, float, float, float]  # x0, y0, x1, y1, z0, z1

TOUCH = 1e-4
HEADROOM = 1.9  # metres above the floor that stay free where people walk


@dataclass(frozen=True)
class Body:
    """A turned box: its corners (4, 2) in the ground plane, counter-clockwise, and lowest and highest z."""

    corners: Array
    low: float
    high: float
    bounds: tuple[float, float, float, float]
    square: bool

    @staticmethod
    def of(box: Box, offset: tuple[float, float, float] = (0.0, 0.0, 0.0), turn: float = 0.0) -> "Body":
        """Return a box turned about +Z and then shifted."""
        x0, y0, x1, y1, z0, z1 = box
        c, s = float(np.cos(turn)), float(np.sin(turn))
        flat = [
            (c * x - s * y + offset[0], s * x + c * y + offset[1])
            for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
        ]
        xs, ys = [p[0] for p in flat], [p[1] for p in flat]
        bounds = (min(xs), min(ys), max(xs), max(ys))
        return Body(np.array(flat), z0 + offset[2], z1 + offset[2], bounds, abs(c * s) < 1e-6)

    def meets(self, other: "Body") -> bool:
        """Return whether the two overlap."""
        if self.low >= other.high - TOUCH or other.low >= self.high - TOUCH:
            return False
        a, b = self.bounds, other.bounds
        if a[0] >= b[2] - TOUCH or b[0] >= a[2] - TOUCH or a[1] >= b[3] - TOUCH or b[1] >= a[3] - TOUCH:
            return False
        if self.square and other.square:
            return True
        for corners in (self.corners, other.corners):
            for axis in (corners[1] - corners[0], corners[3] - corners[0]):
                p, q = self.corners @ axis, other.corners @ axis
                slack = TOUCH * float(np.hypot(*axis))
                if p.min() >= q.max() - slack or q.min() >= p.max() - slack:
                    return False
        return True


def extent(piece: Furniture) -> tuple[Array, Array]:
    """Return the corners (3,), (3,) of a piece's bounding box."""
    low = np.min([mesh.vertices.min(0) for mesh, _ in piece.parts], axis=0).astype(float)
    high = np.max([mesh.vertices.max(0) for mesh, _ in piece.parts], axis=0).astype(float)
    return low, high


def sideways(support: Support) -> Support:
    """Return the same rectangle, reached from +x of its owner; its closed back is now a side."""
    across, deep = support.half
    return replace(support, half=(deep, across), turn=support.turn + np.pi / 2, behind=float("inf"))


def boxes_of(piece: Furniture) -> list[Box]:
    """Return boxes that hold a piece but leave free the space above its widest open support."""
    low, high = (bound.tolist() for bound in extent(piece))
    open_ = [s for s in piece.supports if s.clearance == float("inf") and abs(np.sin(2 * s.turn)) < 1e-6]
    whole: list[Box] = [(low[0], low[1], high[0], high[1], low[2], high[2])]
    if not open_:
        return whole
    crown = 0.03  # metres above a support that still belong to its carrier: rims, edges, a tap's foot
    level = max(open_, key=lambda s: s.half[0] * s.half[1]).centre[2] + crown
    if high[2] <= level:
        return whole
    tops = [s for s in open_ if abs(s.centre[2] + crown - level) < crown]
    x0 = min(s.centre[0] - s.half[0] for s in tops) + 0.01
    x1 = max(s.centre[0] + s.half[0] for s in tops) - 0.01
    y1 = max(s.centre[1] + s.half[1] for s in tops) - 0.01
    above = _above(piece, level)
    back, left, right = above[:, 1] > y1, above[:, 0] < x0, above[:, 0] > x1
    result: list[Box] = [(low[0], low[1], high[0], high[1], low[2], level)]
    for chosen in (back, left & ~back, right & ~back, ~(back | left | right)):
        if chosen.any():
            # a little wider, so that sheets have a side, too
            a, b = above[chosen].min(0).tolist(), (above[chosen].max(0) + 0.002).tolist()
            result.append((a[0], a[1], b[0], b[1], level, b[2]))
    return result


def _above(piece: Furniture, level: float) -> Array:
    """Return the corners (N, 3) of the part of a piece above a level."""
    points = []
    for mesh, _ in piece.parts:
        vertices = mesh.vertices
        points.append(vertices[vertices[:, 2] > level])
        edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        z = vertices[edges, 2]
        a, b = edges[(z[:, 0] <= level) & (z[:, 1] > level)].T
        share = (level - vertices[a, 2]) / (vertices[b, 2] - vertices[a, 2])
        points.append(vertices[a] + share[:, None] * (vertices[b] - vertices[a]))
    return np.concatenate(points)


@dataclass(frozen=True)
class FurniturePiece:
    """A piece of furniture with its bounding box's corners (3,), (3,) and the boxes that hold it."""

    furniture: Furniture
    low: Array
    high: Array
    boxes: list[Box]

    @staticmethod
    def of(furniture: Furniture) -> "FurniturePiece":
        """Return the piece with its measures taken."""
        return FurniturePiece(furniture, *extent(furniture), boxes_of(furniture))


@dataclass(frozen=True)
class PlacedFurniture:
    """A piece of furniture where it stands.

    Attributes:
        along: Its place on its wall, if it stands against one.
    """

    piece: FurniturePiece
    offset: tuple[float, float, float]
    turn: float
    wall: int = -1
    along: float = 0.0

    def point(self, x: float, y: float) -> tuple[float, float]:
        """Return a point of the piece's ground plane in the room."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        return float(c * x - s * y + self.offset[0]), float(s * x + c * y + self.offset[1])


class Plan:
    """A room being furnished.

    Args:
        outline: (N, 2) corners of the floor.
        make: Gives a piece of a family.
    """

    def __init__(self, rng: np.random.Generator, outline: Array, height: float, make: Make) -> None:
        self.rng, self.outline, self.height, self._make = rng, outline, height, make
        self.walls: list[Wall] = walls_of(outline)
        self.placed: list[PlacedFurniture] = []
        self.parts: list[Part] = []
        self.supports: list[Support] = []
        self.bodies: list[Body] = []
        self.kept: list[Body] = []
        self._aisles: dict[int, list[Body]] = {}
        self.notch = self._missing_corner()

    def _missing_corner(self) -> Body | None:
        """Return the part of the bounding box that an L-shaped floor lacks."""
        low, high = self.outline.min(0), self.outline.max(0)
        if len(self.outline) == 4:
            return None
        inner = next(k for k, wall in enumerate(self.walls) if not wall.corners[0])
        corner = self.outline[inner]
        nearest = np.where(self.outline.mean(0) < corner, high, low)
        a, b = np.minimum(corner, nearest), np.maximum(corner, nearest)
        return Body.of((float(a[0]), float(a[1]), float(b[0]), float(b[1]), -1.0, self.height + 1))

    def draw(self, family: str) -> FurniturePiece:
        """Return a new piece of a family."""
        return FurniturePiece.of(self._make(family, np.random.default_rng(self.rng.integers(2**63))))

    def indoors(self, body: Body) -> bool:
        """Return whether a body is inside the walls."""
        low, high = self.outline.min(0) - TOUCH, self.outline.max(0) + TOUCH
        x0, y0, x1, y1 = body.bounds
        if x0 < low[0] or y0 < low[1] or x1 > high[0] or y1 > high[1] or body.high > self.height:
            return False
        return self.notch is None or not body.meets(self.notch)

    def free(
        self, bodies: Sequence[Body], aisles: Sequence[Body] = (), shared: Sequence[PlacedFurniture] = ()
    ) -> bool:
        """Return whether bodies can stand here, with aisles before them that no other body is in.

        Args:
            shared: Pieces whose own aisles the bodies may block.
        """
        allowed = {id(aisle) for placed in shared for aisle in self._aisles.get(id(placed), ())}
        return (
            all(self.indoors(body) for body in (*bodies, *aisles))
            and not any(body.meets(other) for body in bodies for other in self.bodies)
            and not any(b.meets(other) for b in bodies for other in self.kept if id(other) not in allowed)
            and not any(aisle.meets(other) for aisle in aisles for other in self.bodies)
        )

    def put(
        self,
        placed: PlacedFurniture,
        front: float = 0.0,
        aside: bool = False,
        shared: Sequence[PlacedFurniture] = (),
    ) -> bool:
        """Place a piece there if it fits, with an aisle `front` metres deep before it.

        Args:
            aside: It stands close before something, so its supports are reached from its side.
            shared: Pieces whose aisles it may block.
        """
        low, high = placed.piece.low, placed.piece.high
        bodies = [Body.of(box, placed.offset, placed.turn) for box in placed.piece.boxes]
        aisles = []
        if front > 0:
            strip: Box = (float(low[0]), float(low[1]) - front, float(high[0]), float(low[1]), 0.0, HEADROOM)
            aisles = [Body.of(strip, (*placed.offset[:2], 0.0), placed.turn)]
        if not self.free(bodies, aisles, shared):
            return False
        self.bodies += bodies
        self.kept += aisles
        self._aisles[id(placed)] = aisles
        self.placed.append(placed)
        self.parts += [
            (move_mesh(mesh, placed.offset, placed.turn), stuff)
            for mesh, stuff in placed.piece.furniture.parts
        ]
        supports = placed.piece.furniture.supports
        if aside:
            supports = tuple(sideways(support) for support in supports)
        self.supports += [support.move(placed.offset, placed.turn) for support in supports]
        return True

    def _spots(self, number: int, half: float, snug: bool) -> list[float]:
        """Return places to try along a wall for a thing 2 `half` wide: beside others, in corners, or any."""
        wall = self.walls[number]
        first, last = half + 0.002, wall.length - half - 0.002
        if last < first:
            return []
        if not snug:
            return [*self.rng.uniform(first, last, 6).tolist(), (first + last) / 2]
        spots = [first, last, *self.rng.uniform(first, last, 2).tolist()]
        c, s = np.cos(wall.angle), np.sin(wall.angle)
        for body in self.bodies:
            away = body.corners - wall.start
            along, into = away @ [c, s], away @ [-s, c]
            if into.min() < 0.1 and into.max() > 0:
                spots += [along.min() - half - 0.002, along.max() + half + 0.002]
        return [float(spot) for spot in spots if first <= spot <= last]

    def against(
        self,
        family: str,
        front: float = 0.6,
        walls: Sequence[int] | None = None,
        lift: float = 0.0,
        snug: bool = False,
        at: float | None = None,
        tries: int = 2,
        gap: float = 0.02,
    ) -> PlacedFurniture | None:
        """Place (or at `lift` hang) a piece of a family with its back to a wall.

        Args:
            walls: Which walls may do, all if None, tried in random order.
            at: The place along the wall.
        """
        for _ in range(tries):
            piece = self.draw(family)
            low, high = piece.low, piece.high
            half, deep = float(high[0] - low[0]) / 2, float(high[1])
            choice = list(range(len(self.walls))) if walls is None else list(walls)
            for number in self.rng.permutation(choice).tolist():
                wall = self.walls[number]
                spots = self._spots(number, half, snug) if at is None else [at]
                for along in spots if snug else self.rng.permutation(spots).tolist():
                    x, y = wall.at(along, deep + gap).tolist()
                    spot = PlacedFurniture(piece, (x, y, lift), wall.angle + np.pi, number, along)
                    if self.put(spot, front):
                        return spot
        return None

    def beside(
        self, other: PlacedFurniture, family: str, side: int, space: float = 0.03, front: float = 0.4
    ) -> PlacedFurniture | None:
        """Place a piece against the same wall, on a side (-1, +1 along it) of one that stands there."""
        low, high = other.piece.low, other.piece.high
        piece = self.draw(family)
        a, b = piece.low, piece.high
        along = other.along + side * (float(high[0] - low[0] + b[0] - a[0]) / 2 + space)
        x, y = self.walls[other.wall].at(along, float(b[1]) + 0.02).tolist()
        spot = PlacedFurniture(piece, (x, y, 0.0), other.turn, other.wall, along)
        return spot if self.put(spot, front) else None

    def before(
        self,
        other: PlacedFurniture,
        family: str,
        distance: float,
        facing: bool = False,
        aside: float = 0.0,
        shared: Sequence[PlacedFurniture] = (),
    ) -> PlacedFurniture | None:
        """Place a piece in front of another, `distance` away and `aside` to a side.

        Args:
            facing: Whether it is turned to the other.
            shared: Further pieces whose aisles it may block.
        """
        piece = self.draw(family)
        deep = float(-piece.low[1] if facing else piece.high[1])
        x, y = other.point(aside, float(other.piece.low[1]) - distance - deep)
        spot = PlacedFurniture(piece, (x, y, 0.0), other.turn + (np.pi if facing else 0.0))
        return spot if self.put(spot, aside=facing and distance < 0.3, shared=(other, *shared)) else None

    def amid(self, family: str, margin: float, tries: int = 24) -> PlacedFurniture | None:
        """Place a piece freely in the room with `margin` metres of floor round it."""
        piece = self.draw(family)
        low, high = piece.low, piece.high
        corner, far = self.outline.min(0), self.outline.max(0)
        for _ in range(tries):
            turn = float(self.rng.integers(4)) * np.pi / 2
            x, y = self.rng.uniform(corner + 0.3, far - 0.3).tolist()
            ring: Box = (
                float(low[0]) - margin,
                float(low[1]) - margin,
                float(high[0]) + margin,
                float(high[1]) + margin,
                0.0,
                HEADROOM,
            )
            spot = PlacedFurniture(piece, (x, y, 0.0), turn)
            around = Body.of(ring, spot.offset, turn)
            if (
                self.indoors(around)
                and not any(around.meets(other) for other in self.bodies)
                and self.put(spot)
            ):
                return spot
        return None

    def around(self, table: PlacedFurniture, family: str, count: int) -> int:
        """Place chairs around a table, no more than `count`; returns how many found room."""
        high = table.piece.high
        x, y = float(high[0]), float(high[1])
        model = self.draw(family)
        a, b = model.low, model.high
        width = float(b[0] - a[0])
        each = max(1, int((2 * x - 0.1) // (width + 0.1)))
        places = [(side, (k - (each - 1) / 2) * 2 * x / each) for side in (0, 2) for k in range(each)]
        places += [(side, 0.0) for side in (1, 3)]
        if count <= 2 and self.rng.uniform() < 0.6:
            places = [(0, 0.0), (2, 0.0), (1, 0.0), (3, 0.0)]
        order = [0, *self.rng.permutation(np.arange(1, len(places))).tolist()]
        done = 0
        for number in order:
            if done == count:
                break
            side, along = places[number]
            loose = self.rng.uniform() < 0.4
            turn = float(self.rng.normal(0, 0.15)) if loose else 0.0
            gap = float(self.rng.uniform(0.08, 0.25) if loose else self.rng.uniform(0.015, 0.06))
            away = (y if side % 2 == 0 else x) + gap - float(a[1])
            spot = {0: (along, -away), 1: (away, along), 2: (along, away), 3: (-away, along)}[side]
            at = table.point(*spot)
            heading = table.turn + np.pi + side * np.pi / 2 + turn
            done += self.put(PlacedFurniture(model, (*at, 0.0), heading), aside=True)
        return done
