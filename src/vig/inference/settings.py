"""How photos are explained."""

from __future__ import annotations

from dataclasses import dataclass, field

from vig.inference.calibration import FitCalibration
from vig.likelihood import SPATIAL, PixelModel
from vig.optimizers.levenberg_marquardt import LevenbergMarquardt
from vig.optimizers.optimizer import Budget, Optimizer


@dataclass(frozen=True)
class Stage:
    """One round of descents.

    Attributes:
        starts: How many of the best points enter it.
        iterations: Steps of each descent, at most.
        sigma: Multiple of the pixel model's sigma; a wide basin is searched first.
        scale: Of the photo.
        tolerance: Nats; a descent ends when a step gains less.
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

    Attributes:
        likelihood: The pixel model: `ROBUST`, `GAUSSIAN`, or `SPATIAL`, whose mask couples neighbours.
        stages: In turn; the last one's evidence decides.
        mask_weight: How far the predicted per-pixel class probabilities enter the pixels' prior; 0 is the
            paper's constant alpha, 1 takes them fully.
        surroundings: How far the photo's own colours outside the object replace the uniform density, 0 to 1.
        recognition_weight: Power of the predicted Gaussians of all latents but azimuth in the prior; 0 leaves
            them out.
        prior_weight: Power of the prior of all latents, those Gaussians included: evidence counts pixels as
            independent, which they are not.
        view_weight: Nats for each nat of the network's view log-probability when ends are compared, for the
            same reason.
        self_shadow: Shade with self-shadowing and interreflection, where the class has a table of them.
        free_framing: Also fit shift and magnification, for photos cropped by hand; None is False, unless an
            `Explainer` chooses.
        optimizer: Runs the stages, within their budgets.
        silhouette: "exact", or "paper" for the authors' constant mask.
        calibrated: Whether verdict and deviations follow from a calibration.
        calibration: In place of the class's own.
    """

    likelihood: PixelModel = SPATIAL
    stages: tuple[Stage, ...] = (
        Stage(8, 5, sigma=4.0, scale=0.5, tolerance=40.0),
        Stage(4, 6, sigma=4.0, scale=0.5, tolerance=20.0),
        Stage(2, 8, sigma=2.0, tolerance=10.0),
        Stage(2, 15, tolerance=2.0),
    )
    mask_weight: float = 1.0
    surroundings: float = 1.0
    recognition_weight: float = 1.0
    prior_weight: float = 100.0
    view_weight: float = 1000.0
    self_shadow: bool = True
    free_framing: bool | None = None
    optimizer: Optimizer = field(default_factory=LevenbergMarquardt)
    silhouette: str = "exact"
    calibrated: bool = True
    calibration: FitCalibration | None = field(default=None, compare=False, kw_only=True)

    def __post_init__(self) -> None:
        if not self.stages or (self.stages[-1].sigma, self.stages[-1].scale) != (1.0, 1.0):
            raise ValueError("the last stage must be at sigma 1 and scale 1: its evidence decides")
