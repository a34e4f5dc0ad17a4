"""The log posterior of a set of photos' latents: Eq. 4 plus the priors, with bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch

from vig.inference.prior import Belief, Prior
from vig.likelihood import FRAMING_COUNT, Evaluation, Likelihood
from vig.scene import SHAPE_LIMIT, Latents, ObjectClass

FRAMING_LIMIT = (0.15, 0.15, 0.35)

LOWEST_ELEVATION, HIGHEST_ELEVATION = 0.0, math.pi / 2


@dataclass(frozen=True)
class Valuation:
    """The objective at B points: value (B,) float64, gradient (B, P'), normal (B, P', P') or None."""

    value: torch.Tensor
    gradient: torch.Tensor | None
    normal: torch.Tensor | None
    evaluation: Evaluation


class Objective:
    """log p(photo | z) + log p(z), to be maximised over points (B, P'), P' = K + 14 + 3.

    A point is a latent vector (see `Latents.to_vector`) followed by the framing (2 shifts in widths, log
    magnification). Its prior is `Prior`; shape stays within +-3, albedo in [0, 1], elevation between the
    horizon and the zenith, and the framing at 0 unless it is free.
    """

    def __init__(
        self,
        likelihood: Likelihood,
        object_class: ObjectClass,
        free_framing: bool = False,
        belief: Belief | None = None,
        prior_weight: float = 1.0,
    ):
        self.likelihood, self.free_framing = likelihood, free_framing
        modes = object_class.shape_model.modes
        self.modes, self.size = modes, modes + 14 + FRAMING_COUNT
        infinity = [math.inf] * 9
        reach = list(FRAMING_LIMIT) if free_framing else [0.0] * FRAMING_COUNT
        upper = [SHAPE_LIMIT] * modes + [math.inf, HIGHEST_ELEVATION] + [1.0] * 3 + infinity + reach
        lower = [-SHAPE_LIMIT] * modes + [-math.inf, LOWEST_ELEVATION] + [0.0] * 3
        lower += [-number for number in infinity + reach]
        geometry = likelihood.geometry
        self.dtype, self.device = geometry.dtype, geometry.device
        place: dict[str, Any] = {"dtype": self.dtype, "device": self.device}
        self.prior = Prior(object_class, belief, place, prior_weight)
        self.lower, self.upper = torch.tensor(lower, **place), torch.tensor(upper, **place)

    def point(self, latents: Latents, framing: torch.Tensor | None = None) -> torch.Tensor:
        """Points (B, P') within the bounds from latents and framing (B, 3), zero by default."""
        vector = latents.to_vector().to(self.device, self.dtype)
        if not torch.isfinite(vector).all():
            raise ValueError("latents must be finite; got NaN or infinity")
        if vector.shape[1] != self.size - FRAMING_COUNT:
            raise ValueError(f"latents must be (B, {self.size - FRAMING_COUNT}); got {tuple(vector.shape)}")
        if framing is None:
            framing = vector.new_zeros(len(vector), FRAMING_COUNT)
        return torch.cat([vector, framing.to(vector)], dim=1).clamp(self.lower, self.upper)

    def latents(self, points: torch.Tensor) -> Latents:
        """The latents of points (B, P')."""
        return Latents.from_vector(points[:, : self.size - FRAMING_COUNT])

    def __call__(
        self, points: torch.Tensor, photo: torch.Tensor, sigma: torch.Tensor, derivatives: bool = True
    ) -> Valuation:
        """Value points (B, P') of photos (B,) under noise sigma (B,); images come where no derivatives do."""
        evaluation = self.likelihood.at(points, photo, sigma, derivatives, images=not derivatives)
        if evaluation.gradient is None or evaluation.normal is None:
            return Valuation(evaluation.value + self.prior.value(points), None, None, evaluation)
        value, gradient, normal = self.prior.with_derivatives(points)
        return Valuation(
            evaluation.value + value, evaluation.gradient + gradient, evaluation.normal + normal, evaluation
        )
