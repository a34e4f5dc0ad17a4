"""The object of a scene: a shape of the model in training, of a held-out design in the other splits."""

from __future__ import annotations

import numpy as np

from vig.scene import SHAPE_LIMIT, ObjectClass
from vig.scene.object_class import NO_DESIGN, nearest_shape, shape_vertices
from vig_world.dataset.spec import SceneSpec, Split

DESIGN_SPREAD = 0.5
"""Standard deviation of the model's modes by which an object's shape differs from its design."""


def draw_shape(rng: np.random.Generator, object_class: ObjectClass, split: Split) -> tuple[np.ndarray, int]:
    """Coefficients (K,) in [-3, 3] and the number of a held-out design, -1 for none.

    Training: N(0, 1), shapes of the model. Test and validation, for a class that has held-out designs: one of
    the split's own, changed by the model's modes times N(0, 1/2); the coefficients are then those of the
    model's nearest shape.
    """
    draws = rng.standard_normal(object_class.shape_model.modes)
    numbers = [] if object_class.designs is None else object_class.designs.numbers(split)
    if not numbers:
        return np.clip(draws, -SHAPE_LIMIT, SHAPE_LIMIT), NO_DESIGN
    design = numbers[int(rng.integers(len(numbers)))]
    nearest, _ = nearest_shape(object_class, design)
    return np.clip(nearest + DESIGN_SPREAD * draws, -SHAPE_LIMIT, SHAPE_LIMIT), design


def target_vertices(spec: SceneSpec, object_class: ObjectClass) -> np.ndarray:
    """The object's vertices (V, 3) float32, metres."""
    return shape_vertices(np.array(spec.shape), spec.design, object_class)
