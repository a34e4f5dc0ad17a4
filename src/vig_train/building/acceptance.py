"""Whether a registered mesh belongs to the class: what is told by distances both ways and by folds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from vig_train.building.surface import Surface, edges_of, points_on
from vig_world.mesh import face_normals

SAMPLES = 20_000
FAR, MOST_FAR = 0.03, 0.03
"""Distance in sizes from which a place has no counterpart, and the share of such places that is accepted."""
MOST_BESIDE = 0.09
"""The same of what any turn leaves the same: handles and spouts are not of the shape there."""
MOST_MEAN = 0.012
"""Mean distance in sizes that is accepted."""
MOST_FOLDED = 0.04
"""Share of a mesh's edges that are folded over."""
MOST_APART = 2.4
"""A template can be bent into what is no such thing; its shape is then this much farther than others."""


@dataclass(frozen=True)
class Quality:
    """How well a template lies on a mesh, in sizes of the mesh.

    Attributes:
        mean: Mean distance, both ways.
        lacking: Share of the mesh that the template does not reach.
        spare: Share of the template that the mesh does not have.
        folded: Share of edges folded over.
        apart: How far its shape is from the class's median, over how far three in four others are.
        most_lacking: The share of the mesh that the template may leave out.
    """

    mean: float
    lacking: float
    spare: float
    folded: float
    apart: float = 1.0
    most_lacking: float = MOST_FAR

    @property
    def reason(self) -> str:
        """Why the mesh does not belong; empty when it does."""
        if self.lacking > self.most_lacking:
            return f"{self.lacking:.0%} of it is nothing like the template"
        if self.spare > MOST_FAR:
            return f"it lacks {self.spare:.0%} of the template"
        if self.mean > MOST_MEAN:
            return f"it is {self.mean:.1%} of its size off"
        if self.folded > MOST_FOLDED:
            return f"the template folds over itself on it, at {self.folded:.0%} of its edges"
        if self.apart > MOST_APART:
            return f"its shape is {self.apart:.1f} times as far from the median as those of others"
        return ""


def quality_of(template: np.ndarray, registered: np.ndarray, faces: np.ndarray, target: Surface) -> Quality:
    """Compare a registered template (V, 3) with the surface it was carried onto."""
    size = target.size
    face, weights = points_on(registered, faces, SAMPLES)
    points = np.einsum("nk,nkd->nd", weights, registered[faces[face]])
    back = cKDTree(points).query(target.points)[0] / size
    ahead = cKDTree(target.points).query(points)[0] / size
    spacing = float(np.median(cKDTree(target.points).query(target.points, 2)[0][:, 1])) / size / 2
    mean = max(0.0, float(back.mean() + ahead.mean()) / 2 - spacing)
    return Quality(
        mean,
        float((back > FAR).mean()),
        float((ahead > FAR).mean()),
        max(0.0, folded(registered, faces) - folded(template, faces)),
    )


def apart(shapes: np.ndarray) -> np.ndarray:
    """How far each of shapes (N, V, 3) is from their median, over how far three in four others are: (N,)."""
    if len(shapes) < 4:
        return np.ones(len(shapes))
    away = np.sqrt(((shapes - np.median(shapes, axis=0)) ** 2).sum(2).mean(1))
    others = [np.quantile(np.delete(away, number), 0.75) for number in range(len(away))]
    return np.asarray(away / np.maximum(others, 1e-12))


def folded(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Share of the edges between faces that point against each other."""
    normals = face_normals(vertices, faces)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    edges = np.sort(edges_of(faces), axis=1)
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort(edges.T)
    same = (edges[order][1:] == edges[order][:-1]).all(1)
    first, second = owner[order][:-1][same], owner[order][1:][same]
    return float(((normals[first] * normals[second]).sum(1) < -0.5).mean())
