"""The prior of a point: the class's Gaussians and, where there is one, the recognition model's word."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from vig.scene import LatentLayout, ObjectClass, latent_layout, rotations_z, turn_rate_z


@dataclass(frozen=True)
class Belief:
    """A Gaussian word of the recognition model on one photo's latents, (P,) each, see `latent_layout`.

    mean; precision: one over the variance, 0 where nothing is said. The light is meant in the heading frame,
    the world turned about Z so that the eye is on -Y: as a point's azimuth changes, it turns along.
    """

    mean: torch.Tensor
    precision: torch.Tensor


class Prior:
    """log p(z) of points (B, P') up to a constant, and its derivatives.

    Blocks have the Gaussian that the layout states, light the class's in the world frame; a belief multiplies
    these. All but those of blocks that are not `weighted` are raised to the power `weight`.
    """

    def __init__(
        self,
        layout: LatentLayout,
        object_class: ObjectClass,
        belief: Belief | None,
        place: dict[str, Any],
        weight: float = 1.0,
    ):
        mean = torch.zeros(layout.size, dtype=torch.float64)
        precision = torch.zeros(layout.size, layout.size, dtype=torch.float64)
        for name, (deviation, weighted) in layout.prior_deviations().items():
            factor = weight if weighted else 1.0
            numbers = layout.indices(name)
            precision[numbers, numbers] = factor * torch.tensor(deviation, dtype=torch.float64) ** -2
        self.azimuth, self.light = layout.at("azimuth"), layout["light"]
        mean[self.light] = torch.from_numpy(object_class.light_prior_mean)
        covariance = torch.from_numpy(object_class.light_prior_covariance)
        precision[self.light, self.light] = weight * torch.linalg.inv(covariance)
        self.heading_mean: torch.Tensor | None = None
        if belief is not None:
            said = latent_layout(layout.count("shape"))
            names = [block.name for block in said.blocks if block.name != "light"]
            here, there = layout.indices(*names), said.indices(*names)
            added = weight * belief.precision[there].double()
            total = precision.diagonal()[here] + added
            mean[here] = added * belief.mean[there].double() / total.clamp_min(1e-12)
            precision[here, here] = total
            self.heading_mean = belief.mean[said["light"]].to(**place)
            self.heading_precision = (weight * belief.precision[said["light"]]).to(**place)
        self.mean, self.precision = mean.to(**place), precision.to(**place)
        places = layout.indices("azimuth", "light")
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
