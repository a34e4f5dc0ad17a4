"""How photos are explained."""

from __future__ import annotations

from dataclasses import dataclass, field

from vig.inference.levenberg_marquardt import LevenbergMarquardt
from vig.inference.optimizer import Optimizer
from vig.likelihood import ROBUST, PixelModel


@dataclass(frozen=True)
class Stage:
    """One round of descents: how many of the best starts go on, for how many steps at most, under which
    multiple of the pixel model's sigma (a wide basin is searched first), and on the photo at which scale.
    """

    starts: int
    iterations: int
    sigma: float = 1.0
    scale: float = 1.0


@dataclass(frozen=True)
class ExplainSettings:
    """How to fit.

    likelihood: the pixel model. stages: in turn, see `Stage`; only `LevenbergMarquardt` heeds their steps,
    another optimiser has a budget of its own.
    mask_weight: how far the recognition model's word on each pixel (object, occluder, neither) enters the
    likelihood's prior; 0 is the paper's constant alpha, 1 takes it fully.
    surroundings: how far the photo's own colours outside the object replace the uniform density, 0 to 1.
    belief_weight: how far the recognition model's word on elevation, shape and albedo enters the prior; 1
    takes the variances that it states.
    free_framing: also fit the image's shift and magnification, for photos that were cropped by hand.
    silhouette: "exact", or "paper" for the authors' constant mask.
    """

    likelihood: PixelModel = ROBUST
    stages: tuple[Stage, ...] = (Stage(16, 6, 3.0, 0.5), Stage(4, 6, 1.6), Stage(3, 20))
    mask_weight: float = 0.5
    surroundings: float = 1.0
    belief_weight: float = 0.0
    free_framing: bool = False
    optimizer: Optimizer = field(default_factory=LevenbergMarquardt)
    silhouette: str = "exact"
