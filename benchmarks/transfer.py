"""Radiance transfer of a mesh: per vertex, what each SH coefficient of distant light adds to its reflection.

An experiment of `benchmarks.self_shadow`; vig's own shading is the first term of it, without visibility.
At vertex x with unit normal n the reflection of a surface of albedo a under light L is a * T(x) . L with

    T(x) = mean over w of  V(x, w) Y(w)  +  a * hit(x, w) T(y)  +  rho * ground(x, w) T(z)

over directions w distributed as the clamped cosine over pi; V is 1 where w meets neither the object (at y)
nor the ground (at z), the plane z = 0 of albedo rho (Sloan, Kautz and Snyder, 2002). Without anything in
the way T_lm = A_l Y_lm(n), which is `vig.scene.irradiance`.
"""

import functools
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import scipy.sparse
import torch
import warp as wp

from vig.render.device import initialise
from vig.scene import vertex_normals
from vig.scene.light import COSINE_LOBE, L_COUNT, sh_basis

OFFSET = 2e-4
"""Metres along the normal at which rays start, so that a facet does not hide its own corners."""

GROUND_HALF, GROUND_CELLS = 0.5, 64
"""The ground near the object: a square grid of points round the origin; beyond it the ground is unshadowed."""


@functools.cache
def _kernels() -> SimpleNamespace:
    initialise()

    @wp.kernel(module="vig_transfer")
    def cast(
        mesh: wp.uint64,
        origins: wp.array(dtype=wp.vec3),
        directions: wp.array2d(dtype=wp.vec3),
        faces: wp.array2d(dtype=wp.int32),
        weights: wp.array2d(dtype=wp.vec3),
    ):
        point, ray = wp.tid()
        found = wp.mesh_query_ray(mesh, origins[point], directions[point, ray], 1.0e3)
        face = wp.int32(-1)
        if found.result:
            face = found.face
            if found.sign < 0.0:
                face = -2
            weights[point, ray] = wp.vec3(found.u, found.v, 1.0 - found.u - found.v)
        faces[point, ray] = face

    return SimpleNamespace(cast=cast)


def cosine_directions(normals: np.ndarray, side: int, rng: np.random.Generator) -> np.ndarray:
    """Directions (N, side^2, 3) about normals (N, 3), cosine-weighted, stratified, turned at random per point."""
    grid = np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2)
    u, v = ((grid + rng.uniform(size=grid.shape)) / side).T
    angle = 2 * np.pi * (v + rng.uniform(size=(len(normals), 1)))
    radius, height = np.sqrt(u), np.sqrt(1 - u)
    axis = np.where(np.abs(normals[:, :1]) < 0.5, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(normals, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    return (
        (radius * np.cos(angle))[..., None] * first[:, None]
        + (radius * np.sin(angle))[..., None] * second[:, None]
        + height[:, None] * normals[:, None]
    )


def unoccluded(normals: np.ndarray) -> np.ndarray:
    """A_l Y_lm(n): (..., 3) to (..., 9)."""
    return sh_basis(torch.from_numpy(np.ascontiguousarray(normals, np.float64))).numpy() * COSINE_LOBE


def basis(directions: np.ndarray) -> np.ndarray:
    """Y_lm (..., 9) of unit directions."""
    return sh_basis(torch.from_numpy(directions)).numpy()


@dataclass(frozen=True)
class Visibility:
    """What points see: blocked (N, 9) is the mean of Y over what the object hides, lower (N, 9) over what the
    ground alone hides; objects (N, V) and ground (N, cells + 1) are sparse means over what is met instead.
    inside (N,) bool: the point lies in another part of the object.
    """

    blocked: np.ndarray
    lower: np.ndarray
    objects: scipy.sparse.csr_matrix
    ground: scipy.sparse.csr_matrix
    inside: np.ndarray
    shaded: np.ndarray


def look(
    vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, normals: np.ndarray, side: int, seed: int, dark=None
) -> Visibility:
    """Cast side^2 rays from each of the points (N, 3) with unit normals (N, 3) against a mesh."""
    k = _kernels()
    rng = np.random.default_rng(seed)
    mesh = wp.Mesh(
        wp.from_numpy(vertices.astype(np.float32), dtype=wp.vec3, device="cpu"),
        wp.from_numpy(faces.astype(np.int32).ravel(), dtype=wp.int32, device="cpu"),
    )
    parts = []
    for start in range(0, len(points), 1024):
        here, normal = points[start : start + 1024], normals[start : start + 1024].astype(np.float64)
        away = cosine_directions(normal, side, rng)
        origins = here + OFFSET * normal
        found = wp.zeros(away.shape[:2], dtype=wp.int32, device="cpu")
        weights = wp.zeros(away.shape[:2], dtype=wp.vec3, device="cpu")
        wp.launch(
            k.cast,
            dim=away.shape[:2],
            inputs=[
                mesh.id,
                wp.from_numpy(origins.astype(np.float32), dtype=wp.vec3, device="cpu"),
                wp.from_numpy(away.astype(np.float32), dtype=wp.vec3, device="cpu"),
                found,
                weights,
            ],
            device="cpu",
        )
        parts.append(_gather(len(vertices), faces, origins, away, found.numpy(), weights.numpy(), dark))
    return Visibility(
        np.concatenate([p.blocked for p in parts]),
        np.concatenate([p.lower for p in parts]),
        scipy.sparse.vstack([p.objects for p in parts]).tocsr(),
        scipy.sparse.vstack([p.ground for p in parts]).tocsr(),
        np.concatenate([p.inside for p in parts]),
        np.concatenate([p.shaded for p in parts]),
    )


def _gather(
    total: int,
    faces: np.ndarray,
    origins: np.ndarray,
    away: np.ndarray,
    found: np.ndarray,
    weights: np.ndarray,
    dark=None,
) -> Visibility:
    count, rays = found.shape
    values = basis(away)
    hit, behind = found >= 0, found == -2
    lower = ~hit & ~behind & (away[..., 2] < -1e-6)
    share = 1.0 / rays
    row, ray = np.nonzero(hit)
    corners = faces[found[row, ray]]
    objects = scipy.sparse.csr_matrix(
        (share * weights[row, ray].ravel(), (np.repeat(row, 3), corners.ravel())), shape=(count, total)
    )
    row, ray = np.nonzero(lower)
    d, o = away[row, ray], origins[row]
    met = o[:, :2] - d[:, :2] * (o[:, 2:] / d[:, 2:])
    at = np.floor((met / GROUND_HALF + 1) / 2 * GROUND_CELLS).astype(int)
    near = ((at >= 0) & (at < GROUND_CELLS)).all(1)
    cell = np.where(near, at[:, 1] * GROUND_CELLS + at[:, 0], GROUND_CELLS**2)
    shaded = np.zeros((count, L_COUNT))
    if dark is not None:
        np.add.at(shaded, row, dark[cell][:, None] * values[row, ray] * share)
    ground = scipy.sparse.csr_matrix(
        (np.full(len(row), share), (row, cell)), shape=(count, GROUND_CELLS**2 + 1)
    )
    return Visibility(
        np.einsum("nr,nrl->nl", (hit | behind).astype(float), values) * share,
        np.einsum("nr,nrl->nl", lower.astype(float), values) * share,
        objects,
        ground,
        behind.mean(1) > 0.3,
        shaded,
    )


@dataclass(frozen=True)
class Transporter:
    """A shape with its rays cast; gives its transfer vectors under different assumptions."""

    normals: np.ndarray
    neighbours: scipy.sparse.csr_matrix
    own: Visibility
    grid: Visibility

    @staticmethod
    def of(vertices: np.ndarray, faces: np.ndarray, side: int = 20, seed: int = 0) -> "Transporter":
        """Cast side^2 rays from each vertex (V, 3), metres, and from each point of the ground's grid."""
        normals = vertex_normals(vertices, faces).astype(np.float64)
        centres = ((np.arange(GROUND_CELLS) + 0.5) / GROUND_CELLS * 2 - 1) * GROUND_HALF
        x, y = np.meshgrid(centres, centres)
        floor = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.0)], 1)
        up = np.tile([0.0, 0.0, 1.0], (len(floor), 1))
        grid = look(vertices, faces, floor, up, max(8, side // 2), seed + 1)
        below = unoccluded(np.array([[0.0, 0.0, 1.0]]))[0, 0]
        dark = np.append((grid.blocked[:, 0] / below) * 0.75, 0.0)
        own = look(vertices, faces, vertices, normals, side, seed, dark)
        pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        pairs = np.concatenate([pairs, pairs[:, ::-1]])
        shape = (len(vertices), len(vertices))
        neighbours = scipy.sparse.csr_matrix((np.ones(len(pairs)), pairs.T), shape=shape)
        neighbours.data[:] = 1
        return Transporter(normals, neighbours, own, grid)

    def transfer(self, albedo: float = 0.0, ground: float | None = None, bounces: int = 4, contact=False) -> np.ndarray:
        """T (V, 9) for the object's albedo in its own bounces; ground: its albedo, None where there is none."""
        direct = unoccluded(self.normals) - self.own.blocked
        below = unoccluded(np.array([[0.0, 0.0, 1.0]])).repeat(len(self.grid.blocked), 0)
        floor_direct = np.concatenate([below - self.grid.blocked, below[:1]])
        if ground is not None:
            direct = direct - self.own.lower
        if contact:
            direct = direct - self.own.shaded
        result, floor = self.filled(direct), floor_direct
        for _ in range(bounces if albedo or ground else 0):
            new = direct + albedo * (self.own.objects @ result)
            if ground is not None:
                new = new + ground * (self.own.ground @ floor)
                met = albedo * (self.grid.objects @ result)
                floor = floor_direct + np.concatenate([met, np.zeros((1, L_COUNT))])
            result = self.filled(new)
        return result

    def filled(self, transfer: np.ndarray) -> np.ndarray:
        """The change against unoccluded, at vertices inside another part, taken over from their neighbours."""
        free = unoccluded(self.normals)
        change, known = transfer - free, ~self.own.inside
        change = np.where(known[:, None], change, 0.0)
        for _ in range(200):
            if known.all():
                break
            count = self.neighbours @ known.astype(float)
            new = ~known & (count > 0)
            if not new.any():
                break
            change[new] = (self.neighbours @ (change * known[:, None]))[new] / count[new, None]
            known = known | new
        return free + change
