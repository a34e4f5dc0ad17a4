"""The object itself: its shape, of the model in training, of a further design in the other splits."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch

from vig.scene import SHAPE_LIMIT, ObjectClass, ShapeModel
from vig.synthesis.designs import HELD_OUT_DESIGNS, TEAPOT_FACES, VALIDATION_DESIGNS, teapot_vertices
from vig.synthesis.spec import SceneSpec, Split

DESIGNS = HELD_OUT_DESIGNS + VALIDATION_DESIGNS
"""What a spec's `design` numbers: designs that the model was not made from, first the test split's."""
DESIGN_NUMBERS = {
    "test": range(len(HELD_OUT_DESIGNS)),
    "validation": range(len(HELD_OUT_DESIGNS), len(DESIGNS)),
}
NO_DESIGN = -1
DESIGN_SPREAD = 0.5
"""Standard deviation of the model's modes by which an object's shape differs from its design."""


def draw_shape(rng: np.random.Generator, object_class: ObjectClass, split: Split) -> tuple[np.ndarray, int]:
    """Coefficients (K,) in [-3, 3] and the number of a further design, -1 for none.

    Training: N(0, 1), shapes of the model. Test and validation, for a class made of our teapots: one of the
    split's own designs, which the model was not made from, changed by the model's modes times N(0, 1/2); the
    coefficients are then those of the model's nearest shape.
    """
    model = object_class.shape_model
    draws = rng.standard_normal(model.modes)
    if split == "train" or not has_designs(model):
        return np.clip(draws, -SHAPE_LIMIT, SHAPE_LIMIT), NO_DESIGN
    numbers = DESIGN_NUMBERS[split]
    design = numbers[int(rng.integers(len(numbers)))]
    nearest, _ = _projected(object_class, design)
    return np.clip(nearest + DESIGN_SPREAD * draws, -SHAPE_LIMIT, SHAPE_LIMIT), design


def target_vertices(spec: SceneSpec, object_class: ObjectClass) -> np.ndarray:
    """The object's vertices (V, 3) float32, metres."""
    return shape_vertices(np.array(spec.shape), spec.design, object_class)


def shape_vertices(coefficients: np.ndarray, design: int, object_class: ObjectClass) -> np.ndarray:
    """Vertices (V, 3) float32 at coefficients (K,), with a design's deviation from the model unless -1."""
    return _vertices(tuple(np.asarray(coefficients).tolist()), design, object_class)


@lru_cache(maxsize=8)
def _vertices(coefficients: tuple[float, ...], design: int, object_class: ObjectClass) -> np.ndarray:
    model = object_class.shape_model
    vertices = model.vertices(torch.tensor([coefficients], dtype=torch.float32))[0].numpy()
    if design != NO_DESIGN:
        vertices = vertices + _projected(object_class, design)[1]
        vertices[:, 2] -= vertices[:, 2].min()
    vertices.setflags(write=False)
    return vertices


def has_designs(model: ShapeModel) -> bool:
    """Whether the model's vertices correspond to those of our teapot designs."""
    return model.faces.shape == TEAPOT_FACES.shape and bool((model.faces == TEAPOT_FACES).all())


@lru_cache(maxsize=64)
def _projected(object_class: ObjectClass, design: int) -> tuple[np.ndarray, np.ndarray]:
    """A further design's coefficients (K,) in the model and its deviation (V, 3) float32 from that shape."""
    model, vertices = object_class.shape_model, teapot_vertices(DESIGNS[design])
    coefficients = model.coefficients(vertices[None])
    nearest = model.vertices(torch.from_numpy(coefficients))[0].numpy()
    return coefficients[0], (vertices - nearest).astype(np.float32)
