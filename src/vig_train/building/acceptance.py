"""Acceptance of registered meshes into the class: judged by distances both ways and by folds."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from vig_train.building.surface import SurfaceSample, sample_points

MAX_UNMATCHED_SHARE = 0.03  # share of points without counterpart that is accepted


@dataclass(frozen=True)
class Quality:
    """Fit of a template to a mesh, in sizes of the mesh.

    Attributes:
        mean: Mean distance, both ways.
        unmatched_mesh: Share of the mesh without counterpart on the template.
        unmatched_template: Share of the template without counterpart on the mesh.
        folded_share: Share of edges folded over.
        median_ratio: Distance of its shape from the class's median shape, over the upper quartile of the
            others' distances.
        max_unmatched_mesh: Greatest accepted `unmatched_mesh`.
    """

    mean: float
    unmatched_mesh: float
    unmatched_template: float
    folded_share: float
    median_ratio: float = 1.0
    max_unmatched_mesh: float = MAX_UNMATCHED_SHARE

    @property
    def reason(self) -> str:
        """Return why the mesh does not belong; empty when it does."""
        if self.unmatched_mesh > self.max_unmatched_mesh:
            return f"{self.unmatched_mesh:.0%} of it is nothing like the template"
        if self.unmatched_template > MAX_UNMATCHED_SHARE:
            return f"it lacks {self.unmatched_template:.0%} of the template"
        if self.mean > 0.012:  # sizes
            return f"it is {self.mean:.1%} of its size off"
        if self.folded_share > 0.04:
            return f"the template folds over itself on it, at {self.folded_share:.0%} of its edges"
        # A template can be bent into a thing of another kind, whose shape is then far from all others.
        if self.median_ratio > 2.4:
            return f"its shape is {self.median_ratio:.1f} times as far from the median as those of others"
        return ""


def quality_of(
    template: np.ndarray, registered: np.ndarray, faces: np.ndarray, target: SurfaceSample
) -> Quality:
    """Compare a registered template (V, 3) with the surface it was carried onto."""
    size = target.size
    points = sample_points(registered, faces, 20_000)
    mesh_distance = cKDTree(points).query(target.points)[0] / size
    template_distance = cKDTree(target.points).query(points)[0] / size
    spacing = float(np.median(cKDTree(target.points).query(target.points, 2)[0][:, 1])) / size / 2
    mean = max(0.0, float(mesh_distance.mean() + template_distance.mean()) / 2 - spacing)
    unmatched_distance = 0.03  # distance, in sizes, from which a point has no counterpart
    return Quality(
        mean,
        float((mesh_distance > unmatched_distance).mean()),
        float((template_distance > unmatched_distance).mean()),
        max(0.0, folded_share(registered, faces) - folded_share(template, faces)),
    )


def judge_meshes(
    qualities: Mapping[int, Quality], shapes: np.ndarray, medoid: int, symmetry: str
) -> dict[int, Quality]:
    """Return the qualities of meshes as members of one class.

    Args:
        qualities: Fit quality of each mesh by itself, by its index.
        shapes: (N, V, 3), the template as it lies on each mesh.
        medoid: Index of the mesh that the template was made from. Its unmatched share, due to the
            template's few vertices, is subtracted from the others'.
        symmetry: Symmetry of the class.
    """
    # the shape model of a surface of revolution has no handles or spouts
    max_unmatched = 0.09 if symmetry == "any-turn" else MAX_UNMATCHED_SHARE
    of_medoid = qualities[medoid].unmatched_mesh
    compared = {
        index: replace(
            quality,
            unmatched_mesh=max(0.0, quality.unmatched_mesh - of_medoid),
            max_unmatched_mesh=max_unmatched,
        )
        for index, quality in qualities.items()
    }
    well_registered = [index for index, quality in compared.items() if not quality.reason]
    ratios = median_distance_ratios(shapes[well_registered])
    for index, ratio in zip(well_registered, ratios, strict=True):
        compared[index] = replace(compared[index], median_ratio=float(ratio))
    return compared


def median_distance_ratios(shapes: np.ndarray) -> np.ndarray:
    """Return distances (N,) of shapes (N, V, 3) from their median, over the upper quartile of the others'."""
    if len(shapes) < 4:
        return np.ones(len(shapes))
    distance = np.sqrt(((shapes - np.median(shapes, axis=0)) ** 2).sum(2).mean(1))
    usual = [np.quantile(np.delete(distance, number), 0.75) for number in range(len(distance))]
    return np.asarray(distance / np.maximum(usual, 1e-12))


def folded_share(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Return the share of edges whose two faces point against each other (cosine of normals below -0.5)."""
    angles = trimesh.Trimesh(vertices, faces, process=False).face_adjacency_angles
    return float((angles > math.radians(120)).mean()) if len(angles) else 0.0
