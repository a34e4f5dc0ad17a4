"""How photos are explained."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from vig.inference.calibration import Calibration
from vig.likelihood import SPATIAL, PixelModel
from vig.optimizers.levenberg_marquardt import LevenbergMarquardt
from vig.optimizers.optimizer import Budget, Optimizer


@dataclass(frozen=True)
class Stage:
    """One round of descents: how many of the best starts go on, for how many steps at most, under which
    multiple of the pixel model's sigma (a wide basin is searched first), on the photo at which scale, and
    until a step gains how few nats.
    """

    starts: int
    iterations: int
    sigma: float = 1.0
    scale: float = 1.0
    tolerance: float = 0.5

    @property
    def budget(self) -> Budget:
        """What the stage gives its optimiser."""
        return Budget(self.iterations, self.tolerance)


@dataclass(frozen=True)
class ExplainSettings:
    """How to fit.

    likelihood: the pixel model: `ROBUST`, `GAUSSIAN`, or `SPATIAL`, in whose mask neighbouring pixels agree.
    visible_prior: a map (H, W) of each pixel's prior of being visible where it is covered, in place of the
    pixel model's alpha. stages: in turn, see `Stage`. optimizer: runs them, within their budgets.
    mask_weight: how far the recognition model's word on each pixel (object, occluder, neither) enters the
    likelihood's prior; 0 is the paper's constant alpha, 1 takes it fully.
    surroundings: how far the photo's own colours outside the object replace the uniform density, 0 to 1.
    belief_weight: how far the recognition model's word on all latents but azimuth enters the prior; 1 takes
    the variances that it states.
    prior_weight: power to which the prior of all latents is raised, the recognition model's word included:
    evidence counts pixels as independent, which they are not.
    view_weight: nats for each nat of the recognition model's log probability of a view (azimuth) when ends of
    descents are compared, for the same reason.
    self_shadow: shade with the class's transfer table, where it has one: what its parts take from and throw
    upon each other.
    free_framing: also fit the image's shift and magnification, for photos that were cropped by hand; None is
    False, unless an `Explainer` knows better.
    calibrated: whether verdict and deviations are what `calibration` makes of them, the class's by default.
    silhouette: "exact", or "paper" for the authors' constant mask.
    """

    likelihood: PixelModel = SPATIAL
    visible_prior: torch.Tensor | None = field(default=None, compare=False, kw_only=True)
    stages: tuple[Stage, ...] = (
        Stage(8, 5, sigma=4.0, scale=0.5, tolerance=40.0),
        Stage(4, 6, sigma=4.0, scale=0.5, tolerance=20.0),
        Stage(2, 8, sigma=2.0, tolerance=10.0),
        Stage(2, 15, tolerance=2.0),
    )
    mask_weight: float = 1.0
    surroundings: float = 1.0
    belief_weight: float = 1.0
    prior_weight: float = 100.0
    view_weight: float = 1000.0
    self_shadow: bool = True
    free_framing: bool | None = None
    optimizer: Optimizer = field(default_factory=LevenbergMarquardt)
    silhouette: str = "exact"
    calibrated: bool = True
    calibration: Calibration | None = field(default=None, compare=False, kw_only=True)

    def __post_init__(self) -> None:
        if not self.stages or (self.stages[-1].sigma, self.stages[-1].scale) != (1.0, 1.0):
            raise ValueError("the last stage must be at sigma 1 and scale 1: its evidence decides")
