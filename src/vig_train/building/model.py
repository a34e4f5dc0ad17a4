"""The shape model of registered meshes: principal components, smooth deformations, families."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vig.scene import Family, ShapeModel
from vig_world.assets.target import nearest_coefficients

SymmetryProjection = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Components:
    """A linear model of shapes.

    Attributes:
        mean: (V, 3).
        basis: (K, V, 3), one standard deviation each.
        ratio: (K,) shares of the variance.
        amplitude: Amplitude of the smooth deformations added, in sizes.
        errors: Leave-one-out error by number of components 0 to K, in sizes; empty for one mesh.
    """

    mean: np.ndarray
    basis: np.ndarray
    ratio: np.ndarray
    amplitude: float
    errors: tuple[float, ...]


def fit_components(
    shapes: np.ndarray, areas: np.ndarray, symmetrise: SymmetryProjection | None = None
) -> Components:
    """Return the model of shapes (N, V, 3) in correspondence, N from 1 on; that of one shape does not vary.

    Principal components of the sample's covariance plus that of a Gaussian process of smooth deformations
    (Luthi et al. 2018), whose amplitude and number of components leave the least error when each shape in
    turn is left out. Every vertex counts by its share `areas` (V,) of the surface.

    symmetrise: Takes deformations (M, V, 3) to those that keep the class's symmetry; None where it has none.
    """
    if len(shapes) == 1:
        return Components(shapes[0], np.zeros_like(shapes), np.zeros(1), 0.0, ())
    mean = shapes.mean(0)
    size = float(np.ptp(mean, axis=0).max())
    deformations = smooth_deformations(mean, size)
    deformations = size * (deformations if symmetrise is None else symmetrise(deformations))
    span = _Span.of(shapes - mean, deformations, np.sqrt(areas)[:, None])
    max_components = 16  # most shape components of a class: enough for some dozens of meshes
    # Standard deviations of smooth deformations that are tried, in sizes of the object.
    amplitudes = (0.0, 0.01, 0.02, 0.04)
    if len(shapes) < 3:
        chosen, count, curve = amplitudes[2], max_components, np.zeros(0)
    else:
        curves = {amplitude: span.leave_one_out(amplitude, max_components) / size for amplitude in amplitudes}
        chosen = min(curves, key=lambda amplitude: float(curves[amplitude].min()))
        curve = curves[chosen]
        # The fewest components are kept whose leave-one-out error is within 5 % of the least.
        count = max(1, int(np.flatnonzero(curve <= 1.05 * curve.min())[0]))
    components, singular = _components(span.shapes, chosen * span.deformations, count)
    basis = span.fields(components)
    largest = np.abs(basis * span.root).reshape(len(basis), -1).argmax(axis=1)
    signs = np.sign(basis.reshape(len(basis), -1)[np.arange(len(basis)), largest])
    basis = basis * (signs * singular[: len(basis)])[:, None, None]
    ratio = singular[: len(basis)] ** 2 / max(float((singular**2).sum()), 1e-30)
    return Components(mean, basis, ratio, chosen, tuple(curve.tolist()))


@dataclass(frozen=True)
class _Span:
    """Deviations of shapes and smooth deformations in an orthonormal basis of all that they span.

    All models of some of them lie within it; its few dimensions make their decompositions quick.

    Attributes:
        shapes: (N, D), whose mean is 0.
        deformations: (M, D), at an amplitude of one.
        axes: (3 V, D) orthonormal columns: fields times `root`, flat.
        root: (V, 1) square roots of the vertices' shares of the surface.
    """

    shapes: np.ndarray
    deformations: np.ndarray
    axes: np.ndarray
    root: np.ndarray

    @staticmethod
    def of(shapes: np.ndarray, deformations: np.ndarray, root: np.ndarray) -> "_Span":
        """Make one of deviations (N, V, 3) and deformations (M, V, 3)."""
        rows = np.concatenate([shapes, deformations]) * root
        axes, coordinates = np.linalg.qr(rows.reshape(len(rows), -1).T)
        return _Span(coordinates.T[: len(shapes)], coordinates.T[len(shapes) :], axes, root)

    def fields(self, coordinates: np.ndarray) -> np.ndarray:
        """Return fields (K, V, 3) of coordinates (K, D)."""
        weighted = (coordinates @ self.axes.T).reshape(len(coordinates), -1, 3)
        return weighted / np.maximum(self.root, 1e-9)

    def leave_one_out(self, amplitude: float, max_components: int) -> np.ndarray:
        """Return mean errors (most + 1,) of shapes by the best of the others' model, by components."""
        errors = np.zeros((len(self.shapes), max_components + 1))
        for index, shape in enumerate(self.shapes):
            others = np.delete(self.shapes, index, axis=0)
            components, _ = _components(others, amplitude * self.deformations, max_components)
            residual = shape - others.mean(0)
            parts = np.zeros((max_components + 1, len(residual)))
            parts[1 : len(components) + 1] = (components @ residual)[:, None] * components
            off = np.linalg.norm(self.fields(residual - np.cumsum(parts, axis=0)), axis=2)
            errors[index] = off @ self.root[:, 0] ** 2
        return errors.mean(0)


def _components(shapes: np.ndarray, deformations: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the first components (K, D) of shapes and deformations (..., D), and all singular values."""
    samples = (shapes - shapes.mean(0)) / np.sqrt(max(1, len(shapes) - 1))
    rows = np.concatenate([samples, deformations]) if np.any(deformations) else samples
    _, singular, components = np.linalg.svd(rows, full_matrices=False)
    rank = min(count, int((singular > 1e-6 * singular[0]).sum())) if singular[0] > 0 else 1
    return components[:rank], singular


def smooth_deformations(mean: np.ndarray, size: float) -> np.ndarray:
    """Return smooth deformations (M, V, 3) of a shape (V, 3); squares add up to about one at each vertex."""
    # Computed from 400 vertices (Nystroem approximation).
    landmarks = np.unique(np.linspace(0, len(mean) - 1, min(400, len(mean))).astype(int))
    # The kernel's standard deviation is a quarter of the object's size.
    scale = 0.25 * size

    def kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.asarray(np.exp(-((a[:, None] - b[None]) ** 2).sum(2) / (2 * scale**2)))

    values, vectors = np.linalg.eigh(kernel(mean[landmarks], mean[landmarks]))
    significant = values > 1e-3 * values[-1]
    fields = kernel(mean, mean[landmarks]) @ vectors[:, significant] / np.sqrt(values[significant])
    return np.asarray(np.einsum("vm,ij->mjvi", fields, np.eye(3)).reshape(-1, len(mean), 3))


def families_of(model: ShapeModel, shapes: np.ndarray, kinds: list[str]) -> tuple[Family, ...]:
    """Return families of shapes (N, V, 3) by kind; none where fewer than two kinds have enough meshes."""
    coefficients = nearest_coefficients(model, shapes)
    counts = {kind: kinds.count(kind) for kind in sorted(set(kinds))}
    large = [kind for kind, count in counts.items() if count >= 2]
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
        # The class's unit variance counts as much as three meshes.
        spread = np.sqrt((variance + 3.0) / (len(members) + 3.0)).clip(0.1)
        mean, deviation = (tuple(np.round(values, 4).tolist()) for values in (members.mean(0), spread))
        families.append(Family(kind, mean, deviation, round(len(members) / len(kinds), 4)))
    return tuple(families)
