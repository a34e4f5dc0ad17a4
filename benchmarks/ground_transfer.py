"""Transfer with the ground: `vig_world.packs.transfer` if it knew the plane z = 0 and its albedo.

An experiment of `benchmarks.self_shadow`. Rays that meet nothing of the object and point downwards meet the
ground, which reflects rho times what arrives there past the object. The ground near the object is a grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
import torch

from vig.scene.light import sh_basis
from vig_world.packs.transfer import BOUNCES, Occlusion, cast, neighbours_of, spread, unoccluded

HALF, CELLS = 0.5, 64
"""Metres, and cells along a side; beyond the grid the ground is unshadowed."""


@dataclass(frozen=True)
class GroundTransfer:
    """A shape over the ground.

    below (V, 9): mean of Y over what the ground hides. met (V, cells + 1): sparse, where.
    floor_blocked (cells, 9), floor_sees (cells, V): `Occlusion`'s blocked and seen of the ground.
    """

    own: Occlusion
    neighbours: scipy.sparse.csr_matrix
    below: np.ndarray
    met: scipy.sparse.csr_matrix
    floor_blocked: np.ndarray
    floor_sees: scipy.sparse.csr_matrix

    @staticmethod
    def of(
        own: Occlusion, vertices: np.ndarray, faces: np.ndarray, side: int, rng: np.random.Generator
    ) -> GroundTransfer:
        """Cast side^2 rays from each vertex and a quarter as many from each cell of the ground."""
        rays = cast(vertices, faces, vertices, own.normals, side, rng)
        row, ray = np.nonzero((rays.face == -1) & (rays.directions[..., 2] < -1e-6))
        away, start = rays.directions[row, ray], rays.origins[row]
        values = sh_basis(torch.from_numpy(away)).numpy() / side**2
        below = np.stack([np.bincount(row, column, len(vertices)) for column in values.T], axis=1)
        place = start[:, :2] - away[:, :2] * (start[:, 2:] / away[:, 2:])
        at = np.floor((place / HALF + 1) / 2 * CELLS).astype(int)
        near = ((at >= 0) & (at < CELLS)).all(axis=1)
        cell = np.where(near, at[:, 1] * CELLS + at[:, 0], CELLS**2)
        met = scipy.sparse.csr_matrix(
            (np.full(len(row), 1 / side**2), (row, cell)), shape=(len(vertices), CELLS**2 + 1)
        )
        centres = ((np.arange(CELLS) + 0.5) / CELLS * 2 - 1) * HALF
        x, y = np.meshgrid(centres, centres)
        points, up = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1), np.tile([0.0, 0.0, 1.0], (x.size, 1))
        seen = cast(vertices, faces, points, up, side // 2, rng)
        share, hit = 1 / seen.face.shape[1], seen.face != -1
        values = sh_basis(torch.from_numpy(seen.directions)).numpy()
        row, ray = np.nonzero(seen.face >= 0)
        where = (np.repeat(row, 3), faces[seen.face[row, ray]].ravel())
        sees = scipy.sparse.csr_matrix(
            (share * seen.weights[row, ray].ravel(), where), shape=(len(points), len(vertices))
        )
        neighbours = neighbours_of(faces, len(vertices))
        blocked = np.einsum("nr,nrl->nl", hit.astype(float), values) * share
        return GroundTransfer(own, neighbours, below, met, blocked, sees)

    def transfer(self, albedo: float, ground: float) -> np.ndarray:
        """T (V, 9) for an object of this albedo on a ground of that one, lit from above the ground."""
        free = unoccluded(self.own.normals)
        open_ground = unoccluded(np.array([[0.0, 0.0, 1.0]]))
        hidden = self.own.blocked + self.below
        result = free + spread(-hidden, self.own.inside, self.neighbours)
        floor_direct = open_ground - self.floor_blocked
        for _ in range(BOUNCES):
            floor = np.concatenate([floor_direct + albedo * (self.floor_sees @ result), open_ground])
            change = albedo * (self.own.seen @ result) + ground * (self.met @ floor) - hidden
            result = free + spread(change, self.own.inside, self.neighbours)
        return result
