"""Starts around the network's hypotheses, and their refinement by descents in stages."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from vig.inference.families import MIN_FAMILY_PROBABILITY, family_shapes
from vig.inference.hints import frame_box, project
from vig.inference.objective import Objective
from vig.inference.settings import ExplainSettings
from vig.recognition import Prediction, box_in_window
from vig.recognition.network import latents_of
from vig.recognition.prediction import START_STEP, round_to_grid
from vig.scene import Latents, ObjectClass, Symmetry
from vig.scene.latents import FRAMING

AMBIGUOUS_NATS = 30.0
"""A view whose score is less than this below the best is ambiguous with it."""


@dataclass(frozen=True)
class Selection:
    """The explanation that was chosen.

    Attributes:
        point: (1, P') of the objective.
        path: (T, P') how it was reached, from its start on.
        reverted: Whether the network's guess was kept because no end had `MIN_GAIN_NATS` more evidence.
        start_evidence: Log posterior at that guess, nats.
        evaluations: Evaluations of the objective, by all starts together.
        gap: Nats by which the score of the best end of another view is below; infinite where there is none.
        ambiguous: Whether that is less than `AMBIGUOUS_NATS`.
        rival_turn_deg: Turn about the vertical, 0 to where it looks the same, of that end; where it is not
            ambiguous, of the recognition model's guess.
        others: Points (n, P') of other views, the one of `rival_turn_deg` first; at most `OTHER_VIEWS`, or
            `UNINFORMED_VIEWS` where no network made a guess.
        score_gaps: For each of these, nats by which its score is below; NaN where it was not fitted to the
            end.
        evidence: Log posterior at the point, that of a gain of the shading included, nats; None where it is
            yet to be evaluated.
        normal: (P', P') negative Gauss-Newton Hessian there; None where it is yet to be evaluated.
    """

    point: np.ndarray
    path: np.ndarray
    reverted: bool
    start_evidence: float
    evaluations: int
    gap: float
    ambiguous: bool
    rival_turn_deg: float
    others: np.ndarray
    score_gaps: tuple[float, ...]
    evidence: float | None = None
    normal: np.ndarray | None = None

    @property
    def rival_is_other_view(self) -> bool:
        """Return whether `rival_turn_deg` refers to another view."""
        return self.rival_turn_deg > math.degrees(DISTINCT_AZIMUTH)


def select(
    objective: Objective, ends: RefinedStarts, guess: Latents, sigma: float, informed: bool = True
) -> Selection:
    """Choose the end of the best score, or the network's `guess` (B = 1) if it has no more evidence.

    Where that network is not `informed` its guess is no rival.
    """
    best = int(ends.scores.argmax())
    start = start_point(objective, guess)
    start_evidence = float(objective.evaluate_one(start, sigma, derivatives=False).value[0])
    # By evidence alone: the view probability of the guess is the highest by its nature.
    reverted = informed and float(ends.evidence[best]) <= start_evidence + MIN_GAIN_NATS
    point = start if reverted else ends.points[best : best + 1]
    azimuth, symmetry = objective.azimuth(ends.points), objective.object_class.symmetry
    other_view = np.abs(symmetry.difference(azimuth, azimuth[best])) > DISTINCT_AZIMUTH
    # Ends of the chosen view are no rivals, however good.
    gaps = np.where(other_view, ends.scores[best] - ends.scores, math.inf)
    gap, rival = float(gaps.min()), int(gaps.argmin())
    ambiguous = gap < AMBIGUOUS_NATS
    nearest = ends.points[rival : rival + 1]
    # The ends by score, then the points that were given up; the guess comes second, or first where no end is
    # near.
    order = by_score(ends.scores)
    candidates = np.concatenate([nearest, start, ends.points[order], ends.dropped])
    unknown = np.full(1 + len(ends.dropped), math.nan)
    end_gaps = np.maximum(ends.scores[best] - ends.scores[order], 0.0)
    score_gaps = np.concatenate([gaps[rival : rival + 1], unknown[:1], end_gaps, unknown[1:]])
    if not informed:
        kept = np.isfinite(score_gaps)
        candidates, score_gaps = candidates[kept], score_gaps[kept]
    elif not ambiguous:
        swapped = [1, 0, *range(2, len(candidates))]
        candidates, score_gaps = candidates[swapped], score_gaps[swapped]
    most = OTHER_VIEWS if informed else UNINFORMED_VIEWS
    azimuths = objective.azimuth(np.concatenate([candidates, point]))  # the chosen one's is the last
    off = np.abs(symmetry.difference(azimuths, azimuths[:, None]))
    turned, distinct, others = float(off[-1, 0]), (off > DISTINCT_AZIMUTH).tolist(), list[int]()
    for index in range(len(candidates)):
        if len(others) < most and all(distinct[index][other] for other in (-1, *others)):
            others.append(index)
    return Selection(
        point,
        point if reverted else ends.paths[:, best],
        reverted,
        start_evidence,
        ends.evaluations,
        gap,
        ambiguous,
        math.degrees(turned),
        candidates[others],
        tuple(score_gaps[others].tolist()),
        None if reverted else float(ends.evidence[best]),
        None if reverted or ends.normal is None else ends.normal[best],
    )


MIN_GAIN_NATS = 0.1
"""Gains of evidence below it are rounding, which differs between processors: log posteriors are sums of some
10^4 nats in single precision."""
AZIMUTH_SPREAD = math.radians(8.0)
"""Standard deviation of the Gaussian about a peak of azimuth, radians, and of the starts' perturbations."""
RELATIVE_SPREAD = 0.7
"""Elevation and shape are perturbed by this share of the deviations that the network states."""
DISTINCT_AZIMUTH = math.radians(25.0)
"""Difference of azimuth from which views are different, radians."""
OTHER_VIEWS, UNINFORMED_VIEWS = 2, 5
"""Views kept in addition to the chosen one, with and without a network that saw the photo."""


@dataclass(frozen=True)
class RefinedStarts:
    """End points of the last stage's descents.

    Attributes:
        points: (S, P') of the objective.
        evidence: (S,) float64, log posterior in nats.
        scores: (S,) float64, evidence and weighted view log-probability, by which ends are compared.
        evaluations: Evaluations of the objective, in all stages.
        dropped: (M, P') points that did not enter a later stage, the last ones and the best first.
        paths: (T, S, P') how the points were reached, from their starts on.
        normal: (S, P', P') negative Gauss-Newton Hessians at the points; None where the optimiser has none.
    """

    points: np.ndarray
    evidence: np.ndarray
    scores: np.ndarray
    evaluations: int
    dropped: np.ndarray
    paths: np.ndarray
    normal: np.ndarray | None = None


@dataclass(frozen=True)
class ExpectedStart:
    """A start besides the network's: the expected pose of an object from earlier frames.

    Attributes:
        latents: One (B = 1).
        box: x, y, width, height of the object in the window, in its sides.
        predict: Function in place of the recognizer.
    """

    latents: Latents
    box: tuple[float, float, float, float]
    predict: Callable[[np.ndarray], Prediction]


def refine(
    objectives: Mapping[float, Objective],
    prediction: Prediction,
    settings: ExplainSettings,
    expected: ExpectedStart | None = None,
) -> RefinedStarts:
    """Run the stages of `settings` on one photo's objectives by scale, from its prediction (N = 1)."""
    objective, count = objectives[1.0], settings.stages[0].starts - int(expected is not None)
    symmetry = objective.object_class.symmetry
    begin = starts(prediction, count, objective.object_class, settings.peaks, broad=settings.informed)
    framing = framings(begin, prediction, objective) if settings.free_framing else None
    points = start_point(objective, begin, framing)
    if expected is not None:
        elsewhere = np.abs(symmetry.difference(begin.azimuth, expected.latents.azimuth)) > AZIMUTH_SPREAD
        framing = framing_of_box(expected.latents, expected.box, objective) if settings.free_framing else None
        points = np.concatenate([start_point(objective, expected.latents, framing), points[elsewhere]])
    evidence = scores = np.zeros(len(points))
    evaluations, dropped, paths = 0, points[:0], points[None]
    for stage in settings.stages:
        # The first stage takes all starts, as their scores are 0 alike.
        azimuth = objective.azimuth(points)
        entering = select_for_stage(azimuth, scores, stage.starts, symmetry, stage.one_per_view)
        order = by_score(scores)
        left = order[~np.isin(order, entering)]
        dropped = np.concatenate([points[left], dropped])
        points, paths = points[entering], paths[:, entering]
        descent = settings.optimizer(
            objectives[stage.scale],
            points,
            np.zeros(len(points), np.int32),
            settings.likelihood.sigma * stage.sigma,
            replace(stage.budget, curvature=stage is settings.stages[-1]),
        )
        points, evidence = descent.points, descent.value
        paths = np.concatenate([paths, points[None] if descent.path is None else descent.path[1:]])
        view_log_probability = prediction.log_mass(objective.azimuth(points))
        # A photo pooled to scale s has s^2 of the pixels, hence of the evidence's nats.
        scores = evidence + settings.view_weight * stage.scale**2 * view_log_probability
        evaluations += int(descent.evaluations.sum())
    return RefinedStarts(points, evidence, scores, evaluations, dropped, paths, descent.normal)


def by_score(scores: np.ndarray) -> np.ndarray:
    """Return indices from the highest score to the lowest; ties keep their order."""
    return np.argsort(-scores, kind="stable")


def start_point(objective: Objective, latents: Latents, framing: np.ndarray | None = None) -> np.ndarray:
    """Return `Objective.point` in steps of `START_STEP`, as last digits differ between processors.

    See `Prediction.round_for_search`.
    """
    point = round_to_grid(objective.point(latents, framing), START_STEP)
    return point.clip(objective.lower, objective.upper)


def select_for_stage(
    azimuth: np.ndarray,
    scores: np.ndarray,
    count: int,
    symmetry: Symmetry = Symmetry.NONE,
    one_per_view: bool = False,
) -> np.ndarray:
    """Return indices of `count` points that enter a stage: half by score alone, half the best of other views.

    A view is `DISTINCT_AZIMUTH` away from the others; where there are no more views, score alone decides. So
    the back of the object is not dropped before a fit at full size has compared it with the front.

    Args:
        azimuth: (B,) radians.
        scores: (B,), higher is better.
        count: Number of points, at most B.
        symmetry: Views that look the same are one.
        one_per_view: Only the best of each view, fewer than `count` where there are no more.
    """
    order = by_score(scores).tolist()
    chosen = order[: 1 if one_per_view else (count + 1) // 2]
    distinct = (np.abs(symmetry.difference(azimuth, azimuth[:, None])) > DISTINCT_AZIMUTH).tolist()
    for index in order:
        if len(chosen) < count and all(distinct[index][other] for other in chosen):
            chosen.append(index)
    if not one_per_view:
        chosen += [index for index in order if index not in chosen][: count - len(chosen)]
    return np.array(chosen)


def starts(
    prediction: Prediction,
    count: int,
    object_class: ObjectClass | None = None,
    most_peaks: int = 4,
    seed: int = 0,
    broad: bool = True,
) -> Latents:
    """Return `count` starts for one photo's prediction (N = 1), the first being the best guess itself.

    Each of the `most_peaks` highest peaks of azimuth gets a share of the starts near its probability, at
    least one where it is likely; beyond a peak's first,
    azimuth, elevation and shape are perturbed at random. Where more than one family of the class is likely,
    all but the first have the shape that is predicted within one, each family its share. The same seed gives
    the same starts.
    """
    weights, angles = prediction.modes(most_peaks, broad)
    # 0.02: peaks of azimuth with less probability are left out
    peaks = _allot(np.exp(weights[0]), 0.02, count)
    numbers, layout = np.repeat(prediction.numbers, count, axis=0), prediction.layout
    rng = np.random.default_rng(np.random.SeedSequence([seed, count]))
    # A peak's first start is the peak itself, those after it are perturbed.
    repeated = np.array([peaks[i] in peaks[:i] for i in range(count)], np.float32)[:, None]
    normal = rng.standard_normal((count, 2 + layout.count("shape"))).astype(np.float32)
    noise = normal * repeated
    if object_class is not None:
        probability, shapes = family_shapes(prediction, object_class)
        families = _allot(probability, MIN_FAMILY_PROBABILITY, count)
        if len(set(families)) > 1:
            # The last starts first, so that a second family is tried at each peak's repetitions.
            numbers[1:, layout["shape"]] = shapes[families[::-1][:-1]]
    moved = layout.indices("elevation", "shape")
    numbers[:, moved] += RELATIVE_SPREAD * prediction.deviation[:, moved] * noise[:, 1:]
    perturbed = latents_of(numbers, angles[0, peaks] + AZIMUTH_SPREAD * noise[:, 0])
    return prediction.symmetry.canonical(perturbed)


def framings(starts: Latents, prediction: Prediction, objective: Objective, seed: int = 0) -> np.ndarray:
    """Return level framings (B, 4) where each start has the box of the object in the predicted mask (N = 1).

    All but the first are perturbed at random. Where the mask shows nothing they begin at 0.
    """
    count, box = len(starts.azimuth), box_in_window(prediction)
    framing = (
        np.zeros((count, FRAMING.size), np.float32) if box is None else framing_of_box(starts, box, objective)
    )
    rng = np.random.default_rng(np.random.SeedSequence([seed, count, 1]))
    noise = rng.standard_normal((count, FRAMING.size)).astype(np.float32)
    noise[0] = 0.0
    # (0.02, 0.02, 0.06, 0.0): standard deviations of the starts' shift (widths), log magnification and roll
    # (radians)
    return framing + np.array((0.02, 0.02, 0.06, 0.0), np.float32) * noise


def framing_of_box(
    starts: Latents, box: tuple[float, float, float, float], objective: Objective
) -> np.ndarray:
    """Return level framings (B, 4) where each start has a box x, y, width, height, in sides of the window."""
    vertices = objective.object_class.shape_model.vertices(starts.shape)
    places = project(objective.likelihood.camera, vertices, starts.azimuth, starts.elevation)
    framing = np.zeros((len(starts), FRAMING.size), np.float32)
    framing[:, :3] = frame_box(places, box)
    return framing


def _allot(probability: np.ndarray, least: float, count: int) -> list[int]:
    """Assign `count` starts to hypotheses in proportion to probability (Sainte-Laguë)."""
    likely = np.flatnonzero(probability / probability.sum() > least)
    # A network that knows nothing spreads its probability over more hypotheses than pass the bound.
    if not len(likely):
        likely = np.array([int(probability.argmax())])
    likely = likely[np.argsort(-probability[likely], kind="stable")][:count]
    share = probability[likely] / probability[likely].sum()
    remaining = list(range(len(share)))
    numbers = np.ones(len(share))
    while len(remaining) < count:
        most = int(np.argmax(share * (count + 1) - numbers))
        remaining.append(most)
        numbers[most] += 1
    return [int(likely[place]) for place in remaining[:count]]
