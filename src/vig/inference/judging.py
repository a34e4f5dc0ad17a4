"""Choosing among the ends of descents by evidence, and saying how far to trust the choice."""

from __future__ import annotations

import math

import torch

from vig.inference.calibration import Calibration
from vig.inference.fit import Fit, Verdict
from vig.inference.objective import Objective, Valuation
from vig.inference.roll import roll_gain
from vig.inference.settings import ExplainSettings
from vig.likelihood import Evaluation, SpatialModel, spatial_posterior
from vig.recognition import Prediction
from vig.scene import Latents, angle_difference

MASK_SIGMA = 0.1
"""Noise under which a pixel of the fit is judged visible, as in the paper."""

DISTINCT_AZIMUTH = math.radians(25.0)
AMBIGUOUS_NATS = 30.0
LEAST_VISIBLE = 0.3
"""Predicted probability from which a pixel may well show the object."""
LEAST_ACCORD = 1e-3
"""No pixel is thought less probable, so that none decides alone."""
MOST_ROLL = 2.0
"""Nats a pixel that a roll can gain or lose, as far as clues go."""
MOST_LEAD = 3000.0
"""Nats by which another view can lie behind, as far as clues go."""


def judge(
    objective: Objective,
    points: torch.Tensor,
    values: torch.Tensor,
    scores: torch.Tensor,
    prediction: Prediction,
    settings: ExplainSettings,
    evaluations: int,
    calibration: Calibration | None,
) -> Fit:
    """Choose the best end by score and say how far to trust it.

    values (S,) is the evidence of the ends (S, P'), scores (S,) what they are compared by. With a
    calibration, an end is trusted when the clues say that its view is right; without, when no other view
    comes near it and the recognition model's best guess is of the same view.
    """
    best = int(scores.argmax())
    zero, sigma = torch.zeros(1, dtype=torch.int32), torch.tensor([settings.likelihood.sigma])
    guess = objective.point(prediction.best())
    start_evidence = float(objective(guess, zero, sigma, derivatives=False).value)
    reverted = float(values[best]) <= start_evidence
    chosen = guess if reverted else points[best : best + 1]
    at_fit = objective(chosen, zero, sigma)
    shown = objective(chosen, zero, torch.tensor([MASK_SIGMA]), derivatives=False)
    seen = shown.evaluation
    assert seen.coverage is not None and seen.posterior is not None and at_fit.normal is not None
    amodal = seen.coverage[0] >= 0.5
    if isinstance(settings.likelihood, SpatialModel):
        visible = _neighbourly(objective, chosen, shown, settings.likelihood)[0]
    else:
        visible = torch.where(amodal, seen.posterior[0], 0.0)
    mask = visible > 0.5
    rival, gap = _rival(objective, points, scores, best)
    alternative = objective.latents(guess if rival is None else points[rival : rival + 1])
    found = objective.latents(chosen)
    off = abs(math.degrees(float(angle_difference(alternative.azimuth, found.azimuth))))
    elsewhere = off > math.degrees(DISTINCT_AZIMUTH)
    clues = _clues(objective, found, seen, mask, amodal, prediction, gap, reverted)
    if calibration is None:
        confidence, sure = math.nan, gap >= AMBIGUOUS_NATS and not elsewhere
    else:
        confidence = calibration.confidence(clues)
        sure = confidence >= calibration.threshold
    if not mask.any():
        confidence = math.nan if calibration is None else 0.0
        verdict, reason = Verdict.FAILED, Verdict.FAILED.value
    elif reverted:
        verdict, reason = Verdict.REVERTED, Verdict.REVERTED.value
    elif sure:
        verdict, reason = Verdict.TRUSTED, Verdict.TRUSTED.value
        if calibration is None:
            reason += "; how often such a fit is right was not learned"
    elif calibration is not None and calibration.known(clues) < 0.5:
        verdict, reason = Verdict.AMBIGUOUS, "the photo is unlike those that the recognition model knows"
    elif rival is not None:
        verdict = Verdict.AMBIGUOUS
        reason = f"turned by {off:.0f} degrees it fits nearly as well ({gap:.0f} nats less)"
    elif elsewhere:
        verdict, reason = Verdict.AMBIGUOUS, f"the recognition model sees it turned by {off:.0f} degrees"
    else:
        verdict, reason = Verdict.AMBIGUOUS, "too little of the object is seen to be sure of its view"
    deviation = _deviation(objective, chosen[0], at_fit.normal[0])
    if calibration is not None:
        deviation = calibration.widened(deviation, clues, verdict is Verdict.TRUSTED)
    return Fit(
        latents=found,
        framing=objective.framing(chosen)[0],
        deviation=deviation,
        visible=visible,
        mask=mask,
        mask_by_pixel=torch.where(amodal, seen.posterior[0], 0.0) > 0.5,
        amodal=amodal,
        verdict=verdict,
        reason=reason,
        confidence=confidence,
        clues=clues,
        evidence=float(at_fit.value),
        start_evidence=start_evidence,
        evaluations=evaluations,
        alternative=alternative if verdict is Verdict.AMBIGUOUS and elsewhere else None,
    )


def _clues(
    objective: Objective,
    found: Latents,
    seen: Evaluation,
    mask: torch.Tensor,
    amodal: torch.Tensor,
    prediction: Prediction,
    gap: float,
    reverted: bool,
) -> torch.Tensor:
    """What speaks for and against a fit, (C,) float64 in the order of `calibration.CLUES`."""
    assert seen.irradiance is not None and seen.coverage is not None
    rendered = seen.irradiance[0, ..., None] * found.albedo[0]
    observed, log_prior = (
        image.view(*mask.shape, 3)
        for image in (objective.likelihood.observed, objective.likelihood.log_prior)
    )
    misfit = (rendered - observed)[mask]
    pixels = int(mask.sum())
    guess = prediction.best().azimuth
    chances = prediction.azimuth[0].double()
    entropy = float(-(chances * chances.clamp_min(1e-12).log()).sum())
    stated = prediction.layout.split(prediction.deviation[0])
    return torch.tensor(
        [
            0.0 if reverted else math.log1p(min(gap, MOST_LEAD)),
            float(prediction.log_mass(found.azimuth)[0]),
            float(abs(float(angle_difference(guess, found.azimuth)[0])) < DISTINCT_AZIMUTH),
            1 - pixels / max(1, int(amodal.sum())),
            math.log1p(pixels),
            math.log(max(1e-4, float(misfit.square().mean().sqrt()) if pixels else 1.0)),
            math.sin(float(found.elevation[0])),
            _accord(prediction.mask[0], mask, amodal),
            math.log(max(entropy, 1e-3)),
            math.log(max(float(stated["elevation"]), 1e-4)),
            float(stated["shape"].mean()),
            max(
                -MOST_ROLL, min(MOST_ROLL, roll_gain(rendered, seen.coverage[0], observed, log_prior, pixels))
            ),
        ],
        dtype=torch.float64,
    )


def _accord(said: torch.Tensor, mask: torch.Tensor, amodal: torch.Tensor) -> float:
    """Mean log probability, in what was said (H, W, 3) of each pixel, of what a fit says of the object's.

    The object's pixels are those that the fit covers, and those that may well show it by what was said.
    """
    visible, hidden, _ = said.unbind(-1)
    same = torch.where(mask, visible, torch.where(amodal, hidden, 1 - visible))
    about = amodal | (visible > LEAST_VISIBLE)
    return float(same.clamp_min(LEAST_ACCORD).log()[about].mean()) if about.any() else math.log(LEAST_ACCORD)


def _neighbourly(
    objective: Objective, point: torch.Tensor, shown: Valuation, model: SpatialModel
) -> torch.Tensor:
    """Posterior (1, H, W) of pixels being visible under one fit, each heeding its neighbours."""
    likelihood, evaluation = objective.likelihood, shown.evaluation
    assert evaluation.coverage is not None and evaluation.irradiance is not None
    size = (*evaluation.coverage.shape, 3)
    rendered = evaluation.irradiance[..., None] * objective.latents(point).albedo[:, None, None]
    return spatial_posterior(
        likelihood.observed.view(size),
        rendered,
        likelihood.log_prior.view(size),
        evaluation.coverage >= 0.5,
        model,
    )


def _rival(
    objective: Objective, points: torch.Tensor, scores: torch.Tensor, best: int
) -> tuple[int | None, float]:
    """The best end that is another view of the object, None if there is none near, and its gap in nats."""
    azimuth = objective.latents(points).azimuth
    other = angle_difference(azimuth, azimuth[best]).abs() > DISTINCT_AZIMUTH
    gaps = torch.where(other, scores[best] - scores, math.inf)
    gap = float(gaps.min())
    return (int(gaps.argmin()) if gap < AMBIGUOUS_NATS else None), gap


def _deviation(objective: Objective, point: torch.Tensor, normal: torch.Tensor) -> torch.Tensor:
    """Standard deviations (P,) from the inverse normal matrix of what is free."""
    free = objective.lower < objective.upper
    matrix = normal[free][:, free].double()
    matrix = matrix + 1e-9 * matrix.diagonal().max() * torch.eye(len(matrix), dtype=torch.float64)
    deviation = torch.zeros(1, len(point), dtype=torch.float64)
    deviation[0, free] = torch.linalg.inv(matrix).diagonal().clamp_min(0.0).sqrt()
    return objective.latents(deviation).to_vector()[0]
