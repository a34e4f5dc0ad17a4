"""A linear (PCA) model of a class's shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch


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

    @property
    def modes(self) -> int:
        """K, how many components there are."""
        return len(self.basis)

    @staticmethod
    def fit(
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

    def vertices(self, coefficients: torch.Tensor) -> torch.Tensor:
        """Vertices (B, V, 3) of coefficients (B, K), in the coefficients' dtype and device."""
        if coefficients.ndim != 2 or coefficients.shape[1] != self.modes:
            raise ValueError(f"coefficients must be (B, {self.modes}); got {tuple(coefficients.shape)}")
        mean = torch.from_numpy(self.mean).to(coefficients)
        basis = torch.from_numpy(self.basis).to(coefficients)
        return mean + torch.einsum("bk,kvc->bvc", coefficients, basis)

    def coefficients(self, vertices: np.ndarray) -> np.ndarray:
        """Least-squares coefficients (N, K) of shapes (N, V, 3) in the model's correspondence."""
        flat = (vertices.astype(np.float64) - self.mean).reshape(len(vertices), -1)
        basis = self.basis.reshape(self.modes, -1).astype(np.float64)
        return np.linalg.lstsq(basis.T, flat.T, rcond=None)[0].T
