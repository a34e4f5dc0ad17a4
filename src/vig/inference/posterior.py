"""The log posterior of one photo: its pixels' priors, the network's prediction, the class's renderer."""

from __future__ import annotations

import functools
from collections.abc import Iterable

import torch

from vig.inference.objective import Objective, RecognitionPrior
from vig.inference.settings import ExplainSettings
from vig.likelihood import NEVER, Likelihood, Photos, log_colour_density
from vig.likelihood.kernels.geometry import Geometry
from vig.recognition import Prediction
from vig.scene import Camera, ObjectClass, latent_layout


@functools.lru_cache(maxsize=8)
def geometry_of(object_class: ObjectClass, self_shadow: bool = False, device: str = "cpu") -> Geometry:
    """The renderer's matrices of a class, made once; with self-shadow where the class has a table of it."""
    transfer = object_class.transfer if self_shadow else None
    return Geometry(object_class.shape_model, torch.float32, device, transfer)


def objective_of(
    photo: torch.Tensor,
    prediction: Prediction,
    object_class: ObjectClass,
    settings: ExplainSettings,
    valid: torch.Tensor | None = None,
) -> Objective:
    """The log posterior of one photo (150, 150, 3); `valid` as in `explain`."""
    return objectives_of(photo, prediction, object_class, settings, (1.0,), valid)[1.0]


def objectives_of(
    photo: torch.Tensor,
    prediction: Prediction,
    object_class: ObjectClass,
    settings: ExplainSettings,
    scales: Iterable[float],
    valid: torch.Tensor | None = None,
) -> dict[float, Objective]:
    """The log posterior of one photo averaged over cells of 1 / scale pixels, for each scale."""
    camera = Camera.standard(photo.shape[1], object_class.target_height)
    log_prior = pixel_prior(photo, prediction.mask[0], settings, valid)
    if valid is not None:
        unknown = torch.tensor([NEVER, 0.0, 0.0], dtype=log_prior.dtype)
        log_prior = torch.where(valid[:, :, None], log_prior, unknown)
    geometry, predicted = geometry_of(object_class, settings.self_shadow), prior_of(prediction, settings)
    objectives = {}
    for scale in scales:
        photos = Photos(_pooled(photo, scale)[None], _pooled(log_prior, scale)[None])
        likelihood = Likelihood(geometry, camera.scaled(scale), photos, settings.silhouette)
        objectives[scale] = Objective(
            likelihood, object_class, bool(settings.free_framing), predicted, settings.prior_weight
        )
    return objectives


def prior_of(prediction: Prediction, settings: ExplainSettings) -> RecognitionPrior | None:
    """One photo's predicted Gaussians of every latent but azimuth, as a factor of the prior."""
    if settings.recognition_weight == 0:
        return None
    layout, regressed = latent_layout(prediction.layout.count("shape")), prediction.numbers[0]
    places = layout.indices(*(block.name for block in prediction.layout.blocks))
    mean, precision = regressed.new_zeros(2, layout.size)
    mean[places] = regressed
    precision[places] = settings.recognition_weight / prediction.deviation[0] ** 2
    return RecognitionPrior(mean, precision)


def _pooled(image: torch.Tensor, scale: float) -> torch.Tensor:
    """The mean over square cells of an image (H, W, C)."""
    if scale == 1:
        return image
    cell = round(1 / scale)
    return torch.nn.functional.avg_pool2d(image.permute(2, 0, 1)[None], cell)[0].permute(1, 2, 0)


def pixel_prior(
    photo: torch.Tensor, mask: torch.Tensor, settings: ExplainSettings, valid: torch.Tensor | None = None
) -> torch.Tensor:
    """Log prior (H, W, 3) of a pixel visible, hidden, background: the pixel model's, made the photo's own.

    mask (H, W, 3): predicted probabilities of the same three, each at least 2 % so that no pixel is decided
    beforehand. With `surroundings` the uniform density of what is not the object becomes that of the
    photo's colours outside the predicted object, where the photo is `valid`. The Gaussian model, without
    outliers, stays as it is.
    """
    base = settings.likelihood.log_prior(*mask.shape[:2])
    if settings.likelihood.alpha == 1:
        return base
    prior = base + settings.mask_weight * mask.double().clamp_min(0.02).log()
    if settings.surroundings > 0:
        outside = 1 - mask[..., 0] if valid is None else (1 - mask[..., 0]) * valid
        density = settings.surroundings * log_colour_density(photo, outside)
        prior[..., 1] += density
        prior[..., 2] += density
    return prior
