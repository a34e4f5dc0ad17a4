"""Symmetry of a class about its vertical axis: which of its views look the same."""

import math
from dataclasses import replace
from enum import StrEnum

from vig.scene.camera import angle_difference
from vig.scene.latents import Latents
from vig.scene.light import rotate_z
from vig_renderer.arrays import Array


class Symmetry(StrEnum):
    """The turn about Z under which every shape of a class looks the same."""

    NONE = "none"
    HALF_TURN = "half-turn"
    ANY_TURN = "any-turn"

    @property
    def fold(self) -> int:
        """Return how many views of the circle look the same; 0 where all do, and azimuth means nothing."""
        return {"none": 1, "half-turn": 2, "any-turn": 0}[self]

    def difference(self, a: Array, b: Array) -> Array:
        """Return a - b, radians, of the two nearest azimuths that look like these.

        In [-pi, pi), of half turns in [-pi / 2, pi / 2), of any turn 0; arrays that broadcast.
        """
        return angle_difference(self.fold * a, self.fold * b) / max(self.fold, 1)

    def nearest(self, latents: Latents, azimuth: Array) -> Latents:
        """Return latents (B,) that look the same from the azimuths nearest to these, (B,) or () radians.

        The light turns along with the camera. Without symmetry they stay as they are.
        """
        if self is Symmetry.NONE:
            return latents
        azimuth = azimuth + self.difference(latents.azimuth, azimuth)
        light = rotate_z(latents.light, azimuth - latents.azimuth)
        return replace(latents, azimuth=azimuth, light=light)

    def canonical(self, latents: Latents) -> Latents:
        """Return latents (B,) that look the same, azimuths in [0, pi) of half turns, 0 of any turn."""
        return self.nearest(latents, math.pi / 2 if self.fold else 0.0)
