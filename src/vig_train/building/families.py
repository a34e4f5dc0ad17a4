"""Families of a class: shapes of different topology, between which no shape is interpolated."""

from __future__ import annotations

import numpy as np
import trimesh

from vig.scene import Family, ShapeModel
from vig_train.building.surface import SurfaceSample
from vig_train.building.template import outer_surface
from vig_world.assets.target import nearest_coefficients

MIN_FAMILY_MESHES = 2
"""Least number of meshes of one genus that make a family."""
PRIOR_COUNT = 3.0
"""Weight, in meshes, of the class's unit variance in a family's variance."""
MIN_DEVIATION = 0.1
"""Least standard deviation of a component within a family, in those of the class."""


def genus(vertices: np.ndarray, faces: np.ndarray, visible: SurfaceSample) -> int:
    """Return the genus of a mesh's outer surface: the number of holes through it."""
    surface = trimesh.Trimesh(*outer_surface(vertices, faces, visible), process=False)
    return max(0, 1 - int(surface.euler_number) // 2)


def families_of(model: ShapeModel, shapes: np.ndarray, kinds: list[str]) -> tuple[Family, ...]:
    """Return families of shapes (N, V, 3) by kind; none where fewer than two kinds have enough meshes."""
    coefficients = nearest_coefficients(model, shapes)
    counts = {kind: kinds.count(kind) for kind in sorted(set(kinds))}
    large = [kind for kind, count in counts.items() if count >= MIN_FAMILY_MESHES]
    if len(large) < 2:
        return ()
    means = {kind: coefficients[[k == kind for k in kinds]].mean(0) for kind in large}
    squared_distances = np.stack([((coefficients - means[kind]) ** 2).sum(1) for kind in large])
    closest = [large[index] for index in squared_distances.argmin(0)]
    nearest = [kind if kind in large else fallback for kind, fallback in zip(kinds, closest, strict=True)]
    families = []
    for kind in large:
        members = coefficients[[name == kind for name in nearest]]
        variance = ((members - members.mean(0)) ** 2).sum(0)
        spread = np.sqrt((variance + PRIOR_COUNT) / (len(members) + PRIOR_COUNT)).clip(MIN_DEVIATION)
        mean, deviation = (tuple(np.round(values, 4).tolist()) for values in (members.mean(0), spread))
        families.append(Family(kind, mean, deviation, round(len(members) / len(kinds), 4)))
    return tuple(families)
