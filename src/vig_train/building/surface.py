"""What can be seen of a mesh from outside: the surface that registration needs, whatever the topology."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vig.scene import Camera
from vig_world.mesh import face_normals
from vig_world.raster.rasterize import rasterize

VIEW_COUNT = 60
"""Directions from which a mesh is rendered."""
VIEW_PIXELS = 220
"""Pixels on a side of these renderings."""
EYE_DISTANCE = 50.0
"""Distance of the eye, in sizes of the mesh: nearly parallel."""
MIN_FACING_COSINE = math.cos(math.radians(75))
"""Least cosine between a face's normal and the direction from which it counts as seen."""
MAX_VISIBLE_PIXELS = 250_000
"""Pixels of all renderings that are used, about."""
SURFACE_POINTS = 24_000
"""Points of a surface, about."""


@dataclass(frozen=True)
class SurfaceSample:
    """Points all over the outside of a mesh, about equally dense.

    Attributes:
        points: (N, 3) in the mesh's units.
        normals: (N, 3) outward, of unit length.
    """

    points: np.ndarray
    normals: np.ndarray

    def transformed(self, linear: np.ndarray, offset: np.ndarray) -> SurfaceSample:
        """Moved by a linear map (3, 3) and an offset (3,)."""
        normals = self.normals @ np.linalg.inv(linear)
        return SurfaceSample(
            self.points @ linear.T + offset, normals / np.linalg.norm(normals, axis=1, keepdims=True)
        )

    @property
    def size(self) -> float:
        """Longest side of the bounding box."""
        return float(np.ptp(self.points, axis=0).max())

    def features(self, weight: float) -> np.ndarray:
        """Places and directions (N, 6): a difference of normals of one counts as a distance of `weight`."""
        return np.concatenate([self.points, weight * self.normals], axis=1)

    def some(self, count: int) -> SurfaceSample:
        """Return at most `count` of the points, at even steps."""
        chosen = np.linspace(0, len(self.points) - 1, min(count, len(self.points))).astype(int)
        return SurfaceSample(self.points[chosen], self.normals[chosen])


def sphere_directions(count: int) -> np.ndarray:
    """Unit vectors (count, 3) spread evenly over the sphere (a Fibonacci spiral)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    turn = np.arange(count) * math.pi * (3 - math.sqrt(5))
    around = np.sqrt(1 - z**2)
    return np.stack([around * np.cos(turn), around * np.sin(turn), z], axis=1)


def camera_rotation(direction: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) of a camera (x right, y down, z forward) that looks along -direction (3,)."""
    forward = -direction
    aside = np.cross(forward, np.eye(3)[np.abs(forward).argmin()])
    aside /= np.linalg.norm(aside)
    return np.stack([aside, np.cross(forward, aside), forward])


def visible_surface(vertices: np.ndarray, faces: np.ndarray, count: int = SURFACE_POINTS) -> SurfaceSample:
    """The surface of a mesh (V, 3), (F, 3) that is seen from outside, both sides of open sheets included.

    Inner walls, nested shells and doubled faces do not count, and the order of a face's corners does not
    matter: a normal points to where it is seen from.
    """
    middle = (vertices.min(0) + vertices.max(0)) / 2
    radius = float(np.linalg.norm(vertices - middle, axis=1).max())
    face_normal = face_normals(vertices, faces)
    face_normal /= np.maximum(np.linalg.norm(face_normal, axis=1, keepdims=True), 1e-300)
    camera = Camera(
        VIEW_PIXELS, VIEW_PIXELS, 0.5 * VIEW_PIXELS * EYE_DISTANCE / 1.02, VIEW_PIXELS / 2, VIEW_PIXELS / 2
    )
    unit = (vertices - middle) / radius  # the rasteriser's near plane is in metres
    points, normals = [], []
    for direction in sphere_directions(VIEW_COUNT):
        rotation = camera_rotation(direction)
        raster = rasterize(unit, faces, rotation, np.array([0.0, 0.0, EYE_DISTANCE]), camera)
        covered = raster.face >= 0
        face, weights = raster.face[covered], raster.barycentric[covered]
        facing = face_normal[face] @ direction
        steep = np.abs(facing) > MIN_FACING_COSINE
        face, weights, facing = face[steep], weights[steep], facing[steep]
        points.append(np.einsum("nk,nkd->nd", weights, unit[faces[face]]))
        normals.append(face_normal[face] * np.sign(facing)[:, None])
    step = max(1, sum(map(len, points)) // MAX_VISIBLE_PIXELS)
    cloud, towards = np.concatenate(points)[::step], np.concatenate(normals)[::step]
    chosen = thin_indices(cloud, towards, count)
    return SurfaceSample(cloud[chosen] * radius + middle, towards[chosen])


def thin_indices(points: np.ndarray, normals: np.ndarray, count: int) -> np.ndarray:
    """Return indices of about `count` of points (N, 3), evenly spread, by bisection of the cell size.

    One point is taken per cell and major direction of the normal, so that thin walls keep both sides.
    """
    low, high = 1e-4 * np.ptp(points, axis=0).max(), np.ptp(points, axis=0).max()
    side = np.argmax(np.abs(normals), axis=1) * 2 + (
        np.take_along_axis(normals, np.abs(normals).argmax(1)[:, None], 1)[:, 0] > 0
    )
    for _ in range(14):
        cell = math.sqrt(low * high)
        keys = np.concatenate([np.floor(points / cell).astype(np.int64), side[:, None]], axis=1)
        mixed = keys @ np.array([73856093, 19349663, 83492791, 50331653])
        _, first = np.unique(mixed, return_index=True)
        if len(first) > count:
            low = cell
        else:
            high = cell
    return np.sort(first)


def vertex_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """A third of the areas of the faces round each vertex: (V,)."""
    area = np.linalg.norm(face_normals(vertices, faces), axis=1)
    return np.asarray(np.bincount(faces.ravel(), np.repeat(area, 3), len(vertices)) / 6)


def face_edges(faces: np.ndarray) -> np.ndarray:
    """Return the edges (3 F, 2) of faces (F, 3); an edge occurs once per face that has it."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def sample_surface(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Sample a mesh uniformly by area, with a fixed seed: faces (count,), barycentric weights (count, 3)."""
    rng = np.random.default_rng(0)
    area = np.linalg.norm(face_normals(vertices, faces), axis=1)
    return rng.choice(len(faces), count, p=area / area.sum()), rng.dirichlet(np.ones(3), count)
