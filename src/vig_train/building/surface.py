"""The surface of a mesh that is visible from outside, as registration needs it, whatever the topology."""

import math
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vig.scene import Camera
from vig_train.packs.transfer import neighbours_of
from vig_world.mesh import face_normals
from vig_world.raster.rasterize import rasterize


@dataclass(frozen=True)
class SurfaceSample:
    """Points all over the outside of a mesh, about equally dense.

    Attributes:
        points: (N, 3) in the mesh's units.
        normals: (N, 3) outward, of unit length.
    """

    points: np.ndarray
    normals: np.ndarray

    def transform(self, linear: np.ndarray, offset: np.ndarray) -> "SurfaceSample":
        """Return the sample moved by a linear map (3, 3) and an offset (3,)."""
        normals = self.normals @ np.linalg.inv(linear)
        return SurfaceSample(
            self.points @ linear.T + offset, normals / np.linalg.norm(normals, axis=1, keepdims=True)
        )

    @property
    def size(self) -> float:
        """Return the longest side of the bounding box."""
        return float(np.ptp(self.points, axis=0).max())

    def features(self, weight: float) -> np.ndarray:
        """Return places and directions (N, 6): a difference of normals of one counts as distance `weight`."""
        return np.concatenate([self.points, weight * self.normals], axis=1)

    def some(self, count: int) -> "SurfaceSample":
        """Return at most `count` of the points, at even steps."""
        chosen = np.linspace(0, len(self.points) - 1, min(count, len(self.points))).astype(int)
        return SurfaceSample(self.points[chosen], self.normals[chosen])


def sphere_directions(count: int) -> np.ndarray:
    """Return unit vectors (count, 3) spread evenly over the sphere (a Fibonacci spiral)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    turn = np.arange(count) * math.pi * (3 - math.sqrt(5))
    around = np.sqrt(1 - z**2)
    return np.stack([around * np.cos(turn), around * np.sin(turn), z], axis=1)


def camera_rotation(direction: np.ndarray, up: np.ndarray | None = None) -> np.ndarray:
    """Return the rotation (3, 3) of a camera (x right, y down, z forward) that looks along -direction (3,).

    up: (3,), which is up in the picture; any direction by default.
    """
    forward = -direction
    aside = np.cross(forward, np.eye(3)[np.abs(forward).argmin()] if up is None else up)
    aside /= np.linalg.norm(aside)
    return np.stack([aside, np.cross(forward, aside), forward])


def draw_alone(
    vertices: np.ndarray,
    faces: np.ndarray,
    rotation: np.ndarray,
    sphere: tuple[np.ndarray, float],
    side: int,
    margin: float = 1.02,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw a mesh, nearly parallel.

    Args:
        vertices: (V, 3) of the mesh.
        faces: (F, 3) of the mesh.
        rotation: (3, 3) of the camera.
        sphere: Middle (3,) and radius of the sphere that fills the picture.
        side: Side of the picture, pixels.
        margin: Radius of the region in the picture, in radii of the sphere.

    Returns:
        Covered pixels (side, side) bool; the face of each of them (N,), and its barycentric weights (N, 3).
    """
    unit = (vertices - sphere[0]) / sphere[1]  # the rasteriser's near plane is in metres
    # Distance of the camera from a mesh that is drawn alone, in its radii: nearly parallel.
    eye_distance = 50.0
    camera = Camera(side, side, 0.5 * side * eye_distance / margin, side / 2, side / 2)
    raster = rasterize(unit, faces, rotation, np.array([0.0, 0.0, eye_distance]), camera)
    covered = raster.face >= 0
    return covered, raster.face[covered], raster.barycentric[covered]


def sphere_of(vertices: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the middle (3,) and radius of a sphere round vertices (V, 3)."""
    middle = (vertices.min(0) + vertices.max(0)) / 2
    return middle, float(np.linalg.norm(vertices - middle, axis=1).max())


def visible_surface(vertices: np.ndarray, faces: np.ndarray, count: int = 24_000) -> SurfaceSample:
    """Return the surface of a mesh (V, 3), (F, 3) seen from outside, both sides of open sheets included.

    Inner walls, nested shells and doubled faces do not count, and the order of a face's corners does not
    matter: a normal points to where it is seen from.
    """
    middle, radius = sphere = sphere_of(vertices)
    face_normal = face_normals(vertices, faces)
    face_normal /= np.maximum(np.linalg.norm(face_normal, axis=1, keepdims=True), 1e-300)
    unit = (vertices - middle) / radius
    points, normals = [], []
    for direction in sphere_directions(60):
        _, face, weights = draw_alone(vertices, faces, camera_rotation(direction), sphere, 220)
        facing = face_normal[face] @ direction
        steep = np.abs(facing) > math.cos(math.radians(75))  # others are seen from elsewhere
        face, weights, facing = face[steep], weights[steep], facing[steep]
        points.append(np.einsum("nk,nkd->nd", weights, unit[faces[face]]))
        normals.append(face_normal[face] * np.sign(facing)[:, None])
    step = max(1, sum(map(len, points)) // 250_000)  # pixels of all views that are used
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

    def keys(cell: float) -> np.ndarray:
        corner = np.floor(points / cell).astype(np.int64)
        return np.asarray(corner @ np.array([73856093, 19349663, 83492791]) + side * 50331653)

    for _ in range(13):
        cell = math.sqrt(low * high)
        low, high = (cell, high) if len(np.unique(keys(cell))) > count else (low, cell)
    return np.sort(np.unique(keys(math.sqrt(low * high)), return_index=True)[1])


def vertex_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return a third of the areas of the faces round each vertex: (V,)."""
    area = np.linalg.norm(face_normals(vertices, faces), axis=1)
    return np.asarray(np.bincount(faces.ravel(), np.repeat(area, 3), len(vertices)) / 6)


def neighbour_mean(faces: np.ndarray, count: int) -> sp.csr_matrix:
    """Return the matrix (V, V) that gives each of `count` vertices the mean of itself and its neighbours."""
    graph = neighbours_of(faces, count) + sp.eye(count)
    return sp.diags(1 / np.asarray(graph.sum(1)).ravel()) @ graph


def sample_points(vertices: np.ndarray, faces: np.ndarray, count: int) -> np.ndarray:
    """Return points (count, 3) of a mesh, uniform by area, with a fixed seed."""
    face, weights = sample_surface(vertices, faces, count)
    return np.asarray(np.einsum("nk,nkd->nd", weights, vertices[faces[face]]))


def sample_surface(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Sample a mesh uniformly by area, with a fixed seed: faces (count,), barycentric weights (count, 3)."""
    rng = np.random.default_rng(0)
    area = np.linalg.norm(face_normals(vertices, faces), axis=1)
    return rng.choice(len(faces), count, p=area / area.sum()), rng.dirichlet(np.ones(3), count)
