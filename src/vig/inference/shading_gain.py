"""A smooth gain of the shading over the object: shadows and bounced light of nearby things.

Light at infinity explains neither, and the residual would bend shape and view. The gain is one plus a
sum of `GRID` x `GRID` Gaussian bumps over the object. Their heights have the prior N(0, `gain_deviation`^2),
to the power `prior_weight` as all latents. The rendered colour is linear in them, so that they are found by
least squares, in turn with descents of the latents. Even then the residual is not independent from pixel
to pixel: the noise of the descents is estimated, which may lower the evidence under the pixel model's own.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from vig.inference.objective import Objective
from vig.inference.refinement import Selection
from vig.inference.settings import ExplainSettings
from vig.likelihood import Likelihood, Photos
from vig.search.optimizer import Budget

GRID = 4
"""Bumps along each side of a square about the object; their deviation is the distance of neighbours."""
ROUNDS, BUDGET = 3, Budget(20, 0.3)
"""Alternations between gain and latents, and the budget of each descent."""
FIRST_NOISE, MIN_NOISE, MAX_NOISE = 2.0, 0.5, 3.0
"""Multiples of the pixel model's sigma: at first, and the bounds of the estimate."""
WIDENING = 2.0
"""The noise is this multiple of the residual's root mean square, as neighbours err alike."""
MIN_GAIN, MAX_GAIN = 0.3, 3.0
"""Bounds of the gain."""
BRIGHTEST = 8.0
"""Greatest value of a divided photo, linear RGB; brighter pixels are highlights whatever the gain."""
COVERED = 0.99
"""Share from which a pixel is wholly the object's; edges are a mixture."""


def with_shading_gain(
    objective: Objective, selection: Selection, settings: ExplainSettings
) -> tuple[Objective, Selection]:
    """Return the selection refined with a gain, and the objective of the photo divided by that gain.

    Its evidence counts the gain's prior; its curvature is under the photo's own noise, where that is more
    than the pixel model's. Other views and their distances in nats stay those of the search. All stays as it
    is where too little of the object is visible, or the recognition model's guess has more evidence.
    """
    pixel_sigma = settings.likelihood.sigma
    noise, precision = FIRST_NOISE * pixel_sigma, settings.prior_weight / settings.gain_deviation**2
    point, path, evaluations, divided = selection.point, [selection.path], selection.evaluations, objective
    of_photo, penalty = np.zeros(1, np.int32), 0.0
    for _ in range(ROUNDS):
        gain = _gain(objective, divided, point, noise, precision)
        if gain is None:
            return objective, selection
        divided, penalty = _divide_by_gain(objective, gain.factor), gain.penalty
        noise = min(max(WIDENING * gain.residual, MIN_NOISE * pixel_sigma), MAX_NOISE * pixel_sigma)
        descent = settings.optimizer(divided, point, of_photo, noise, BUDGET)
        point, evaluations = descent.points, evaluations + int(descent.evaluations.sum()) + 1
        path.append(point if descent.path is None else descent.path[1:, 0])
    evidence = float(divided.evaluate_one(point, pixel_sigma, derivatives=False).value[0]) - penalty
    if not evidence > selection.start_evidence:
        return objective, selection
    normal = divided.evaluate_one(point, max(noise, pixel_sigma)).normal
    assert normal is not None
    return divided, replace(
        selection,
        point=point,
        path=np.concatenate(path),
        evaluations=evaluations + 2,
        evidence=evidence,
        normal=normal[0],
    )


@dataclass(frozen=True)
class _Gain:
    """A gain and its residual.

    Attributes:
        factor: (H, W), within `MIN_GAIN` and `MAX_GAIN`.
        penalty: Penalty of its heights, nats.
        residual: Root mean square of visible pixels, linear RGB.
    """

    factor: np.ndarray
    penalty: float
    residual: float


def _gain(
    objective: Objective, divided: Objective, point: np.ndarray, noise: float, precision: float
) -> _Gain | None:
    """Return the gain at a point by regularised least squares; None where too little is visible.

    divided: objective under the gain so far, which gives visible pixels; precision: that of each bump's
    height, one over its variance.
    """
    evaluation = divided.evaluate_one(point, noise, derivatives=False)
    assert evaluation.posterior is not None and evaluation.coverage is not None
    assert evaluation.irradiance is not None
    coverage, observed = evaluation.coverage[0], objective.likelihood.observed[0]
    visible = (evaluation.posterior[0] * (coverage > COVERED)).ravel().astype(np.float64)
    if float(visible.sum()) < 50:  # pixels
        return None
    albedo = objective.latents(point).albedo[0].astype(coverage.dtype)
    rendered = evaluation.irradiance[0].reshape(-1, 1) * albedo
    bumps = _bumps(coverage > 0.5).reshape(-1, GRID**2)
    weight = visible / noise**2
    weighted = bumps * (weight * np.square(rendered).sum(1))[:, None]
    normal = bumps.T @ weighted + precision * np.eye(bumps.shape[1])
    missing = ((observed - rendered) * rendered).sum(1)
    heights = np.linalg.solve(normal, bumps.T @ (weight * missing))
    gain = (1 + bumps @ heights).clip(MIN_GAIN, MAX_GAIN)
    squares = np.square(observed / gain[:, None] - rendered).mean(1)
    residual = math.sqrt(visible @ squares / visible.sum())
    penalty = 0.5 * precision * float(np.square(heights).sum())
    return _Gain(gain.reshape(coverage.shape), penalty, residual)


def _bumps(silhouette: np.ndarray) -> np.ndarray:
    """Return the bumps (H, W, `GRID`^2) over the square about a silhouette (H, W) bool, float64."""
    down, across = (np.flatnonzero(silhouette.any(axis)) for axis in (1, 0))
    side = float(max(down[-1] - down[0], across[-1] - across[0]) + 1)
    knots = np.linspace(-0.5, 0.5, GRID, dtype=np.float32).astype(np.float64)

    def along(span: np.ndarray, length: int) -> np.ndarray:
        off = (np.arange(length) - (span[0] + span[-1]) / 2) / side
        heights: np.ndarray = np.exp(-0.5 * ((off[:, None] - knots) * (GRID - 1)) ** 2)
        return heights

    rows, columns = along(down, silhouette.shape[0]), along(across, silhouette.shape[1])
    bumps: np.ndarray = rows[:, None, :, None] * columns[None, :, None, :]
    return bumps.reshape(*silhouette.shape, -1)


def _divide_by_gain(objective: Objective, gain: np.ndarray) -> Objective:
    """Return the objective of the photo divided by a gain (H, W); a colour's density changes by its cube."""
    likelihood, shape = objective.likelihood, (1, *gain.shape, 3)
    log_prior = likelihood.log_prior.reshape(shape).copy()
    log_prior[..., 0] -= 3 * np.log(gain)
    divided = likelihood.observed.reshape(shape) / gain[..., None].astype(log_prior.dtype)
    photo = np.minimum(divided, BRIGHTEST)
    corrected = Likelihood(
        likelihood.geometry,
        likelihood.camera,
        Photos(photo, log_prior),
        likelihood.silhouette,
        likelihood.stride,
        likelihood.density,
    )
    return objective.with_likelihood(corrected, objective.terms)
