"""The log posterior of a set of photos' latents: Eq. 4 plus the priors, with bounds."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from vig.inference.hints import ReprojectionTerm
from vig.likelihood import Evaluation, Likelihood
from vig.parallel.threads import thread_count
from vig.scene import LatentLayout, Latents, ObjectClass, latent_layout
from vig.scene.functions import numpy_of_tensor
from vig.scene.latents import FRAMING
from vig.search import Budget, Descent
from vig_native import engine


@dataclass(frozen=True)
class RecognitionPrior:
    """The network's Gaussian for one photo's latents, as `latent_layout` orders them.

    Attributes:
        mean: (P,), the light's in the heading frame, which turns along as a point's azimuth changes.
        precision: (P,), one over the variance; 0 for latents without a Gaussian of the network.
        azimuths: (J,) radians, the views that the network thinks likely; an azimuth is drawn to the nearest.
        azimuth_precision: Precision of each of these, its power included.
    """

    mean: np.ndarray
    precision: np.ndarray
    azimuths: np.ndarray
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
        dtype: npt.DTypeLike,
        weight: float = 1.0,
    ):
        mean, precision = np.zeros(layout.size), np.zeros((layout.size, layout.size))
        for name, (deviation, weighted) in layout.prior_deviations().items():
            factor = weight if weighted else 1.0
            numbers = layout.indices(name)
            precision[numbers, numbers] = factor * np.array(deviation, np.float64) ** -2.0
        light = layout["light"]
        mean[light] = object_class.light_prior_mean
        # In the world; the network's Gaussian of the light is in the frame of the heading.
        precision[light, light] = weight * np.linalg.inv(object_class.light_prior_covariance)
        azimuth_precision = 0.0 if recognition is None else recognition.azimuth_precision
        heading_mean = heading_precision = azimuths = mean[:0]
        if recognition is not None:
            whole = latent_layout(layout.count("shape"))
            names = [block.name for block in whole.blocks if block.name != "light" and block.name in layout]
            here, there = layout.indices(*names), whole.indices(*names)
            # A product of Gaussians: precisions add up, means are weighted by them.
            added = weight * recognition.precision[there].astype(np.float64)
            total = precision[here, here] + added
            mean[here] = added * recognition.mean[there] / np.maximum(total, 1e-12)
            precision[here, here] = total
            heading_mean = recognition.mean[whole["light"]]
            heading_precision = weight * recognition.precision[whole["light"]]
            azimuths = recognition.azimuths if azimuth_precision else azimuths
        self.dtype = dtype
        gaussians = mean, precision, heading_mean, heading_precision, azimuths
        self.native = engine.prior(
            *(np.ascontiguousarray(each, dtype) for each in gaussians),
            azimuth_precision,
            float(object_class.symmetry.fold),
            layout.at("azimuth"),
            light.start,
        )
        """The same prior for the native library."""

    def value(self, points: np.ndarray) -> np.ndarray:
        """Return log p(z) of points (B, P'): (B,) float64."""
        value = np.zeros(len(points))
        self.add_to(points, value)
        return value

    def add_to(
        self,
        points: np.ndarray,
        value: np.ndarray,
        gradient: np.ndarray | None = None,
        normal: np.ndarray | None = None,
    ) -> None:
        """Add log p(z) to values (B,) float64, its gradient to (B, P'), -log p's matrix to (B, P', P')."""
        self.native.add_to(np.ascontiguousarray(points, self.dtype), value, gradient, normal)


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
        decorated: np.ndarray | None = None,
        terms: Sequence[ReprojectionTerm] = (),
        held: Mapping[str, float] = MappingProxyType({}),
    ):
        self.likelihood, self.object_class, self.decorated = likelihood, object_class, decorated
        layout = likelihood.layout
        if not free_framing and "framing" in layout:
            layout = layout.with_blocks(layout.block("framing").hold())
        if not object_class.symmetry.fold:
            layout = layout.with_blocks(layout.block("azimuth").hold())
        if object_class.shape_model.rigid:
            layout = layout.with_blocks(layout.block("shape").hold())
        self.layout = layout
        self._latents = layout.indices(*(block.name for block in latent_layout(layout.count("shape")).blocks))
        geometry = likelihood.geometry
        self.dtype = geometry.dtype
        self.prior = Prior(layout, object_class, recognition, self.dtype, prior_weight)
        self.lower, self.upper = (np.array(bound, self.dtype) for bound in layout.bounds())
        for name, number in held.items():
            in_framing = layout["framing"].start + FRAMING.labels.index(name) if name == "roll" else None
            index = layout.at(name) if in_framing is None else in_framing
            self.lower[index] = self.upper[index] = number
        self.terms = terms

    def with_likelihood(self, likelihood: Likelihood, terms: Sequence[ReprojectionTerm]) -> Objective:
        """Return a copy with another likelihood, such as that of the photos at another scale."""
        other = copy.copy(self)
        other.likelihood, other.terms = likelihood, terms
        return other

    def point(self, latents: Latents, framing: np.ndarray | None = None) -> np.ndarray:
        """Return points (B, P') within the bounds from latents and framing (B, 4); all else is 0."""
        vector = numpy_of_tensor(latents.to_vector()).astype(self.dtype)
        if not np.isfinite(vector).all():
            raise ValueError("latents must be finite; got NaN or infinity")
        if vector.shape[1] != len(self._latents):
            raise ValueError(f"latents must be (B, {len(self._latents)}); got {tuple(vector.shape)}")
        points = np.zeros((len(vector), self.layout.size), self.dtype)
        points[:, self._latents] = vector
        if framing is not None:
            points[:, self.layout["framing"]] = numpy_of_tensor(framing)
        return points.clip(self.lower, self.upper)

    def latents(self, points: np.ndarray) -> Latents:
        """Return the latents of points (B, P')."""
        return Latents.from_vector(numpy_of_tensor(points)[:, self._latents])

    def azimuth(self, points: np.ndarray) -> np.ndarray:
        """Return the azimuths (B,) of points (B, P'), radians."""
        return points[:, self.layout.at("azimuth")]

    def framing(self, points: np.ndarray) -> np.ndarray:
        """Return the framing (B, 4) of points (B, P'), 0 where the layout has none."""
        if "framing" not in self.layout:
            return np.zeros((len(points), FRAMING.size), points.dtype)
        return points[:, self.layout["framing"]]

    def evaluate_one(self, point: np.ndarray, sigma: float, derivatives: bool = True) -> Evaluation:
        """Evaluate one point (1, P') of the first photo."""
        return self(point, np.zeros(1, np.int32), np.array([sigma]), derivatives)

    def search(
        self, starts: np.ndarray, sigma: float, budget: Budget, damping: float, give_up: float
    ) -> Descent | None:
        """Search the first photo's maximum by native code, see `LevenbergMarquardt`.

        Starts (B, P') are shared out to threads; without iterations they are only evaluated. None where there
        are terms of places or another likelihood.
        """
        if self.terms or not isinstance(self.likelihood, Likelihood):
            return None
        path, value, normal, evaluations, converged = engine.search(
            self.likelihood.geometry.native,
            self.likelihood.native,
            self.prior.native,
            0,
            sigma,
            *(np.ascontiguousarray(each, self.dtype) for each in (starts, self.lower, self.upper)),
            budget.iterations,
            budget.tolerance,
            damping,
            give_up,
            budget.curvature,
            thread_count(),
        )
        steps = path[: int(evaluations.max(initial=1))]
        return Descent(
            steps[-1].copy(), value, evaluations, converged, steps, normal if len(normal) else None
        )

    def __call__(
        self, points: np.ndarray, photo: np.ndarray, sigma: np.ndarray, derivatives: bool = True
    ) -> Evaluation:
        """Evaluate points (B, P') of photos (B,) under noise sigma (B,), with images or derivatives."""
        points, photo, sigma = map(numpy_of_tensor, (points, photo, sigma))
        evaluation = self.likelihood.at(points, photo, sigma, derivatives, images=not derivatives)
        value, gradient, normal = evaluation.value, evaluation.gradient, evaluation.normal
        self.prior.add_to(points, value, gradient, normal)
        for term in self.terms:
            if gradient is None or normal is None:
                value += term.value(points)
            else:
                term.add_to(points, value, gradient, normal)
        return evaluation
