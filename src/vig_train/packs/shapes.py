"""Shape models of classes whose shapes are designed by code."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from vig.scene import ShapeModel
from vig_world.assets.target import nearest_coefficients


def fit_shape_model(
    designs: np.ndarray,
    faces: np.ndarray,
    parts: np.ndarray,
    part_names: tuple[str, ...],
    modes: int = 10,
) -> ShapeModel:
    """PCA of designs (N, V, 3) in correspondence; at most N - 1 modes.

    The sign of a component is such that its largest displacement is positive, so that the model does
    not depend on the linear-algebra library.
    """
    count = len(designs)
    if not 1 <= modes < count:
        raise ValueError(f"modes must be from 1 to {count - 1} for {count} designs; got {modes}")
    flat = designs.reshape(count, -1).astype(np.float64)
    mean = flat.mean(0)
    _, singular, components = np.linalg.svd(flat - mean, full_matrices=False)
    variance = singular**2 / (count - 1)
    largest = np.abs(components).argmax(axis=1)
    components *= np.sign(components[np.arange(len(components)), largest])[:, None]
    basis = components[:modes] * np.sqrt(variance[:modes, None])
    return ShapeModel(
        mean.reshape(-1, 3).astype(np.float32),
        basis.reshape(modes, -1, 3).astype(np.float32),
        faces.astype(np.int32),
        parts.astype(np.int32),
        tuple(part_names),
        (variance[:modes] / variance.sum()).astype(np.float32),
    )


def beyond_model_mm(model: ShapeModel, vertices: np.ndarray) -> np.ndarray:
    """How far shapes (N, V, 3) are from the model's nearest (N,): mean distance of the vertices, mm."""
    nearest = model.vertices(nearest_coefficients(model, vertices))
    return 1000 * np.linalg.norm(vertices - nearest, axis=-1).mean(axis=1)


def distance_lines(model: ShapeModel, designs: Mapping[str, np.ndarray]) -> Iterator[str]:
    """How far shapes (N, V, 3) of each name are from the model, a line each."""
    for name, vertices in designs.items():
        away = beyond_model_mm(model, vertices)
        far = f"{away.min():.1f} to {away.max():.1f}, mean {away.mean():.1f} mm"
        yield f"{name} designs from the model: {far}"


def relative_distance(model: ShapeModel, vertices: np.ndarray, components: int) -> float:
    """The mean of the same over shapes (N, V, 3), as a share of each one's longest side, by a model's first
    components."""
    ratio = model.explained_variance_ratio[:components]
    fewer = replace(model, basis=model.basis[:components], explained_variance_ratio=ratio)
    return float((beyond_model_mm(fewer, vertices) / (1000 * np.ptp(vertices, axis=1).max(1))).mean())
