"""The object of a scene: a shape near one of the split's designs, or of the model where it has none."""

from functools import lru_cache

import numpy as np

from vig.scene import SHAPE_LIMIT, ObjectClass, ShapeModel
from vig_world.assets.held_out import held_out_designs_of
from vig_world.dataset.spec import SceneSpec, Split

DESIGN_SPREAD = 0.5
"""Standard deviation of the model's modes by which an object's shape differs from its design."""

NO_DESIGN = -1


def draw_shape(rng: np.random.Generator, object_class: ObjectClass, split: Split) -> tuple[np.ndarray, int]:
    """Return coefficients (K,) in [-3, 3] and the number of a design, -1 for none.

    One of the class's designs of the split, changed by the model's modes times N(0, 1/2); the coefficients
    are then those of the model's nearest shape. Where the split has no designs, N(0, 1): a model's shape.
    """
    draws = rng.standard_normal(object_class.shape_model.modes)
    designs = held_out_designs_of(object_class)
    numbers = [] if designs is None else [number for number, of in enumerate(designs.splits) if of == split]
    if not numbers:
        return np.clip(draws, -SHAPE_LIMIT, SHAPE_LIMIT), NO_DESIGN
    design = numbers[int(rng.integers(len(numbers)))]
    nearest, _ = nearest_shape(object_class, design)
    return np.clip(nearest + DESIGN_SPREAD * draws, -SHAPE_LIMIT, SHAPE_LIMIT), design


def target_vertices(spec: SceneSpec, object_class: ObjectClass) -> np.ndarray:
    """Return the object's vertices (V, 3) float32, metres."""
    return standing_vertices(np.array(spec.shape), spec.design, object_class)


def standing_vertices(coefficients: np.ndarray, design: int, object_class: ObjectClass) -> np.ndarray:
    """Return the vertices of `shape_vertices`, raised or lowered so that the lowest is at z = 0."""
    vertices = shape_vertices(coefficients, design, object_class)
    lowest = vertices[:, 2].min()
    return vertices if lowest == 0 else vertices - np.array([0, 0, lowest], np.float32)


def shape_vertices(coefficients: np.ndarray, design: int, object_class: ObjectClass) -> np.ndarray:
    """Return vertices (V, 3) float32 at coefficients (K,), plus a held-out design's deviation from the model.

    design: its number in `held_out_designs_of`, or `NO_DESIGN`.
    """
    return _vertices(tuple(np.asarray(coefficients).tolist()), design, object_class)


@lru_cache(maxsize=8)
def _vertices(coefficients: tuple[float, ...], design: int, object_class: ObjectClass) -> np.ndarray:
    model = object_class.shape_model
    change = np.array(coefficients, np.float32) @ model.basis.reshape(model.modes, -1)
    vertices = model.mean + change.reshape(-1, 3)
    if design != NO_DESIGN:
        vertices = vertices + nearest_shape(object_class, design)[1]
        vertices[:, 2] -= vertices[:, 2].min()
    vertices.setflags(write=False)
    return vertices


@lru_cache(maxsize=512)
def nearest_shape(object_class: ObjectClass, design: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a model's coefficients (K,) nearest to a held-out design, and its deviation, (V, 3) float32."""
    designs, model = held_out_designs_of(object_class), object_class.shape_model
    if designs is None or not 0 <= design < len(designs.vertices):
        count = 0 if designs is None else len(designs.vertices)
        raise ValueError(
            f"expected one of the {count} held-out designs of '{object_class.name}'; got {design}"
        )
    vertices = designs.vertices[design]
    coefficients = nearest_coefficients(model, vertices[None])
    nearest = model.vertices(coefficients)[0]
    return coefficients[0], (vertices - nearest).astype(np.float32)


def nearest_coefficients(model: ShapeModel, vertices: np.ndarray) -> np.ndarray:
    """Return least-squares coefficients (N, K) of shapes (N, V, 3) in the model's correspondence."""
    flat = (vertices.astype(np.float64) - model.mean).reshape(len(vertices), -1)
    basis = model.basis.reshape(model.modes, -1).astype(np.float64)
    return np.linalg.lstsq(basis.T, flat.T, rcond=None)[0].T
