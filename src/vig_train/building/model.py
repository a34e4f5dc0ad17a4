"""The shape model of registered meshes: principal components, and smooth deformations where they are few."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

SymmetryProjection = Callable[[np.ndarray], np.ndarray]
MAX_COMPONENTS = 16
"""Limit set by the number of columns of the fit's kernels."""
KERNEL_WIDTH = 0.25
"""Standard deviation of the Gaussian process's kernel, in sizes of the object."""
AMPLITUDES = (0.0, 0.01, 0.02, 0.04)
"""Standard deviations of smooth deformations that are tried, in sizes of the object."""
NYSTROEM_VERTICES = 400
"""Vertices from which the smooth deformations are computed (Nystroem approximation)."""
ERROR_FACTOR = 1.05
"""The fewest components are kept whose leave-one-out error is within this factor of the least."""


@dataclass(frozen=True)
class Components:
    """A linear model of shapes.

    Attributes:
        mean: (V, 3).
        basis: (K, V, 3), one standard deviation each.
        ratio: (K,) shares of the variance.
        amplitude: Of the smooth deformations added, in sizes.
        errors: Leave-one-out error by number of components 0 to K, in sizes; empty for one mesh.
        smooth_errors: The same least error by amplitude that was tried.
    """

    mean: np.ndarray
    basis: np.ndarray
    ratio: np.ndarray
    amplitude: float
    errors: tuple[float, ...]
    smooth_errors: dict[float, float]


def fit_components(
    shapes: np.ndarray, areas: np.ndarray, symmetrise: SymmetryProjection | None = None
) -> Components:
    """The model of shapes (N, V, 3) in correspondence, N from 1 on; that of one shape does not vary.

    Principal components of the sample's covariance plus that of a Gaussian process of smooth deformations
    (Luthi et al. 2018), whose amplitude and number of components leave the least error when each shape in
    turn is left out. Every vertex counts by its share `areas` (V,) of the surface.

    symmetrise: Takes deformations (M, V, 3) to those that keep the class's symmetry; None where it has none.
    """
    if len(shapes) == 1:
        return Components(shapes[0], np.zeros_like(shapes), np.zeros(1), 0.0, (), {})
    size = float(np.ptp(shapes.mean(0), axis=0).max())
    deformations = smooth_deformations(shapes.mean(0), size)
    deformations = deformations if symmetrise is None else symmetrise(deformations)
    max_components = MAX_COMPONENTS
    if len(shapes) < 3:
        chosen = AMPLITUDES[2]
        basis, ratio = _basis(shapes, deformations * chosen * size, areas, max_components)
        return Components(shapes.mean(0), basis, ratio, chosen, (), {})
    curves = {
        amplitude: leave_one_out(shapes, deformations * amplitude * size, areas, max_components) / size
        for amplitude in AMPLITUDES
    }
    least = {amplitude: float(curve.min()) for amplitude, curve in curves.items()}
    amplitude = min(least, key=least.__getitem__)
    curve = curves[amplitude]
    count = max(1, int(np.flatnonzero(curve <= ERROR_FACTOR * curve.min())[0]))
    basis, ratio = _basis(shapes, deformations * amplitude * size, areas, count)
    return Components(shapes.mean(0), basis, ratio, amplitude, tuple(curve.tolist()), least)


def leave_one_out(
    shapes: np.ndarray, deformations: np.ndarray, areas: np.ndarray, max_components: int
) -> np.ndarray:
    """Mean distance (most + 1,) of each shape (N, V, 3) from the best of the others' model, by components."""
    errors = np.zeros((len(shapes), max_components + 1))
    root = np.sqrt(areas)[:, None]
    for index in range(len(shapes)):
        others = np.delete(shapes, index, axis=0)
        basis, _ = _basis(others, deformations, areas, max_components)
        residual = shapes[index] - others.mean(0)
        flat = (basis * root).reshape(len(basis), -1)
        q, _ = np.linalg.qr(flat.T)
        weighted = (residual * root).ravel()
        for count in range(max_components + 1):
            span = q[:, : min(count, q.shape[1])]
            error = (weighted - span @ (span.T @ weighted)).reshape(residual.shape) / np.maximum(root, 1e-9)
            errors[index, count] = (areas * np.linalg.norm(error, axis=1)).sum()
    return errors.mean(0)


def _basis(
    shapes: np.ndarray, deformations: np.ndarray, areas: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """The first components (K, V, 3) of samples and smooth deformations, and their shares (K,)."""
    root = np.sqrt(areas)[:, None]
    samples = (shapes - shapes.mean(0)) / np.sqrt(max(1, len(shapes) - 1))
    rows = np.concatenate([samples, deformations]) if np.any(deformations) else samples
    flat = (rows * root).reshape(len(rows), -1)
    _, singular, components = np.linalg.svd(flat, full_matrices=False)
    rank = min(count, int((singular > 1e-6 * singular[0]).sum())) if singular[0] > 0 else 1
    components = components[:rank]
    largest = np.abs(components).argmax(axis=1)
    components = components * np.sign(components[np.arange(rank), largest])[:, None]
    basis = (components * singular[:rank, None]).reshape(rank, *shapes.shape[1:]) / np.maximum(root, 1e-9)
    return basis, singular[:rank] ** 2 / max(float((singular**2).sum()), 1e-30)


def smooth_deformations(mean: np.ndarray, size: float) -> np.ndarray:
    """Smooth deformations (M, V, 3) of a shape (V, 3); their squares add up to about one at each vertex."""
    landmarks = np.unique(np.linspace(0, len(mean) - 1, min(NYSTROEM_VERTICES, len(mean))).astype(int))
    scale = KERNEL_WIDTH * size

    def kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.asarray(np.exp(-((a[:, None] - b[None]) ** 2).sum(2) / (2 * scale**2)))

    values, vectors = np.linalg.eigh(kernel(mean[landmarks], mean[landmarks]))
    significant = values > 1e-3 * values[-1]
    fields = kernel(mean, mean[landmarks]) @ vectors[:, significant] / np.sqrt(values[significant])
    return np.asarray(np.einsum("vm,ij->mjvi", fields, np.eye(3)).reshape(-1, len(mean), 3))
