"""Families of a class: shapes with other holes through them, between which there is nothing."""

from __future__ import annotations

import numpy as np
import trimesh

from vig.scene import Family, ShapeModel
from vig_train.building.surface import Surface
from vig_train.building.template import outer_surface
from vig_world.assets.target import nearest_coefficients

LEAST = 2
"""Meshes of one kind that make a family."""
PRIOR_COUNT = 3.0
"""Meshes of the whole class that count in a family's deviations."""
LEAST_DEVIATION = 0.1


def holes(vertices: np.ndarray, faces: np.ndarray, seen: Surface) -> int:
    """How many holes go through a mesh's outer surface: its genus."""
    surface = trimesh.Trimesh(*outer_surface(vertices, faces, seen), process=False)
    return max(0, 1 - int(surface.euler_number) // 2)


def families_of(model: ShapeModel, shapes: np.ndarray, kinds: list[str]) -> tuple[Family, ...]:
    """Families of shapes (N, V, 3) by kind; none where all but single ones are of one kind."""
    coefficients = nearest_coefficients(model, shapes)
    counts = {kind: kinds.count(kind) for kind in sorted(set(kinds))}
    large = [kind for kind, count in counts.items() if count >= LEAST]
    if len(large) < 2:
        return ()
    means = {kind: coefficients[[k == kind for k in kinds]].mean(0) for kind in large}
    away = np.stack([((coefficients - means[kind]) ** 2).sum(1) for kind in large])
    closest = [large[place] for place in away.argmin(0)]
    nearest = [kind if kind in large else other for kind, other in zip(kinds, closest, strict=True)]
    families = []
    for kind in large:
        own = coefficients[[each == kind for each in nearest]]
        variance = ((own - own.mean(0)) ** 2).sum(0)
        spread = np.sqrt((variance + PRIOR_COUNT) / (len(own) + PRIOR_COUNT)).clip(LEAST_DEVIATION)
        mean, deviation = (tuple(np.round(each, 4).tolist()) for each in (own.mean(0), spread))
        families.append(Family(kind, mean, deviation, round(len(own) / len(kinds), 4)))
    return tuple(families)
