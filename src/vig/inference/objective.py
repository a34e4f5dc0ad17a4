"""The log posterior of a set of photos' latents: Eq. 4 plus the priors, with bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from vig.inference.prior import Belief, Prior
from vig.likelihood import Evaluation, Likelihood
from vig.scene import Latents, ObjectClass, latent_layout


@dataclass(frozen=True)
class Valuation:
    """The objective at B points: value (B,) float64, gradient (B, P'), normal (B, P', P') or None."""

    value: torch.Tensor
    gradient: torch.Tensor | None
    normal: torch.Tensor | None
    evaluation: Evaluation


class Objective:
    """log p(photo | z) + log p(z), to be maximised over points (B, P').

    What a point's numbers are, and within which bounds they stay, says the likelihood's `layout`; its framing
    is held at 0 unless it is free. The prior is `Prior`.
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
        layout = likelihood.layout
        if not free_framing and "framing" in layout:
            layout = layout.with_blocks(layout.block("framing").held())
        self.layout = layout
        names = [block.name for block in latent_layout(layout.count("shape")).blocks]
        self._latents = layout.indices(*names)
        geometry = likelihood.geometry
        self.dtype, self.device = geometry.dtype, geometry.device
        place: dict[str, Any] = {"dtype": self.dtype, "device": self.device}
        self.prior = Prior(layout, object_class, belief, place, prior_weight)
        self.lower, self.upper = (torch.tensor(bound, **place) for bound in layout.bounds())

    def point(self, latents: Latents, framing: torch.Tensor | None = None) -> torch.Tensor:
        """Points (B, P') within the bounds from latents and framing (B, 3), zero by default."""
        vector = latents.to_vector().to(self.device, self.dtype)
        if not torch.isfinite(vector).all():
            raise ValueError("latents must be finite; got NaN or infinity")
        if vector.shape[1] != len(self._latents):
            raise ValueError(f"latents must be (B, {len(self._latents)}); got {tuple(vector.shape)}")
        points = vector.new_zeros(len(vector), self.layout.size)
        points[:, self._latents] = vector
        if framing is not None:
            points[:, self.layout["framing"]] = framing.to(vector)
        return points.clamp(self.lower, self.upper)

    def latents(self, points: torch.Tensor) -> Latents:
        """The latents of points (B, P')."""
        return Latents.from_vector(points[:, self._latents])

    def framing(self, points: torch.Tensor) -> torch.Tensor:
        """The framing (B, 3) of points (B, P')."""
        return points[:, self.layout["framing"]]

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
