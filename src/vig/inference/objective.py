"""The log posterior of a set of photos' latents: Eq. 4 plus the priors, with bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from vig.likelihood import Evaluation, Likelihood
from vig.scene import LatentLayout, Latents, ObjectClass, latent_layout, rotations_z, turn_rate_z
from vig.scene.latents import FRAMING


@dataclass(frozen=True)
class RecognitionPrior:
    """The network's Gaussian for one photo's latents, as `latent_layout` orders them.

    Attributes:
        mean: (P,), the light's in the heading frame, which turns along as a point's azimuth changes.
        precision: (P,), one over the variance; 0 for what the network has no Gaussian of.
        azimuths: (J,) radians, the views that the network thinks likely; an azimuth is drawn to the nearest.
        azimuth_precision: Of each of these, its power included.
    """

    mean: torch.Tensor
    precision: torch.Tensor
    azimuths: torch.Tensor
    azimuth_precision: float


class Prior:
    """log p(z) of points (B, P') up to a constant, and its derivatives.

    Blocks have the Gaussian that the layout states, light the class's in the world frame; a recognition prior
    multiplies these. All but those of blocks that are not `weighted` are raised to the power `weight`.
    """

    def __init__(
        self,
        layout: LatentLayout,
        object_class: ObjectClass,
        recognition: RecognitionPrior | None,
        place: dict[str, Any],
        weight: float = 1.0,
    ):
        mean = torch.zeros(layout.size, dtype=torch.float64)
        precision = torch.zeros(layout.size, layout.size, dtype=torch.float64)
        for name, (deviation, weighted) in layout.prior_deviations().items():
            factor = weight if weighted else 1.0
            numbers = layout.indices(name)
            precision[numbers, numbers] = factor * torch.tensor(deviation, dtype=torch.float64) ** -2
        self.azimuth, self.light, self.symmetry = layout.at("azimuth"), layout["light"], object_class.symmetry
        mean[self.light] = torch.from_numpy(object_class.light_prior_mean)
        covariance = torch.from_numpy(object_class.light_prior_covariance)
        precision[self.light, self.light] = weight * torch.linalg.inv(covariance)
        self.heading_mean: torch.Tensor | None = None
        self.azimuth_precision = 0.0 if recognition is None else recognition.azimuth_precision
        if recognition is not None:
            whole = latent_layout(layout.count("shape"))
            names = [block.name for block in whole.blocks if block.name != "light" and block.name in layout]
            here, there = layout.indices(*names), whole.indices(*names)
            added = weight * recognition.precision[there].double()
            total = precision.diagonal()[here] + added
            mean[here] = added * recognition.mean[there].double() / total.clamp_min(1e-12)
            precision[here, here] = total
            self.heading_mean = recognition.mean[whole["light"]].to(**place)
            self.azimuths = recognition.azimuths.to(**place)
            self.heading_precision = (weight * recognition.precision[whole["light"]]).to(**place)
        self.mean, self.precision = mean.to(**place), precision.to(**place)
        self._places = torch.tensor(layout.indices("azimuth", "light"), device=place.get("device"))

    def value(self, points: torch.Tensor) -> torch.Tensor:
        """log p(z): (B, P') to (B,) float64."""
        return self.with_derivatives(points)[0]

    def with_derivatives(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """log p(z) (B,) float64, its gradient (B, P') and Gauss-Newton matrix of -log p (B, P', P')."""
        off = self.mean - points
        gradient = off @ self.precision
        value = -0.5 * (off * gradient).sum(1)
        normal = self.precision.expand(len(points), -1, -1)
        if self.heading_mean is not None:
            rotation = rotations_z(-points[:, self.azimuth])
            heading = (rotation @ points[:, self.light, None])[:, :, 0]
            miss = self.heading_mean - heading
            pull = miss * self.heading_precision
            value = value - 0.5 * (miss * pull).sum(1)
            # jacobian[b, :, i]: d heading / d latent i, first azimuth, then the light in the world frame.
            jacobian = torch.cat([-turn_rate_z(heading)[:, :, None], rotation], dim=2)
            gradient = gradient.index_add(1, self._places, (pull[:, None] @ jacobian)[:, 0])
            normal = normal.clone()
            curved = (jacobian * self.heading_precision[:, None]).mT @ jacobian
            normal[:, self._places[:, None], self._places] += curved
        if self.azimuth_precision:
            all_off = self.symmetry.difference(self.azimuths, points[:, self.azimuth, None])
            turn = all_off.gather(1, all_off.abs().argmin(1, keepdim=True))[:, 0]
            value = value - 0.5 * self.azimuth_precision * turn**2
            gradient, normal = gradient.clone(), normal.clone()
            gradient[:, self.azimuth] += self.azimuth_precision * turn
            normal[:, self.azimuth, self.azimuth] += self.azimuth_precision
        return value.double(), gradient, normal


@dataclass(frozen=True)
class Valuation:
    """The objective at B points: value (B,) float64, gradient (B, P'), normal (B, P', P') or None."""

    value: torch.Tensor
    gradient: torch.Tensor | None
    normal: torch.Tensor | None
    evaluation: Evaluation


class Objective:
    """log p(photo | z) + log p(z), to be maximised over points (B, P').

    The likelihood's `layout` defines a point's numbers and their bounds. The framing is held at 0 unless
    `free_framing`, azimuth where any turn looks the same. For `recognition` and `prior_weight` see `Prior`,
    for `decorated` `pixel_prior`.
    """

    def __init__(
        self,
        likelihood: Likelihood,
        object_class: ObjectClass,
        free_framing: bool = False,
        recognition: RecognitionPrior | None = None,
        prior_weight: float = 1.0,
        decorated: torch.Tensor | None = None,
    ):
        self.likelihood, self.object_class, self.decorated = likelihood, object_class, decorated
        layout = likelihood.layout
        if not free_framing and "framing" in layout:
            layout = layout.with_blocks(layout.block("framing").held())
        if not object_class.symmetry.fold:
            layout = layout.with_blocks(layout.block("azimuth").held())
        self.layout = layout
        self._latents = layout.indices(*(block.name for block in latent_layout(layout.count("shape")).blocks))
        geometry = likelihood.geometry
        self.dtype, self.device = geometry.dtype, geometry.device
        place: dict[str, Any] = {"dtype": self.dtype, "device": self.device}
        self.prior = Prior(layout, object_class, recognition, place, prior_weight)
        self.lower, self.upper = (torch.tensor(bound, **place) for bound in layout.bounds())

    def point(self, latents: Latents, framing: torch.Tensor | None = None) -> torch.Tensor:
        """Points (B, P') within the bounds from latents and framing (B, 4); all else is 0."""
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
        """The framing (B, 4) of points (B, P'), 0 where the layout has none."""
        if "framing" not in self.layout:
            return points.new_zeros(len(points), FRAMING.size)
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
