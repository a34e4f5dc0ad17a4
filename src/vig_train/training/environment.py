"""What glossy drawn objects mirror."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Environment:
    """What a glossy thing mirrors: a gradient from ground to sky, and lamps and windows.

    Attributes:
        ground: (3,) radiance below.
        sky: (3,) above.
        directions: (L, 3) unit, towards the lamps.
        sharpness: (L,) of each lamp's lobe.
        radiance: (L, 3).
    """

    ground: np.ndarray
    sky: np.ndarray
    directions: np.ndarray
    sharpness: np.ndarray
    radiance: np.ndarray

    @staticmethod
    def draw(rng: np.random.Generator) -> Environment:
        """An indoor environment."""
        count = int(rng.integers(1, 5))
        directions = rng.normal(size=(count, 3))
        directions[:, 2] = np.abs(directions[:, 2]) + 0.2
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        tint = rng.uniform(0.85, 1.0, (count, 3))
        strength = np.exp(rng.uniform(np.log(2), np.log(25), (count, 1)))
        return Environment(
            rng.uniform(0.05, 0.7) * rng.uniform(0.7, 1, 3),
            rng.uniform(0.2, 1.1) * rng.uniform(0.85, 1, 3),
            directions,
            np.exp(rng.uniform(np.log(10), np.log(800), count)),
            strength * tint,
        )

    def radiance_from(self, directions: np.ndarray, roughness: float) -> np.ndarray:
        """Radiance (N, 3) from unit directions (N, 3), blurred by the roughness of what mirrors it."""
        up = np.clip(0.5 + directions[:, 2:] / (0.1 + 2 * roughness), 0, 1)
        total = self.ground + (self.sky - self.ground) * up
        for towards, sharpness, radiance in zip(self.directions, self.sharpness, self.radiance, strict=True):
            wide = 1 / (1 / sharpness + roughness**2)
            lobe = np.exp(wide * (directions @ towards - 1)) * min(1.0, wide / sharpness)
            total = total + lobe[:, None] * radiance
        return total
