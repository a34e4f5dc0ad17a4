"""Confidence in a selected fit: its masks, its confidence features, the verdict and the deviations."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch.nn import functional

from vig.inference.calibration import CONFIDENCE_FEATURES, FitCalibration
from vig.inference.objective import Objective
from vig.inference.refinement import DISTINCT_AZIMUTH, Selection
from vig.inference.settings import ExplainSettings, Fit, Verdict
from vig.likelihood import PixelModel, SpatialModel, mixture, spatial_posterior
from vig.recognition import Prediction
from vig.scene import Latents, angle_difference

MASK_SIGMA = 0.1
"""Noise under which a pixel of the fit is taken as visible, as in the paper."""
LEAST_VISIBLE = 0.3
"""Predicted probability from which a pixel may well show the object."""
LEAST_PROBABILITY = 1e-3
"""Floor of a pixel's probability in `mask_log_probability`, so that none decides alone."""
MOST_ROLL_GAIN = 2.0
"""Nats a pixel, either way, at which the feature is clipped."""
MOST_GAP = 3000.0
"""Nats at which the evidence gap is clipped."""

ROLL = math.radians(8.0)
"""How far a rendering is rolled in the image, either way."""
ROLL_SIGMA = 0.05
"""Noise of the comparison, linear RGB: wider than a fit's, as details no longer meet."""
ROLL_PIXELS = 50
"""Added to the number of visible pixels, so that few of them do not weigh much."""


def assess(
    objective: Objective,
    selection: Selection,
    prediction: Prediction,
    settings: ExplainSettings,
    calibration: FitCalibration | None,
) -> Fit:
    """Make a `Fit` of a selection: masks, verdict, confidence, deviations.

    With a calibration, a fit is trusted when its confidence reaches the threshold; without, when no other
    view comes near it and the recognition model's best guess is of the same view. `objective` is that of the
    photo at its full size.
    """
    zero, sigma = torch.zeros(1, dtype=torch.int32), torch.tensor([settings.likelihood.sigma])
    at_fit = objective(selection.point, zero, sigma)
    assert at_fit.normal is not None
    latents = objective.latents(selection.point)
    shown = _show(objective, selection.point, latents, settings.likelihood)
    features = _features(latents, shown, prediction, selection)
    confidence, verdict, reason = _verdict(selection, features, calibration, bool(shown.mask.any()))
    deviation = _deviation(objective, selection.point[0], at_fit.normal[0])
    if calibration is not None:
        deviation = calibration.widened(deviation, features, verdict is Verdict.TRUSTED)
    ambiguous = verdict is Verdict.AMBIGUOUS and selection.elsewhere
    return Fit(
        latents=latents,
        framing=objective.framing(selection.point)[0],
        deviation=deviation,
        visible=shown.visible,
        mask=shown.mask,
        mask_by_pixel=shown.by_pixel > 0.5,
        amodal=shown.amodal,
        verdict=verdict,
        reason=reason,
        confidence=confidence,
        confidence_features=features,
        evidence=float(at_fit.value),
        start_evidence=selection.start_evidence,
        evaluations=selection.evaluations,
        alternative=selection.alternative if ambiguous else None,
    )


@dataclass(frozen=True)
class _Shown:
    """Images (H, W) of a fit; `visible` is the pixel model's posterior, `by_pixel` that of single pixels."""

    observed: torch.Tensor
    rendered: torch.Tensor
    coverage: torch.Tensor
    log_prior: torch.Tensor
    amodal: torch.Tensor
    by_pixel: torch.Tensor
    visible: torch.Tensor

    @property
    def mask(self) -> torch.Tensor:
        return self.visible > 0.5


def _show(objective: Objective, point: torch.Tensor, latents: Latents, model: PixelModel) -> _Shown:
    """Evaluate one point (1, P') under the masks' noise."""
    noise = torch.tensor([MASK_SIGMA])
    found = objective(point, torch.zeros(1, dtype=torch.int32), noise, derivatives=False).evaluation
    assert found.coverage is not None and found.irradiance is not None and found.posterior is not None
    coverage = found.coverage
    likelihood = objective.likelihood
    observed, log_prior = (i.view(*coverage.shape, 3) for i in (likelihood.observed, likelihood.log_prior))
    rendered = found.irradiance[..., None] * latents.albedo[:, None, None]
    amodal = coverage >= 0.5
    by_pixel = visible = torch.where(amodal, found.posterior, 0.0)
    if isinstance(model, SpatialModel):
        visible = spatial_posterior(observed, rendered, log_prior, amodal, model)
    images = (observed, rendered, coverage, log_prior, amodal, by_pixel, visible)
    return _Shown(*(image[0] for image in images))


def _features(latents: Latents, shown: _Shown, prediction: Prediction, selection: Selection) -> torch.Tensor:
    """The confidence features (C,) float64 of a fit."""
    pixels = int(shown.mask.sum())
    residual = (shown.rendered - shown.observed)[shown.mask]
    network_off = angle_difference(prediction.best().azimuth, latents.azimuth)[0]
    probability = prediction.azimuth[0].double()
    entropy = float(-(probability * probability.clamp_min(1e-12).log()).sum())
    stated = prediction.layout.split(prediction.deviation[0])
    rolled = roll_gain(shown.rendered, shown.coverage, shown.observed, shown.log_prior, pixels)
    features = {
        "evidence_gap": 0.0 if selection.reverted else math.log1p(min(selection.gap, MOST_GAP)),
        "view_log_probability": float(prediction.log_mass(latents.azimuth)[0]),
        "network_agrees": float(abs(float(network_off)) < DISTINCT_AZIMUTH),
        "hidden_fraction": 1 - pixels / max(1, int(shown.amodal.sum())),
        "log_visible_pixels": math.log1p(pixels),
        "log_residual": math.log(max(1e-4, float(residual.square().mean().sqrt()) if pixels else 1.0)),
        "sine_elevation": math.sin(float(latents.elevation[0])),
        "mask_log_probability": _mask_log_probability(prediction.mask[0], shown.mask, shown.amodal),
        "log_azimuth_entropy": math.log(max(entropy, 1e-3)),
        "log_elevation_deviation": math.log(max(float(stated["elevation"]), 1e-4)),
        "shape_deviation": float(stated["shape"].mean()),
        "roll_gain": max(-MOST_ROLL_GAIN, min(MOST_ROLL_GAIN, rolled)),
    }
    return torch.tensor([features[name] for name in CONFIDENCE_FEATURES], dtype=torch.float64)


def _mask_log_probability(predicted: torch.Tensor, mask: torch.Tensor, amodal: torch.Tensor) -> float:
    """Mean log probability, as predicted (H, W, 3), of a fit's classes of the object's pixels.

    The object's pixels are those that the fit covers, and those that may well show it as predicted.
    """
    visible, hidden, _ = predicted.unbind(-1)
    same = torch.where(mask, visible, torch.where(amodal, hidden, 1 - visible))
    about = amodal | (visible > LEAST_VISIBLE)
    if not about.any():
        return math.log(LEAST_PROBABILITY)
    return float(same.clamp_min(LEAST_PROBABILITY).log()[about].mean())


def _verdict(
    selection: Selection, features: torch.Tensor, calibration: FitCalibration | None, anything: bool
) -> tuple[float, Verdict, str]:
    """Confidence, verdict and its reason; `anything`: whether a pixel of the object is visible."""
    if calibration is None:
        confidence, trusted = math.nan, not selection.close and not selection.elsewhere
    else:
        confidence = calibration.confidence(features)
        trusted = confidence >= calibration.threshold
    if not anything:
        return (math.nan if calibration is None else 0.0), Verdict.FAILED, Verdict.FAILED.value
    if selection.reverted:
        return confidence, Verdict.REVERTED, Verdict.REVERTED.value
    if trusted:
        unknown = "; how often such a fit is right was not learned" if calibration is None else ""
        return confidence, Verdict.TRUSTED, Verdict.TRUSTED.value + unknown
    if calibration is not None and calibration.in_distribution(features) < 0.5:
        reason = "the photo is unlike those that the recognition model knows"
    elif selection.close:
        turned, gap = selection.turned_deg, selection.gap
        reason = f"turned by {turned:.0f} degrees it fits nearly as well ({gap:.0f} nats less)"
    elif selection.elsewhere:
        reason = f"the recognition model sees it turned by {selection.turned_deg:.0f} degrees"
    else:
        reason = "too little of the object is seen to be sure of its view"
    return confidence, Verdict.AMBIGUOUS, reason


def _deviation(objective: Objective, point: torch.Tensor, normal: torch.Tensor) -> torch.Tensor:
    """Standard deviations (P,) from the inverse normal matrix (P', P') of the numbers that are free."""
    free = objective.lower < objective.upper
    matrix = normal[free][:, free].double()
    matrix = matrix + 1e-9 * matrix.diagonal().max() * torch.eye(len(matrix), dtype=torch.float64)
    deviation = torch.zeros(1, len(point), dtype=torch.float64)
    deviation[0, free] = torch.linalg.inv(matrix).diagonal().clamp_min(0.0).sqrt()
    return objective.latents(deviation).to_vector()[0]


def roll_gain(
    rendered: torch.Tensor,
    coverage: torch.Tensor,
    observed: torch.Tensor,
    log_prior: torch.Tensor,
    pixels: int,
) -> float:
    """Nats a visible pixel by which rotating the rendering slightly, either way, increases its likelihood.

    No latent expresses a rolled camera; rotating the rendered picture takes no further fit. rendered and
    observed (H, W, 3) are linear RGB; pixels: how many of the object's are visible.
    """
    picture = torch.cat([rendered * coverage[..., None], coverage[..., None]], -1).permute(2, 0, 1)[None]

    def value(shown: torch.Tensor) -> float:
        covered = shown[3].clamp(0, 1)
        colour = (shown[:3] / shown[3].clamp_min(0.05)).permute(1, 2, 0)
        explained, _ = mixture(observed, colour, log_prior, ROLL_SIGMA)
        return float((covered * explained + (1 - covered) * log_prior[..., 2]).sum(dtype=torch.float64))

    level = value(picture[0])
    rolled = [value(_rolled(picture, angle)[0]) for angle in (-ROLL, ROLL)]
    return (max(rolled) - level) / (pixels + ROLL_PIXELS)


def _rolled(picture: torch.Tensor, angle: float) -> torch.Tensor:
    """A picture (1, C, H, W) of any size rolled about its centre; corners are filled with 0."""
    height, width = picture.shape[2:]
    cos, sin = math.cos(angle), math.sin(angle)
    # In units of half the height and half the width, which need not be the same.
    matrix = picture.new_tensor([[cos, -sin * height / width, 0], [sin * width / height, cos, 0]])
    grid = functional.affine_grid(matrix[None], list(picture.shape), align_corners=False)
    return functional.grid_sample(picture, grid, align_corners=False)
