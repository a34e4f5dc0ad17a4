"""A linear (PCA) model of a class's shapes."""

from dataclasses import dataclass

import numpy as np

from vig.io.checks import check_arrays, check_indices
from vig_renderer.arrays import Array, floating, like

MAX_MODES = 64
"""Components of a shape model, so that a damaged file cannot ask for any memory; so are
faces and vertices bounded."""
MAX_FACES = 400_000
ARRAYS = {
    "mean": ("float32 float64", ("V", 3)),
    "basis": ("float32 float64", ("K", "V", 3)),
    "faces": ("int32 int64", ("F", 3)),
    "parts": ("int32 int64", ("V",)),
    "explained_variance_ratio": ("float32 float64", ("K",)),
}
"""Types and shapes of the arrays of a model, see `check_arrays`; files have the first type."""


@dataclass(frozen=True)
class ShapeModel:
    """Vertices = mean + sum_k coefficient_k basis_k, in metres, standing on z = 0.

    mean: (V, 3) float32. basis: (K, V, 3) float32, one standard deviation each. faces: (F, 3) int32.
    parts: (V,) int32, index into part_names. explained_variance_ratio: (K,), of the designs' variance.
    """

    mean: np.ndarray
    basis: np.ndarray
    faces: np.ndarray
    parts: np.ndarray
    part_names: tuple[str, ...]
    explained_variance_ratio: np.ndarray

    def __post_init__(self) -> None:
        arrays = {name: getattr(self, name) for name in ARRAYS}
        sizes = check_arrays(arrays, ARRAYS)
        most_vertices = 200_000
        most = {"V": most_vertices, "F": MAX_FACES, "K": MAX_MODES}
        if sizes["V"] < 3 or any(sizes[letter] > bound for letter, bound in most.items()):
            raise ValueError(
                f"a shape model must have 3 to {most_vertices} vertices, at most {MAX_FACES} faces and"
                f" {MAX_MODES} components; it has {sizes['V']}, {sizes['F']} and {sizes['K']}"
            )
        # Greatest distance of a vertex from the origin, and its greatest move along one component, metres.
        largest = 100.0
        for name in ("mean", "basis"):
            if not (np.abs(arrays[name]) <= largest).all():
                raise ValueError(f"{name} must be finite and within {largest:g} metres")
        if not ((self.explained_variance_ratio >= 0) & (self.explained_variance_ratio <= 1.001)).all():
            raise ValueError("explained_variance_ratio must be from 0 to 1")
        check_indices("faces", self.faces, sizes["V"])
        check_indices("parts", self.parts, len(self.part_names))

    @property
    def modes(self) -> int:
        """Return K, the number of components."""
        return len(self.basis)

    @property
    def rigid(self) -> bool:
        """Return whether there is but one shape: its single component is 0."""
        return not self.basis.any()

    def vertices(self, coefficients: Array) -> Array:
        """Return vertices (B, V, 3) of coefficients (B, K), in the coefficients' dtype."""
        coefficients = floating(coefficients)
        if coefficients.ndim != 2 or coefficients.shape[1] != self.modes:
            raise ValueError(f"coefficients must be (B, {self.modes}); got {tuple(coefficients.shape)}")
        mean, basis = like(coefficients, self.mean), like(coefficients, self.basis)
        return mean + (coefficients @ basis.reshape(self.modes, -1)).reshape(-1, *mean.shape)
