"""How meshes stand: all brought into one pose, upright, with the front to +X."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree
from scipy.spatial.transform import Rotation

from vig_train.building.surface import Surface
from vig_world.rotations import about_z

FEW, MANY = 250, 2000
"""Points of a surface that look for another, and that are looked among."""
ANCHORS = 8
"""Meshes with which all are compared, at most, to choose the one that the others are turned to."""
BEYOND = 0.3
"""Distances count no more than this, in root mean square radii: parts that only one has are to be there."""
NORMAL = 0.3
"""Root mean square radii that a difference of normals of one counts as."""
TRIED, STEPS = 8, 20
"""Best starts that are refined, and steps of each."""
JURY, PLAIN = 6, 0.92
"""Meshes with which a pose is compared in the end, and the share that a likelier pose's distance counts."""
ROTATIONS = 400
"""Starts besides the turns of a cube."""
TILT = math.radians(15.0)
"""A foot within this of level is put level."""
SAME = 0.022
"""A shape that a turn changes by less, in root mean square radii, is the same after it."""


@dataclass(frozen=True)
class Cloud:
    """A surface about its middle, of unit size, ready to be compared.

    Attributes:
        points: (N, 3).
        normals: (N, 3).
        tree: Of both.
        apart: Mean distance of neighbours, which two samples of one surface have too.
    """

    points: np.ndarray
    normals: np.ndarray
    tree: cKDTree
    apart: float

    @staticmethod
    def of(surface: Surface) -> Cloud:
        """Centred at the mean of its points; the unit is their root mean square distance from it."""
        some = surface.some(MANY)
        points = some.points - some.points.mean(0)
        points = points / math.sqrt((points**2).sum(1).mean())
        features = np.concatenate([points, NORMAL * some.normals], axis=1)
        tree = cKDTree(features)
        return Cloud(points, some.normals, tree, float(tree.query(features, 2)[0][:, 1].mean()))

    def off(self, other: Cloud, rotation: np.ndarray) -> float:
        """Mean distance both ways to another that is turned by a rotation (3, 3)."""
        return 0.5 * (self._from(other, rotation) + other._from(self, rotation.T))

    def _from(self, other: Cloud, rotation: np.ndarray) -> float:
        step = max(1, len(other.points) // FEW)
        turned = np.concatenate(
            [other.points[::step] @ rotation.T, NORMAL * other.normals[::step] @ rotation.T], axis=1
        )
        return float(np.minimum(self.tree.query(turned)[0], BEYOND).mean())

    def refined(self, other: Cloud, rotation: np.ndarray) -> np.ndarray:
        """The rotation near one given that brings another nearest, by pairs found anew in each step."""
        for _ in range(STEPS):
            points, normals = other.points @ rotation.T, other.normals @ rotation.T
            far, index = self.tree.query(np.concatenate([points, NORMAL * normals], axis=1))
            weight = 1 / (1 + (far / 0.15) ** 2) ** 2
            mine, theirs = self.points[index], points
            centred = (mine * weight[:, None]).sum(0), (theirs * weight[:, None]).sum(0)
            total = weight.sum()
            a, b = theirs - centred[1] / total, mine - centred[0] / total
            u, _, v = np.linalg.svd((a * weight[:, None]).T @ b)
            turn = v.T @ np.diag([1, 1, np.linalg.det(v.T @ u.T)]) @ u.T
            rotation = turn @ rotation
            if np.abs(turn - np.eye(3)).max() < 1e-4:
                break
        return rotation


def cube_turns() -> list[np.ndarray]:
    """The 24 rotations that take the axes to axes, the identity first."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0:
                found.append(matrix)
    return sorted(found, key=lambda matrix: -np.trace(matrix))


def spread_rotations(count: int) -> list[np.ndarray]:
    """Rotations spread evenly (super-Fibonacci spirals, Alexa 2022)."""
    s = np.arange(count) + 0.5
    r, big = np.sqrt(s / count), np.sqrt(1 - s / count)
    a, b = 2 * math.pi * s / math.sqrt(2), 2 * math.pi * s / 1.533751168755204288118041
    x, y, z, w = r * np.sin(a), r * np.cos(a), big * np.sin(b), big * np.cos(b)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return list(np.moveaxis(np.array(rows), 2, 0))


def aligned(clouds: list[Cloud]) -> tuple[int, list[np.ndarray], np.ndarray]:
    """Turn all to the one that is most like the others.

    Returns:
        Its number, rotations (3, 3) of each to it, and the costs (N,).
    """
    turns = cube_turns()
    anchors = np.unique(np.linspace(0, len(clouds) - 1, min(ANCHORS, len(clouds))).astype(int))
    costs = np.zeros((len(anchors), len(clouds)))
    for row, anchor in enumerate(anchors):
        for number, cloud in enumerate(clouds):
            if number != anchor:
                costs[row, number] = min(clouds[anchor].off(cloud, turn) for turn in turns)
    first = int(anchors[np.median(costs, axis=1).argmin()])
    starts = turns + spread_rotations(ROTATIONS)
    tried: list[list[np.ndarray]] = []
    rotations, off = [], np.zeros(len(clouds))
    for number, cloud in enumerate(clouds):
        order = np.argsort([clouds[first].off(cloud, start) for start in starts], kind="stable")[:TRIED]
        tried.append(turns + [clouds[first].refined(cloud, starts[each]) for each in order])
        found = [clouds[first].off(cloud, each) for each in tried[-1]]
        rotations.append(np.eye(3) if number == first else tried[-1][int(np.argmin(found))])
        off[number] = 0.0 if number == first else min(found)
    # One mesh may be like the first upside down, not like most: those that are most alike decide together.
    usual, jury = usual_axes(rotations), np.argsort(off, kind="stable")[:JURY]
    decided, final = [], np.zeros(len(clouds))
    for number, cloud in enumerate(clouds):
        others = [each for each in jury if each != number] or [first]
        distances = [[clouds[a].off(cloud, rotations[a].T @ each) for a in others] for each in tried[number]]
        mean = np.mean(distances, axis=1)
        # Turns of the file's axes are likelier than others, the turns of most files likelier still.
        mean[: len(turns)] *= PLAIN
        upright = np.array([(np.abs(each - usual)[:, 1:].max(0) < 1e-6).any() for each in turns])  # in Y or Z
        mean[: len(turns)][upright] *= PLAIN
        decided.append(tried[number][int(mean.argmin())])
        final[number] = mean.min()
    return first, decided, final


def usual_axes(rotations: list[np.ndarray]) -> np.ndarray:
    """The turn of a cube (3, 3) that takes the axes of most files to those of the common pose, about."""
    turns = np.array(cube_turns())
    nearest = [int(np.einsum("nij,ij->n", turns, rotation).argmax()) for rotation in rotations]
    return np.asarray(turns[np.bincount(nearest).argmax()])


def up_axis(surfaces: list[Surface], rotations: list[np.ndarray]) -> np.ndarray:
    """The axis (3,) of the common pose that points up: Y or Z of most files, where they stand broader."""
    usual = usual_axes(rotations)
    broad = [
        float(np.median([standing(s, r, up) for s, r in zip(surfaces, rotations, strict=True)]))
        for up in (usual[:, 1], usual[:, 2])
    ]
    return np.asarray(usual[:, 1 + int(np.argmax(broad))])


def standing(surface: Surface, rotation: np.ndarray, up: np.ndarray) -> float:
    """How broadly a surface stands: area of its foot's hull over that of the whole, seen along an axis."""
    points = surface.points @ rotation.T
    height = points @ up
    flat = points[:, np.abs(up) < 0.5]
    low = height < height.min() + 0.015 * np.ptp(height)
    return _hull_area(flat[low]) / max(_hull_area(flat), 1e-12)


def _hull_area(points: np.ndarray) -> float:
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


def to_up(up: np.ndarray) -> np.ndarray:
    """The turn of a cube (3, 3) that takes an axis to +Z, with the least turn of the others."""
    return next(turn for turn in cube_turns() if np.allclose(turn @ up, [0, 0, 1]))


def axis_of_revolution(cloud: Cloud, likely: np.ndarray) -> np.ndarray:
    """The axis (3,), in either sense, about which turns change a cloud least.

    It is sought near a likely one (3,), those of the file, and those of the shape's second moments.
    """

    def change(axis: np.ndarray) -> float:
        turns = [Rotation.from_rotvec(turn * axis, degrees=True).as_matrix() for turn in (40, 90, 140)]
        return float(np.mean([cloud.off(cloud, turn) for turn in turns])) - cloud.apart

    _, _, moments = np.linalg.svd(cloud.points, full_matrices=False)
    found = [likely, *np.eye(3), *moments]
    costs = np.array([change(axis) for axis in found])
    costs[0] *= PLAIN
    best = np.asarray(found[int(costs.argmin())])
    for step in (8.0, 4.0, 2.0, 1.0):
        across = np.linalg.svd(best[None])[2][1:]
        for way in (across[0], -across[0], across[1], -across[1]):
            near = best + math.radians(step) * way
            near = near / np.linalg.norm(near)
            if change(near) < PLAIN * change(best):
                best = near
    return best


def levelled(surface: Surface) -> np.ndarray:
    """The small rotation (3, 3) that puts the foot of an about upright surface level."""
    try:
        hull = ConvexHull(surface.points)
    except (QhullError, ValueError):
        return np.eye(3)
    normals = hull.equations[:, :3]
    corners = surface.points[hull.simplices]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    down = -normals[:, 2] > math.cos(TILT)
    if not down.any():
        return np.eye(3)
    # Facets that lie in one plane count together.
    like = normals[down] @ normals[down].T > math.cos(math.radians(2.0))
    total = like @ area[down]
    normal = (like[int(total.argmax())] * area[down]) @ normals[down]
    return _between(normal / np.linalg.norm(normal), np.array([0.0, 0.0, -1.0]))


def turned_up(axis: np.ndarray, up: np.ndarray) -> np.ndarray:
    """A rotation (3, 3) that takes to +Z the axis (3,) in the sense in which it is nearer to `up`."""
    axis = axis if axis @ up >= 0 else -axis
    below = to_up(np.array([0.0, 0.0, -1.0])) if axis[2] < 0 else np.eye(3)
    return _between(below @ axis, np.array([0.0, 0.0, 1.0])) @ below


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The least rotation (3, 3) that takes one unit vector to another, not opposite one."""
    axis, cosine = np.cross(a, b), float(a @ b)
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1 + cosine))


@dataclass(frozen=True)
class Shape:
    """What all meshes of a class share.

    Attributes:
        symmetry: "none", "half-turn" or "any-turn".
        mirror: Whether a mesh is its own mirror image in a plane through +Z.
        plane: Angle of that plane about +Z, radians.
        turned: Change by the turn that is undone best and worst, in root mean square radii.
        mirrored: Change by the best mirror.
    """

    symmetry: str
    mirror: bool
    plane: float
    turned: tuple[float, float]
    mirrored: float


def shape_of(clouds: list[Cloud]) -> Shape:
    """Symmetries of upright clouds in one pose: what most of them have."""
    turns = np.radians(np.arange(15, 181, 15))
    changes = np.median([[each.off(each, about_z(turn)) for turn in turns] for each in clouds], axis=0)
    own = float(np.median([each.apart for each in clouds]))
    changes = changes - own
    angles = np.radians(np.arange(0, 180, 5))
    mirrors = np.median([[_mirrored(each, angle) for angle in angles] for each in clouds], axis=0) - own
    plane = float(angles[mirrors.argmin()])
    if changes.max() < SAME:
        symmetry = "any-turn"
    else:
        symmetry = "half-turn" if changes[-1] < SAME else "none"
    worst = (float(changes.min()), float(changes.max()))
    return Shape(symmetry, bool(mirrors.min() < 1.5 * SAME), plane, worst, float(mirrors.min()))


def _mirrored(cloud: Cloud, angle: float) -> float:
    """How much a mirror in the upright plane at an angle changes a cloud."""
    across = np.array([-math.sin(angle), math.cos(angle), 0.0])
    return cloud.off(cloud, np.eye(3) - 2 * np.outer(across, across))


def front_turn(clouds: list[Cloud], plane: float) -> float:
    """The angle about +Z, of the two along the mirror plane, to which most reach out farther."""
    way = np.array([math.cos(plane), math.sin(plane), 0.0])
    lean = []
    for each in clouds:
        along = each.points @ way
        middle = np.median(along)
        lean.append(along.max() - middle - (middle - along.min()))
    return plane if np.median(lean) >= 0 else plane + math.pi


def straightened(cloud: Cloud) -> float:
    """The small angle about +Z by which a cloud is to be turned for its mirror plane to be y = 0; else 0."""
    angles = np.radians(np.arange(-20, 21, 2))
    costs = np.array([_mirrored(cloud, angle) for angle in angles])
    fine = angles[costs.argmin()] + np.radians(np.arange(-2, 2.1, 0.5))
    found = [_mirrored(cloud, angle) for angle in fine]
    return -float(fine[int(np.argmin(found))])
