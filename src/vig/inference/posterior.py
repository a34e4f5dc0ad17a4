"""The log posterior of one photo: its pixels' priors, the network's prediction, the class's renderer."""

import functools
import math
from collections.abc import Iterable

import numpy as np

from vig.inference.families import shape_deviation
from vig.inference.hints import WindowHints
from vig.inference.objective import Objective, RecognitionPrior
from vig.inference.refinement import AZIMUTH_SPREAD
from vig.inference.settings import ExplainSettings, resolve
from vig.likelihood import NEVER, Geometry, Likelihood, Photos, log_colour_density
from vig.recognition import Prediction
from vig.recognition.prediction import START_STEP, round_to_grid
from vig.scene import ObjectClass, latent_layout


@functools.lru_cache(maxsize=8)
def geometry_of(object_class: ObjectClass, self_shadow: bool = False) -> Geometry:
    """Return the renderer's matrices of a class, made once; with self-shadow where the class has its table.

    At unit scale, as fits see the class: native code's thresholds of size suit things of a teapot's size.
    """
    transfer = object_class.transfer if self_shadow else None
    model, reflectance = object_class.at_unit_scale.shape_model, object_class.reflectance
    return Geometry(model, np.float32, transfer, reflectance)


def objective_of(
    photo: np.ndarray,
    prediction: Prediction,
    object_class: ObjectClass,
    settings: ExplainSettings,
    valid: np.ndarray | None = None,
) -> Objective:
    """Return the log posterior of one photo (150, 150, 3); `valid` as in `explain`."""
    return objectives_of(photo, prediction, object_class, settings, (1.0,), valid)[1.0]


def objectives_of(
    photo: np.ndarray,
    prediction: Prediction,
    object_class: ObjectClass,
    settings: ExplainSettings,
    scales: Iterable[float],
    valid: np.ndarray | None = None,
    hints: WindowHints | None = None,
) -> dict[float, Objective]:
    """Return the log posterior of one photo averaged over cells of 1 / scale pixels, for each scale.

    With hints the prediction is the one that they corrected.
    """
    settings = resolve(settings, object_class)
    object_class = object_class.at_unit_scale
    camera = object_class.camera(photo.shape[1], settings.camera_distance_ratio)
    log_prior, decorated = pixel_prior(photo, prediction.mask[0], settings, valid, hints)
    if valid is not None:
        # Padding is hidden or background, never the object, and neither is likelier.
        unknown = np.array([NEVER, 0.0, 0.0], log_prior.dtype)
        log_prior = np.where(valid[:, :, None], log_prior, unknown)
        decorated = decorated * valid
    geometry = geometry_of(object_class, settings.self_shadow)
    predicted = prior_of(prediction, settings, object_class)
    objectives: dict[float, Objective] = {}
    for scale in scales:
        photos = Photos(_mean_over_cells(photo, scale)[None], _mean_over_cells(log_prior, scale)[None])
        likelihood = Likelihood(
            geometry,
            camera.scale(scale),
            photos,
            settings.silhouette,
            density=settings.likelihood.density,
        )
        terms = () if hints is None else hints.terms(object_class, likelihood.camera, likelihood.layout)
        if objectives:
            objectives[scale] = next(iter(objectives.values())).with_likelihood(likelihood, terms)
            continue
        objectives[scale] = Objective(
            likelihood,
            object_class,
            settings.free_framing,
            predicted,
            settings.prior_weight,
            decorated,
            terms,
            {} if hints is None else hints.held,
        )
    return objectives


def prior_of(
    prediction: Prediction, settings: ExplainSettings, object_class: ObjectClass
) -> RecognitionPrior | None:
    """Return one photo's predicted Gaussians as a factor of the prior; of azimuth one for each peak."""
    if settings.recognition_weight == 0:
        return None
    layout, regressed = latent_layout(prediction.layout.count("shape")), prediction.numbers[0]
    places = layout.indices(*(block.name for block in prediction.layout.blocks))
    mean, precision = np.zeros((2, layout.size), regressed.dtype)
    mean[places] = regressed
    deviation = prediction.deviation[0].copy()
    deviation[prediction.layout["shape"]] = shape_deviation(prediction, object_class)
    # A Gaussian to the power w has w times the precision.
    precision[places] = settings.recognition_weight / deviation**2
    precision[layout.indices("albedo", "light")] *= settings.appearance_weight
    _, azimuths = prediction.modes(settings.peaks, settings.informed)
    azimuths = round_to_grid(azimuths[0], START_STEP)  # rounded like starts
    return RecognitionPrior(mean, precision, azimuths, settings.azimuth_weight / AZIMUTH_SPREAD**2)


def _mean_over_cells(image: np.ndarray, scale: float) -> np.ndarray:
    """Return the mean over square cells of an image (H, W, C)."""
    if scale == 1:
        return image
    cell = round(1 / scale)
    height, width = (size // cell for size in image.shape[:2])
    cells = image[: height * cell, : width * cell].reshape(height, cell, width, cell, -1)
    pooled: np.ndarray = cells.mean((1, 3))
    return pooled


def pixel_prior(
    photo: np.ndarray,
    mask: np.ndarray,
    settings: ExplainSettings,
    valid: np.ndarray | None = None,
    hints: WindowHints | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixel model's prior, adapted to the photo, and the decorated share of the second component.

    mask (H, W, 3): predicted probabilities of visible, hidden, background, each at least 2 % so that no pixel
    is decided beforehand. With `surroundings` the uniform density of the background becomes that of
    the photo's colours outside the predicted object, where the photo is `valid`. With `decoration` d, a
    visible pixel has the rendered colour with probability 1 - d, else one of the photo's colours inside the
    predicted object. As that does not depend on the latents, it joins the hidden component. Labels that hints
    exclude lose `EXCLUDED_LABEL_NATS` nats. The Gaussian model, without outliers, stays as it is.

    Returns:
        Log prior (H, W, 3) of: visible with the rendered colour; hidden or decorated; background. And the
        share (H, W) of the second that is decorated, hence visible.
    """
    base = settings.likelihood.log_prior(*mask.shape[:2])
    decorated = np.zeros(mask.shape[:2], base.dtype)
    if settings.likelihood.alpha == 1:
        return base, decorated
    # Product of experts: alpha's prior times the predicted probabilities to the power `mask_weight`.
    prior = base + settings.mask_weight * np.log(np.maximum(mask.astype(np.float64), 0.02))
    inside_photo = np.ones_like(decorated) if valid is None else valid.astype(np.float64)
    outside, inside = log_colour_density(photo, np.stack([1 - mask[..., 0], mask[..., 0]]) * inside_photo)
    prior[..., 1:] += settings.surroundings * outside[..., None]
    if hints is not None:
        hints.exclude(prior)
    if share := settings.decoration:
        # p(visible) d x density of the object's own colours.
        own = prior[..., 0] + math.log(share) + inside
        both = np.logaddexp(prior[..., 1], own)
        decorated = np.exp(own - both)
        prior[..., 0] += math.log1p(-share)
        prior[..., 1] = both
    return prior, decorated
