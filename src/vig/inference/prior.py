"""The prior of a point: the class's Gaussians and, where there is one, the recognition model's word."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from vig.likelihood import FRAMING_COUNT
from vig.scene import ObjectClass, rotations_z, turn_rate_z

FRAMING_SD = (0.04, 0.04, 0.12)
"""Prior of a free framing: shift in widths, log magnification."""


@dataclass(frozen=True)
class Belief:
    """A Gaussian word of the recognition model on one photo's latents, (K + 14,) each, in their order.

    mean; precision: one over the variance, 0 where nothing is said. The light is meant in the heading frame,
    the world turned about Z so that the eye is on -Y: as a point's azimuth changes, it turns along.
    """

    mean: torch.Tensor
    precision: torch.Tensor


class Prior:
    """log p(z) of points (B, P') up to a constant, and its derivatives.

    Shape coefficients are N(0, 1), light has the class's Gaussian in the world frame, framing is Gaussian;
    a belief multiplies these. All but the framing's is raised to the power `weight`.
    """

    def __init__(
        self, object_class: ObjectClass, belief: Belief | None, place: dict[str, Any], weight: float = 1.0
    ):
        modes = object_class.shape_model.modes
        size = modes + 14 + FRAMING_COUNT
        mean = torch.zeros(size, dtype=torch.float64)
        precision = torch.zeros(size, size, dtype=torch.float64)
        precision[range(modes), range(modes)] = 1.0
        self.azimuth, self.light = modes, slice(modes + 5, modes + 14)
        mean[self.light] = torch.from_numpy(object_class.light_prior_mean)
        covariance = torch.from_numpy(object_class.light_prior_covariance)
        precision[self.light, self.light] = torch.linalg.inv(covariance)
        precision *= weight
        framing = range(modes + 14, size)
        precision[framing, framing] = torch.tensor(FRAMING_SD, dtype=torch.float64) ** -2
        self.heading_mean: torch.Tensor | None = None
        if belief is not None:
            first = modes + 5
            added = weight * belief.precision[:first].double()
            total = precision.diagonal()[:first] + added
            mean[:first] = added * belief.mean[:first].double() / total.clamp_min(1e-12)
            precision[range(first), range(first)] = total
            self.heading_mean = belief.mean[first:].to(**place)
            self.heading_precision = (weight * belief.precision[first:]).to(**place)
        self.mean, self.precision = mean.to(**place), precision.to(**place)
        places = [self.azimuth, *range(self.light.start, self.light.stop)]
        self._places = torch.tensor(places, device=place.get("device"))

    def value(self, points: torch.Tensor) -> torch.Tensor:
        """log p(z): (B, P') to (B,) float64."""
        off = points - self.mean
        value = -0.5 * (off * (off @ self.precision)).sum(1)
        if self.heading_mean is not None:
            _, heading = self._heading(points)
            value = value - 0.5 * ((heading - self.heading_mean) ** 2 * self.heading_precision).sum(1)
        return value.double()

    def with_derivatives(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """log p(z) (B,) float64, its gradient (B, P') and Gauss-Newton matrix of -log p (B, P', P')."""
        off = self.mean - points
        gradient = off @ self.precision
        value = -0.5 * (off * gradient).sum(1)
        normal = self.precision.expand(len(points), -1, -1)
        if self.heading_mean is not None:
            turned, heading = self._heading(points)
            miss = self.heading_mean - heading
            pull = miss * self.heading_precision
            value = value - 0.5 * (miss * pull).sum(1)
            # jacobian[b, :, i]: d heading / d latent i, first azimuth, then the light in the world frame.
            jacobian = torch.cat([-turn_rate_z(heading)[:, :, None], turned], dim=2)
            gradient[:, self._places] += (pull[:, None] @ jacobian)[:, 0]
            normal = normal.clone()
            curved = (jacobian * self.heading_precision[:, None]).mT @ jacobian
            normal[:, self._places[:, None], self._places] += curved
        return value.double(), gradient, normal

    def _heading(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The turn of the world to the heading frame (B, 9, 9), and the light in it (B, 9)."""
        turned = rotations_z(-points[:, self.azimuth])
        return turned, (turned @ points[:, self.light, None])[:, :, 0]
