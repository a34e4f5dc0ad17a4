"""Poses of meshes: all brought into one pose, upright, with the front to +X."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree
from scipy.spatial.transform import Rotation

from vig_train.building.surface import SurfaceSample
from vig_world.mesh import face_normals
from vig_world.rotations import about_z

MAX_ANCHORS = 8
"""Meshes with which all are compared, at most, to choose the medoid, to which the others are turned."""
NORMAL_WEIGHT = 0.3
"""Distance, in root mean square radii, for which a difference of normals of length one counts."""
LIKELY_POSE_FACTOR = 0.92  # factor on the distance of a pose that is likely beforehand
UP_FACTORS = np.array([1.0, 1.0, 0.5])
"""Factors on the breadths of the stances with Y, Z and X up, as files hardly have X up."""
DETAIL_SHARE, DETAIL_TOLERANCE = 0.02, 0.22
"""Exception: where the share of the surface, a spout or a handle, moves by more than the tolerance."""


@dataclass(frozen=True)
class PointCloud:
    """A sample of a surface about its middle, of unit size, with a tree for nearest neighbours.

    Attributes:
        points: (N, 3).
        normals: (N, 3).
        tree: k-d tree of features (N, 6): the points, and `NORMAL_WEIGHT` times the normals.
        spacing: Mean distance of nearest neighbours: the distance of two samples of one surface.
    """

    points: np.ndarray
    normals: np.ndarray
    tree: cKDTree
    spacing: float

    @staticmethod
    def from_surface(surface: SurfaceSample) -> "PointCloud":
        """Make one about the mean of its points; the unit is their root mean square distance from it."""
        # Nearest points are searched among 2,000.
        some = surface.some(2000)
        points = some.points - some.points.mean(0)
        points = points / math.sqrt((points**2).sum(1).mean())
        features = np.concatenate([points, NORMAL_WEIGHT * some.normals], axis=1)
        tree = cKDTree(features)
        return PointCloud(points, some.normals, tree, float(tree.query(features, 2)[0][:, 1].mean()))

    def distance(self, other: "PointCloud", rotation: np.ndarray) -> float:
        """Return the mean distance, both ways, to another cloud turned by a rotation (3, 3)."""
        # Truncated at .3 root mean square radii, so that a part of one mesh alone cannot dominate.
        there, back = self.distances(other, rotation, 0.3), other.distances(self, rotation.T, 0.3)
        return float(0.5 * there.mean() + 0.5 * back.mean())

    def distances(self, other: "PointCloud", rotation: np.ndarray, most: float = math.inf) -> np.ndarray:
        """Return distances (M,), `most` at most, of another cloud's points, turned (3, 3), to the nearest."""
        # The nearest point is searched for about 250 of the other's points.
        step = max(1, len(other.points) // 250)
        features = np.concatenate(
            [other.points[::step] @ rotation.T, NORMAL_WEIGHT * other.normals[::step] @ rotation.T], axis=1
        )
        return np.minimum(self.tree.query(features, distance_upper_bound=most)[0], most)

    def refine_rotation(self, other: "PointCloud", rotation: np.ndarray) -> np.ndarray:
        """Return the rotation (3, 3) near a start that brings another cloud nearest, by ICP.

        Pairs are weighted by the Geman-McClure weight of their distance, w = 1 / (1 + (d / 0.15)^2)^2; the
        rotation of each step is the weighted least-squares one (Kabsch).
        """
        # 20 steps at most.
        for _ in range(20):
            points, normals = other.points @ rotation.T, other.normals @ rotation.T
            distance, index = self.tree.query(np.concatenate([points, NORMAL_WEIGHT * normals], axis=1))
            weight = 1 / (1 + (distance / 0.15) ** 2) ** 2
            target, source = self.points[index], points
            a, b = (points - np.average(points, axis=0, weights=weight) for points in (source, target))
            turn = Rotation.align_vectors(b, a, weight)[0].as_matrix()
            rotation = turn @ rotation
            if np.abs(turn - np.eye(3)).max() < 1e-4:
                break
        return rotation


def cube_turns() -> list[np.ndarray]:
    """Return the 24 rotations that take the axes to axes, the identity first."""
    turns = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0:
                turns.append(matrix)
    return sorted(turns, key=lambda matrix: -np.trace(matrix))


def spread_rotations(count: int) -> list[np.ndarray]:
    """Return rotations spread evenly (super-Fibonacci spirals, Alexa 2022)."""
    s = np.arange(count) + 0.5
    r, big = np.sqrt(s / count), np.sqrt(1 - s / count)
    a, b = 2 * math.pi * s / math.sqrt(2), 2 * math.pi * s / 1.533751168755204288118041
    x, y, z, w = r * np.sin(a), r * np.cos(a), big * np.sin(b), big * np.cos(b)
    return list(Rotation.from_quat(np.stack([x, y, z, w], axis=1)).as_matrix())


def alignment_steps(count: int) -> int:
    """Return how many steps `align_clouds` takes of so many clouds, of about the same time each."""
    return (min(MAX_ANCHORS, count) + 2) * count


def align_clouds(
    clouds: list[PointCloud], advance: Callable[[int], None] = lambda steps: None
) -> tuple[int, list[np.ndarray], np.ndarray]:
    """Turn all clouds to their medoid, the one that is most like the others.

    advance: Called with the number of completed steps.

    Returns:
        The medoid's number, rotations (3, 3) of each cloud to it, and the mean distances (N,) that remain.
    """
    turns = cube_turns()
    anchors = np.unique(np.linspace(0, len(clouds) - 1, min(MAX_ANCHORS, len(clouds))).astype(int))
    costs = np.zeros((len(anchors), len(clouds)))
    for row, anchor in enumerate(anchors):
        for number, cloud in enumerate(clouds):
            if number != anchor:
                costs[row, number] = min(clouds[anchor].distance(cloud, turn) for turn in turns)
            advance(1)
    medoid = int(anchors[np.median(costs, axis=1).argmin()])
    # The turns of a cube, and 400 starts evenly spread over all rotations.
    starts = turns + spread_rotations(400)
    candidates: list[list[np.ndarray]] = []
    rotations, medoid_costs = [], np.zeros(len(clouds))
    for number, cloud in enumerate(clouds):
        start_costs = [clouds[medoid].distance(cloud, start) for start in starts]
        # The eight nearest starts are refined by ICP (iterative closest points).
        order = np.argsort(start_costs, kind="stable")[:8]
        candidates.append(turns + [clouds[medoid].refine_rotation(cloud, starts[index]) for index in order])
        candidate_costs = [clouds[medoid].distance(cloud, candidate) for candidate in candidates[-1]]
        rotations.append(np.eye(3) if number == medoid else candidates[-1][int(np.argmin(candidate_costs))])
        medoid_costs[number] = 0.0 if number == medoid else min(candidate_costs)
        advance(1)
    # A mesh may match the medoid upside down but not most others: the meshes nearest to the medoid decide.
    # Every pose is compared at last with the six meshes nearest to the medoid.
    usual_turn, references = usual_axes(rotations), np.argsort(medoid_costs, kind="stable")[:6]
    chosen, final_costs = [], np.zeros(len(clouds))
    for number, cloud in enumerate(clouds):
        others = [reference for reference in references if reference != number] or [medoid]
        distances = [
            [clouds[other].distance(cloud, rotations[other].T @ candidate) for other in others]
            for candidate in candidates[number]
        ]
        mean_distances = np.mean(distances, axis=1)
        # Turns of the file's axes are likelier than others, the turns of most files likelier still.
        mean_distances[: len(turns)] *= LIKELY_POSE_FACTOR
        # Up is Y or Z in files: a turn is usual where it takes one of the two as most files' turn does.
        upright = np.array([(np.abs(turn - usual_turn)[:, 1:].max(0) < 1e-6).any() for turn in turns])
        mean_distances[: len(turns)][upright] *= LIKELY_POSE_FACTOR
        chosen.append(candidates[number][int(mean_distances.argmin())])
        final_costs[number] = mean_distances.min()
        advance(1)
    return medoid, chosen, final_costs


def usual_axes(rotations: list[np.ndarray]) -> np.ndarray:
    """Return the turn of a cube (3, 3) nearest to the rotations of most files to the common pose."""
    turns = np.array(cube_turns())
    nearest = [int(np.einsum("nij,ij->n", turns, rotation).argmax()) for rotation in rotations]
    return np.asarray(turns[np.bincount(nearest).argmax()])


def up_axis(surfaces: list[SurfaceSample], rotations: list[np.ndarray]) -> np.ndarray:
    """Return the axis (3,) of the common pose that points up.

    That is Y or Z of most files, where they stand broader; or X where they stand far broader on it.
    """
    candidates = usual_axes(rotations).T[[1, 2, 0]]
    broad = [
        np.median([stance_breadth(s, r, up) for s, r in zip(surfaces, rotations, strict=True)])
        for up in candidates
    ]
    return np.asarray(candidates[np.argmax(np.array(broad) * UP_FACTORS)])


def stance_breadth(surface: SurfaceSample, rotation: np.ndarray, up: np.ndarray) -> float:
    """Return the area of the foot's convex hull over that of the whole surface, both seen along an axis; less
    where the surface is a thin sheet on its edge.
    """
    points = surface.points @ rotation.T
    height = points @ up
    flat = points[:, np.abs(up) < 0.5]
    low = height <= height.min() + 0.015 * np.ptp(height)
    # A thing whose width is less than a tenth of its height is likely to lie.
    slenderness = 0.1 * np.ptp(height) / max(np.ptp(flat, axis=0).min(), 1e-12)
    return _hull_area(flat[low]) / max(_hull_area(flat), 1e-12) / max(1.0, slenderness)


def _hull_area(points: np.ndarray) -> float:
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


def cube_turn_to_up(up: np.ndarray) -> np.ndarray:
    """Return the turn of a cube (3, 3) that takes an axis to +Z and turns the others least."""
    return next(turn for turn in cube_turns() if np.allclose(turn @ up, [0, 0, 1]))


def axis_of_revolution(cloud: PointCloud, file_axis: np.ndarray) -> np.ndarray:
    """Return the axis (3,), in either sense, about which turns change a cloud least.

    It is sought near a likely one (3,), those of the file, and those of the shape's second moments.
    """

    def change(axis: np.ndarray) -> float:
        turns = [Rotation.from_rotvec(turn * axis, degrees=True).as_matrix() for turn in (40, 90, 140)]
        return float(np.mean([cloud.distance(cloud, turn) for turn in turns])) - cloud.spacing

    _, _, moments = np.linalg.svd(cloud.points, full_matrices=False)
    candidates = [file_axis, *np.eye(3), *moments]
    costs = np.array([change(axis) for axis in candidates])
    costs[0] *= LIKELY_POSE_FACTOR
    best = np.asarray(candidates[int(costs.argmin())])
    for step in (8.0, 4.0, 2.0, 1.0):
        across = np.linalg.svd(best[None])[2][1:]
        for direction in (across[0], -across[0], across[1], -across[1]):
            tilted = best + math.radians(step) * direction
            tilted = tilted / np.linalg.norm(tilted)
            if change(tilted) < LIKELY_POSE_FACTOR * change(best):
                best = tilted
    return best


def levelling_rotation(surface: SurfaceSample) -> np.ndarray:
    """Return the small rotation (3, 3) that puts the foot of an about upright surface level."""
    try:
        hull = ConvexHull(surface.points)
    except (QhullError, ValueError):
        return np.eye(3)
    normals = hull.equations[:, :3]
    area = np.linalg.norm(face_normals(surface.points, hull.simplices), axis=1)
    # A foot within 15 degrees of level is put level.
    faces_down = -normals[:, 2] > math.cos(math.radians(15.0))
    if not faces_down.any():
        return np.eye(3)
    # The normal of the largest support: facets within 2 degrees of each other count as one plane.
    coplanar = normals[faces_down] @ normals[faces_down].T > math.cos(math.radians(2.0))
    plane_area = coplanar @ area[faces_down]
    normal = (coplanar[int(plane_area.argmax())] * area[faces_down]) @ normals[faces_down]
    return _rotation_between(normal / np.linalg.norm(normal), np.array([0.0, 0.0, -1.0]))


def rotation_to_vertical(axis: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return a rotation (3, 3) that takes to +Z the axis (3,) in the sense in which it is nearer to `up`."""
    axis = axis if axis @ up >= 0 else -axis
    below = cube_turn_to_up(np.array([0.0, 0.0, -1.0])) if axis[2] < 0 else np.eye(3)
    return _rotation_between(below @ axis, np.array([0.0, 0.0, 1.0])) @ below


def _rotation_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the least rotation (3, 3) that takes unit vector a to b, not opposite to it."""
    return np.asarray(Rotation.align_vectors(b[None], a[None])[0].as_matrix())


@dataclass(frozen=True)
class ClassSymmetry:
    """The symmetries that all meshes of a class share.

    Attributes:
        symmetry: "none", "half-turn" or "any-turn".
        mirror: Whether a mesh is its own mirror image in a plane through +Z.
        mirror_plane: Angle of that plane about +Z, radians.
    """

    symmetry: str
    mirror: bool
    mirror_plane: float


def class_symmetry(clouds: list[PointCloud]) -> ClassSymmetry:
    """Return the symmetries that most of the upright clouds in one pose have."""
    turns = np.radians(np.arange(15, 181, 15))
    changes = np.median(
        [[cloud.distance(cloud, about_z(turn)) for turn in turns] for cloud in clouds], axis=0
    )
    spacing = float(np.median([cloud.spacing for cloud in clouds]))
    changes = changes - spacing
    details = np.median([[_detail_change(cloud, turn) for turn in turns] for cloud in clouds], axis=0)
    # Root mean square radii; a shape that a turn changes by less in the mean has that turn as its symmetry.
    symmetry_tolerance = 0.022
    same = (changes < symmetry_tolerance) & (details < DETAIL_TOLERANCE)
    angles = np.radians(np.arange(0, 180, 5))
    mirrors = (
        np.median([[_mirror_change(cloud, angle) for angle in angles] for cloud in clouds], axis=0) - spacing
    )
    plane = float(angles[mirrors.argmin()])
    symmetry = "any-turn" if same.all() else "half-turn" if same[-1] else "none"
    return ClassSymmetry(symmetry, bool(mirrors.min() < 1.5 * symmetry_tolerance), plane)


def _detail_change(cloud: PointCloud, turn: float) -> float:
    """Return the distance beyond which a turn about +Z, in either sense, takes `DETAIL_SHARE` of a cloud."""
    moved = np.concatenate([cloud.distances(cloud, about_z(angle)) for angle in (turn, -turn)])
    return float(np.quantile(moved, 1 - DETAIL_SHARE))


def _mirror_change(cloud: PointCloud, angle: float) -> float:
    """Return how much a mirror in the upright plane at an angle changes a cloud."""
    across = np.array([-math.sin(angle), math.cos(angle), 0.0])
    return cloud.distance(cloud, np.eye(3) - 2 * np.outer(across, across))


def front_angle(clouds: list[PointCloud], plane: float) -> float:
    """Return the angle about +Z, of the two along the mirror plane, where most clouds reach out farther."""
    direction = np.array([math.cos(plane), math.sin(plane), 0.0])
    lean = []
    for cloud in clouds:
        along = cloud.points @ direction
        middle = np.median(along)
        lean.append(along.max() - middle - (middle - along.min()))
    return plane if np.median(lean) >= 0 else plane + math.pi


def straightening_angle(cloud: PointCloud) -> float:
    """Return the small angle about +Z that turns a cloud's mirror plane to y = 0; else 0."""
    angles = np.radians(np.arange(-20, 21, 2))
    costs = np.array([_mirror_change(cloud, angle) for angle in angles])
    fine = angles[costs.argmin()] + np.radians(np.arange(-2, 2.1, 0.5))
    fine_costs = [_mirror_change(cloud, angle) for angle in fine]
    return -float(fine[int(np.argmin(fine_costs))])
