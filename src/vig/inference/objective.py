"""The log posterior of a set of photos' latents: Eq. 4 plus the priors, with bounds."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import torch

from vig.inference.hints import PlaceTerm
from vig.inference.prior_kernel import load_search_kernels, prior_kernel
from vig.likelihood import Evaluation, Likelihood
from vig.scene import LatentLayout, Latents, ObjectClass, latent_layout, rotate_z
from vig.scene.latents import FRAMING
from vig.search.native_descent import Valuation
from vig_renderer.device import launch


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
        # In the world; the network's Gaussian of the light is in the frame of the heading.
        precision[self.light, self.light] = weight * torch.linalg.inv(covariance)
        self.azimuth_precision = 0.0 if recognition is None else recognition.azimuth_precision
        heading_mean = heading_precision = azimuths = mean[:0]
        if recognition is not None:
            whole = latent_layout(layout.count("shape"))
            names = [block.name for block in whole.blocks if block.name != "light" and block.name in layout]
            here, there = layout.indices(*names), whole.indices(*names)
            # A product of Gaussians: precisions add up, means are weighted by them.
            added = weight * recognition.precision[there].double()
            total = precision.diagonal()[here] + added
            mean[here] = added * recognition.mean[there].double() / total.clamp_min(1e-12)
            precision[here, here] = total
            heading_mean = recognition.mean[whole["light"]]
            heading_precision = weight * recognition.precision[whole["light"]]
            azimuths = recognition.azimuths if self.azimuth_precision else azimuths
        self.mean, self.precision = mean.to(**place), precision.to(**place)
        self.heading_mean, self.heading_precision = heading_mean.to(**place), heading_precision.to(**place)
        self.azimuths = azimuths.to(**place)

    def value(self, points: torch.Tensor) -> torch.Tensor:
        """log p(z): (B, P') to (B,) float64."""
        off = self.mean - points
        value = -0.5 * (off * (off @ self.precision)).sum(1)
        if len(self.heading_mean):
            heading = rotate_z(points[:, self.light], -points[:, self.azimuth])
            value = value - 0.5 * ((self.heading_mean - heading) ** 2 * self.heading_precision).sum(1)
        if len(self.azimuths):
            off = self.symmetry.difference(self.azimuths, points[:, self.azimuth, None])
            value = value - 0.5 * self.azimuth_precision * (off**2).amin(1)
        return value.double()

    def add_to(
        self, points: torch.Tensor, value: torch.Tensor, gradient: torch.Tensor, normal: torch.Tensor
    ) -> None:
        """Add log p(z) to values (B,) float64, its gradient to (B, P'), -log p's matrix to (B, P', P')."""
        launch(prior_kernel(points.dtype), len(points), *self._arguments(points, value, gradient, normal))

    def after(self, valuation: Valuation) -> Valuation:
        """A valuation to which log p(z) is added, as `add_to` does."""
        point, results = valuation.point[None], (valuation.value, valuation.gradient, valuation.normal)
        return valuation.then(prior_kernel(point.dtype), *self._arguments(point, *results))

    def _arguments(self, points: torch.Tensor, *results: torch.Tensor) -> tuple[Any, ...]:
        """Of `prior_kernel`, results being value, gradient and normal matrix."""
        gaussians = self.mean, self.precision, self.heading_mean, self.heading_precision, self.azimuths
        places = self.azimuth_precision, float(self.symmetry.fold), self.azimuth, self.light.start
        return (points, *gaussians, *places, *results)


@dataclass(frozen=True)
class ObjectiveValue:
    """The objective at B points: value (B,) float64, gradient (B, P'), normal (B, P', P') or None."""

    value: torch.Tensor
    gradient: torch.Tensor | None
    normal: torch.Tensor | None
    evaluation: Evaluation


class Objective:
    """log p(photo | z) + log p(z), to be maximised over points (B, P').

    The likelihood's `layout` defines a point's numbers and their bounds. The framing is held at 0 unless
    `free_framing`, azimuth where any turn looks the same, the shape where the class has but one. For
    `recognition` and `prior_weight` see `Prior`, for `decorated` `pixel_prior`. `terms` are of
    places in the window; `held` are single numbers, by name, and where they are held.
    """

    def __init__(
        self,
        likelihood: Likelihood,
        object_class: ObjectClass,
        free_framing: bool = False,
        recognition: RecognitionPrior | None = None,
        prior_weight: float = 1.0,
        decorated: torch.Tensor | None = None,
        terms: Sequence[PlaceTerm] = (),
        held: Mapping[str, float] = MappingProxyType({}),
    ):
        self.likelihood, self.object_class, self.decorated = likelihood, object_class, decorated
        layout = likelihood.layout
        if not free_framing and "framing" in layout:
            layout = layout.with_blocks(layout.block("framing").held())
        if not object_class.symmetry.fold:
            layout = layout.with_blocks(layout.block("azimuth").held())
        if object_class.shape_model.rigid:
            layout = layout.with_blocks(layout.block("shape").held())
        self.layout = layout
        self._latents = layout.indices(*(block.name for block in latent_layout(layout.count("shape")).blocks))
        geometry = likelihood.geometry
        self.dtype, self.device = geometry.dtype, geometry.device
        load_search_kernels(self.dtype, self.device)
        place: dict[str, Any] = {"dtype": self.dtype, "device": self.device}
        self.prior = Prior(layout, object_class, recognition, place, prior_weight)
        self.lower, self.upper = (torch.tensor(bound, **place) for bound in layout.bounds())
        for name, number in held.items():
            in_framing = layout["framing"].start + FRAMING.labels.index(name) if name == "roll" else None
            index = layout.at(name) if in_framing is None else in_framing
            self.lower[index] = self.upper[index] = number
        self.terms = terms

    def of_likelihood(self, likelihood: Likelihood, terms: Sequence[PlaceTerm]) -> Objective:
        """The same of the photos at another scale."""
        other = copy.copy(self)
        other.likelihood, other.terms = likelihood, terms
        return other

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
        """The latents of points (B, P'), on the host."""
        return Latents.from_vector(points[:, self._latents].cpu())

    def framing(self, points: torch.Tensor) -> torch.Tensor:
        """The framing (B, 4) of points (B, P'), on the host, 0 where the layout has none."""
        if "framing" not in self.layout:
            return torch.zeros(len(points), FRAMING.size, dtype=points.dtype)
        return points[:, self.layout["framing"]].cpu()

    def of_one(self, point: torch.Tensor, sigma: float, derivatives: bool = True) -> ObjectiveValue:
        """Value one point (1, P') of the first photo."""
        photo = torch.zeros(1, dtype=torch.int32, device=self.device)
        return self(point, photo, torch.tensor([sigma], device=self.device), derivatives)

    @contextmanager
    def valuation(self, photo: int, sigma: float, derivatives: bool = True) -> Iterator[Valuation | None]:
        """See `NativeProblem`; None where there are terms of places, or a subclass values otherwise."""
        likelihood, prior = getattr(type(self.likelihood), "at", None), type(self.prior).add_to
        ours = type(self).__call__, likelihood, prior
        if self.terms or ours != (Objective.__call__, Likelihood.at, Prior.add_to):
            yield None
            return
        with self.likelihood.valuation(photo, sigma, derivatives) as valuation:
            yield None if valuation is None else self.prior.after(valuation)

    def __call__(
        self, points: torch.Tensor, photo: torch.Tensor, sigma: torch.Tensor, derivatives: bool = True
    ) -> ObjectiveValue:
        """Value points (B, P') of photos (B,) under noise sigma (B,); images come where no derivatives do."""
        evaluation = self.likelihood.at(points, photo, sigma, derivatives, images=not derivatives)
        if evaluation.gradient is None or evaluation.normal is None:
            value = evaluation.value + self.prior.value(points)
            for term in self.terms:
                value = value + term.value(points).to(value)
            return ObjectiveValue(value, None, None, evaluation)
        self.prior.add_to(points, evaluation.value, evaluation.gradient, evaluation.normal)
        for term in self.terms:
            term.add_to(points, evaluation.value, evaluation.gradient, evaluation.normal)
        return ObjectiveValue(evaluation.value, evaluation.gradient, evaluation.normal, evaluation)
