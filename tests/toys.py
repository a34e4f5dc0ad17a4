"""Classes made by code: boxes with a fin, boxes with two, and posts, each with three shape components."""

from typing import Any

import numpy as np
import trimesh

from vig.scene import EXPOSURE_L00, ObjectClass, ShapeModel


def toy(kind: str, size: float = 0.25, **fields: Any) -> ObjectClass:
    """A class whose greatest extent is about `size` metres; other fields of `ObjectClass` as given.

    kind: "fin", a box whose +X side carries a fin; "fins", one that is the same after half a turn; "post", a
    round one.
    """
    if kind == "post":
        mesh = trimesh.creation.cylinder(0.25, 0.8, sections=24)
    else:
        parts = [trimesh.creation.box((0.5, 0.4, 0.8))]
        for side in (1,) if kind == "fin" else (1, -1):
            parts.append(trimesh.creation.box((0.3, 0.06, 0.4)))
            parts[-1].apply_translation((0.39 * side, 0, 0.1))
        mesh = trimesh.util.concatenate(parts)
    mesh = mesh.subdivide()
    mean = size * (mesh.vertices + [0, 0, 0.4])
    basis = np.zeros((3, *mean.shape))
    for number, axes in enumerate(([2], [0, 1], [0, 1, 2])):  # taller, wider, larger
        basis[number][:, axes] = (0.1, 0.08, 0.05)[number] * mean[:, axes]
    model = ShapeModel(
        mean.astype(np.float32),
        basis.astype(np.float32),
        mesh.faces.astype(np.int32),
        np.zeros(len(mean), np.int32),
        ("box",),
        np.array([0.6, 0.3, 0.1], np.float32),
    )
    light = np.array([EXPOSURE_L00, 0, 1.0, 0, 0, 0, 0, 0, 0])
    covariance = np.diag([0.01] + [0.5] * 8)
    fields = {"viewing_distance": 1.6 * size} | fields
    return ObjectClass(kind, model, 0.4 * size, light, covariance, **fields)
