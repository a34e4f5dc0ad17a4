"""Choosing among the ends of descents by evidence, and saying how far to trust the choice."""

from __future__ import annotations

import math

import torch

from vig.inference.explanation import Explanation, Verdict
from vig.inference.objective import Objective, Valuation
from vig.inference.settings import ExplainSettings
from vig.likelihood import FRAMING_COUNT, SpatialModel, spatial_posterior

MASK_SIGMA = 0.1
"""Noise under which a pixel of the fit is judged visible, as in the paper."""

DISTINCT_AZIMUTH = math.radians(25.0)
AMBIGUOUS_NATS = 30.0


def judge(
    objective: Objective,
    points: torch.Tensor,
    values: torch.Tensor,
    scores: torch.Tensor,
    guess: torch.Tensor,
    settings: ExplainSettings,
    evaluations: int,
) -> Explanation:
    """Choose the best end by score and say how far to trust it.

    values (S,) is the evidence of the ends (S, P'), scores (S,) what they are compared by. An end is only
    trusted when no other view comes near it and the recognition model's best guess is of the same view.
    """
    best = int(scores.argmax())
    zero = torch.zeros(1, dtype=torch.int32)
    sigma = torch.tensor([settings.likelihood.sigma])
    start_evidence = float(objective(guess, zero, sigma, derivatives=False).value)
    verdict, reason, alternative = Verdict.TRUSTED, Verdict.TRUSTED.value, None
    chosen = points[best : best + 1]
    if float(values[best]) <= start_evidence:
        verdict, reason, chosen = Verdict.REVERTED, Verdict.REVERTED.value, guess
    else:
        rival = _rival(objective, points, scores, best)
        if rival is not None:
            verdict, alternative = Verdict.AMBIGUOUS, objective.latents(points[rival : rival + 1])
            degrees = math.degrees(abs(float(turn(alternative.azimuth, objective.latents(chosen).azimuth))))
            gap = float(scores[best] - scores[rival])
            reason = f"turned by {degrees:.0f} degrees it fits nearly as well ({gap:.0f} nats less)"
        else:
            other_view = math.degrees(
                abs(float(turn(objective.latents(guess).azimuth, objective.latents(chosen).azimuth)))
            )
            if other_view > math.degrees(DISTINCT_AZIMUTH):
                verdict, alternative = Verdict.AMBIGUOUS, objective.latents(guess)
                reason = f"the recognition model sees it turned by {other_view:.0f} degrees"
    at_fit = objective(chosen, zero, sigma)
    shown = objective(chosen, zero, torch.tensor([MASK_SIGMA]), derivatives=False)
    seen = shown.evaluation
    assert seen.coverage is not None and seen.posterior is not None
    amodal = seen.coverage[0] >= 0.5
    if isinstance(settings.likelihood, SpatialModel):
        visible = _neighbourly(objective, chosen, shown, settings.likelihood)[0]
    else:
        visible = torch.where(amodal, seen.posterior[0], 0.0)
    mask = visible > 0.5
    if not mask.any():
        verdict, reason, alternative = Verdict.FAILED, Verdict.FAILED.value, None
    assert at_fit.normal is not None
    return Explanation(
        latents=objective.latents(chosen),
        framing=chosen[0, -FRAMING_COUNT:],
        deviation=_deviation(objective, chosen[0], at_fit.normal[0]),
        visible=visible,
        mask=mask,
        amodal=amodal,
        verdict=verdict,
        reason=reason,
        evidence=float(at_fit.value),
        start_evidence=start_evidence,
        evaluations=evaluations,
        alternative=alternative,
    )


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


def _rival(objective: Objective, points: torch.Tensor, scores: torch.Tensor, best: int) -> int | None:
    """The best end that is another view of the object and nearly as good, or None."""
    azimuth = objective.latents(points).azimuth
    gaps = scores[best] - scores
    near = (turn(azimuth, azimuth[best]).abs() > DISTINCT_AZIMUTH) & (gaps < AMBIGUOUS_NATS)
    return int(torch.where(near, gaps, math.inf).argmin()) if near.any() else None


def turn(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """a - b round the circle, in [-pi, pi) radians."""
    return torch.remainder(a - b + math.pi, 2 * math.pi) - math.pi


def _deviation(objective: Objective, point: torch.Tensor, normal: torch.Tensor) -> torch.Tensor:
    """Standard deviations (P,) from the inverse normal matrix of what is free."""
    free = objective.lower < objective.upper
    matrix = normal[free][:, free].double()
    matrix = matrix + 1e-9 * matrix.diagonal().max() * torch.eye(len(matrix), dtype=torch.float64)
    deviation = torch.zeros(len(point), dtype=torch.float64)
    deviation[free] = torch.linalg.inv(matrix).diagonal().clamp_min(0.0).sqrt()
    return deviation[: len(point) - FRAMING_COUNT]
