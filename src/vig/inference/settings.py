"""Settings of a fit, and its result."""

import math
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

import numpy as np

from vig.inference.calibration import UNCALIBRATED_POSITION, FitCalibration, calibration_of
from vig.io.errors import UserError
from vig.likelihood import SPATIAL, PixelModel
from vig.scene import Latents, ObjectClass
from vig.search.levenberg_marquardt import LevenbergMarquardt
from vig.search.optimizer import Budget, Optimizer

MASK_RIGHT = 0.8
"""A mask of the visible pixels is right from this intersection over union with the truth on."""


class Verdict(Enum):
    """Reliability of an explanation; the value is a sentence for the user."""

    TRUSTED = "its confidence reaches the threshold of its class"
    REVERTED = "the fit went astray; this is the recognition model's guess"
    AMBIGUOUS = "more than one explanation is within reach of the evidence"
    FAILED = "nothing of the object could be recognised in the photo"
    ABSENT = "the photo seems not to show such an object"

    def __str__(self) -> str:
        return self.name.lower()


UNIFORM_TURN = math.tau / math.sqrt(12)
"""Standard deviation, radians, of an azimuth of which nothing is known."""


@dataclass(frozen=True)
class OtherView:
    """Another explanation of a photo, of the object seen from another side.

    Attributes:
        latents: One (B = 1).
        framing: (4,), as in `Fit`.
        probability: Probability that it is the right view; NaN without a calibration.
        score_gap: Nats by which its score is below the fit's; NaN where it was not fitted to the end.
    """

    latents: Latents
    framing: np.ndarray
    probability: float
    score_gap: float = math.nan


@dataclass(frozen=True)
class Fit:
    """One photo (H, W) explained.

    Attributes:
        latents: One (B = 1).
        framing: (4,) shift in widths, right and down, log magnification, and clockwise roll in radians.
        deviation: (P,) standard deviations, from the curvature at the fit, widened by a calibration;
            without one too small, as the noise of neighbouring pixels is taken as independent. For azimuth
            it means nothing where any turn looks the same.
        framing_deviation: (4,) of the framing, from the curvature alone; 0 where it was held.
        position_deviation: (3,), see `FitCalibration.position`.
        visible: (H, W) probability that a pixel shows the object: the posterior joined with the network's.
        mask: (H, W) bool, the object's visible pixels.
        mask_by_pixel: (H, W) bool, the same by the paper's robust model, each pixel by itself.
        coverage: (H, W) probability that the object covers a pixel, hidden or not: the share that the model
            covers joined with the network's probability.
        verdict: Reliability of the fit.
        reason: One sentence why.
        confidence: Probability that the view is right; NaN without a calibration.
        mask_confidence: Probability that the mask's IoU with the truth is `MASK_RIGHT` or more, or NaN.
        mask_trusted: Whether that reaches the calibration's threshold.
        present: Probability that the photo shows the object at all, where it was found in it; NaN where its
            place was given.
        view_threshold: Confidence from which a view is trusted; NaN without a calibration.
        mask_threshold: Confidence in the mask from which it is trusted; NaN without a calibration.
        confidence_features: (C,) float64, features from which these follow, see `CONFIDENCE_FEATURES`; of a
            known object that of `known_object.verdict.explained_share` alone.
        evidence: Log posterior at the fit, with that of a gain of the shading where there is one, nats.
        start_evidence: Log posterior at the recognition model's guess, nats.
        evaluations: Evaluations of the objective, by all starts together.
        alternatives: Other views that were tried, at most `refinement.OTHER_VIEWS`; where the verdict is
            ambiguous because of one, that one first.
        descent: (T, P + 4) latents and framing from the start of the search that was chosen, step by step.
    """

    latents: Latents
    framing: np.ndarray
    deviation: np.ndarray
    framing_deviation: np.ndarray
    visible: np.ndarray
    mask: np.ndarray
    mask_by_pixel: np.ndarray
    coverage: np.ndarray
    verdict: Verdict
    reason: str
    confidence: float
    mask_confidence: float
    mask_trusted: bool
    confidence_features: np.ndarray
    evidence: float
    start_evidence: float
    evaluations: int
    alternatives: tuple[OtherView, ...]
    descent: np.ndarray
    present: float = math.nan
    view_threshold: float = math.nan
    mask_threshold: float = math.nan
    position_deviation: np.ndarray = field(
        default_factory=lambda: np.array(UNCALIBRATED_POSITION, np.float32)
    )

    @property
    def amodal(self) -> np.ndarray:
        """Return (H, W) bool, all pixels that the object covers."""
        return self.coverage >= 0.5


@dataclass(frozen=True)
class Stage:
    """One round of descents.

    Attributes:
        starts: How many of the best points enter it.
        iterations: Steps of each descent, at most.
        sigma: Multiple of the pixel model's sigma; a wide basin is searched first.
        scale: Scale of the photo.
        tolerance: Nats; a descent ends when a step gains less.
        one_per_view: Whether only the best point of each view enters it.
    """

    starts: int
    iterations: int
    sigma: float = 1.0
    scale: float = 1.0
    tolerance: float = 0.5
    one_per_view: bool = False

    @property
    def budget(self) -> Budget:
        """Return the budget of the stage's optimiser."""
        return Budget(self.iterations, self.tolerance)


PICTURE: dict[str, Any] = {
    "free_framing": False,
    "camera_distance_ratio": 1.0,
    "decoration": 0.3,
    "appearance_weight": 1.0,
    "prior_weight": 20.0,
    "view_weight": 1000.0,
    "network_mask_share": 0.0,
    "gain_deviation": 0.2,
    "stages": (
        Stage(8, 3, sigma=4.0, scale=0.5, tolerance=40.0),
        Stage(3, 5, sigma=4.0, scale=0.5, tolerance=20.0),
        Stage(2, 5, sigma=2.0, tolerance=10.0),
        Stage(2, 10, tolerance=2.0),
    ),
}
"""Defaults of settings for pictures by the standard camera."""

PHOTO: dict[str, Any] = {
    "free_framing": True,
    "camera_distance_ratio": 1.4,
    "decoration": 0.6,
    "appearance_weight": 0.05,
    "prior_weight": 20.0,
    "view_weight": 3000.0,
    "network_mask_share": 0.7,
    "gain_deviation": 0.0,
    "stages": (
        Stage(8, 0, sigma=4.0, scale=0.5, tolerance=40.0),
        Stage(4, 6, sigma=4.0, scale=0.5, tolerance=10.0),
        Stage(2, 6, sigma=2.0, tolerance=10.0),
        Stage(2, 10, tolerance=2.0, one_per_view=True),
    ),
}
"""Defaults for photographs: surfaces are painted and glazed, shading constrains shape less, and the network's
predictions of albedo and light of unfamiliar things would bend the shape. Real outlines leave
the shape model, which the network sees. Half of the starts are given up where they stand, and one end of each
view is fitted in the last stage, which takes fewer evaluations."""

CLASS_SETTINGS = tuple(name for name in PICTURE if name != "stages")
"""Settings that a class may set in its class.json where a user leaves them open."""


UNSET: Any = None
"""Default of a setting that takes the class's value, else that of the kind of photo, see `resolve`."""


@dataclass(frozen=True)
class ExplainSettings:
    """How to fit. Values of None follow from the class and the kind of photo, see `resolve`.

    Attributes:
        likelihood: The pixel model: `ROBUST`, `GAUSSIAN`, or `SPATIAL`, whose mask couples neighbours.
        stages: In turn; the last one's evidence decides. By default those of `PICTURE` or `PHOTO`.
        peaks: Number of azimuth peaks among which the starts are distributed, at most.
        informed: Whether a network has seen the photo; see `without_network`.
        mask_weight: How far the predicted per-pixel class probabilities enter the pixels' prior; 0 is the
            paper's constant alpha, 1 takes them fully.
        surroundings: How far the photo's own colours outside the object replace the uniform density, 0 to 1.
        decoration: Probability in [0, 1) that a visible pixel shows another of the object's own colours than
            the rendered one: painted decoration, a highlight.
        recognition_weight: Exponent, in the prior, of the network's Gaussians of all latents but azimuth; 0
            leaves them and the term of azimuth out.
        appearance_weight: Additional exponent of the Gaussians of albedo and light.
        prior_weight: Exponent of the prior of all latents, those Gaussians included: evidence counts pixels
            as independent, which they are not.
        azimuth_weight: Exponent of a Gaussian of 8 degrees about the nearest likely azimuth.
        view_weight: Weight of the network's view log-probability against evidence when ends are compared,
            for the same reason.
        self_shadow: Shade with self-shadowing and interreflection, where the class has a table of them.
        free_framing: Whether to fit shift, magnification and roll: boxes are drawn by hand.
        camera_distance_ratio: Distance of the camera and focal length, of the standard camera's.
        network_mask_share: Weight, 0 to 1, of the network's class probabilities in the outline and the mask
            that a fit of the `SPATIAL` model states; the rest is the model's silhouette and posterior.
        gain_deviation: Deviation of a smooth gain of the shading over the object, which explains shadows and
            bounced light of nearby things once a view is chosen, see `shading_gain`. 0 leaves it out; so do
            the Gaussian model and a photo for which the recognition model's guess is taken.
        optimizer: Runs the stages, within their budgets.
        silhouette: "exact", or "paper" for the authors' constant mask.
        calibrated: Whether verdict and deviations follow from a calibration, see `calibration_for`.
        widened: Whether deviations without one are the evidence's times `UNCALIBRATED_WIDENING`, within the
            bounds; a calibration is learned from the evidence's own, which it widens itself.
        calibration: Calibration in place of the class's own.
    """

    likelihood: PixelModel = SPATIAL
    peaks: int = 4
    informed: bool = True
    mask_weight: float = 1.0
    surroundings: float = 1.0
    recognition_weight: float = 1.0
    azimuth_weight: float = 100.0
    self_shadow: bool = True
    optimizer: Optimizer = field(default_factory=LevenbergMarquardt)
    silhouette: str = "exact"
    calibrated: bool = True
    widened: bool = True
    stages: tuple[Stage, ...] = UNSET
    decoration: float = UNSET
    appearance_weight: float = UNSET
    prior_weight: float = UNSET
    view_weight: float = UNSET
    free_framing: bool = UNSET
    camera_distance_ratio: float = UNSET
    network_mask_share: float = UNSET
    gain_deviation: float = UNSET
    calibration: FitCalibration | None = field(default=None, compare=False, kw_only=True)

    def __post_init__(self) -> None:
        stages = self.stages
        if stages is not None and (not isinstance(stages, tuple) or not stages):
            raise ValueError(f"stages must be a tuple of `Stage`, one or more; got {stages!r}. Pass one.")
        if stages and (stages[-1].sigma, stages[-1].scale) != (1.0, 1.0):
            raise ValueError("the last stage must be at sigma 1 and scale 1: its evidence decides")
        if not isinstance(self.peaks, int) or self.peaks < 1:
            raise ValueError(f"peaks must be a whole number of 1 or more; got {self.peaks!r}. Choose 4.")
        if not isinstance(self.likelihood, PixelModel):
            raise ValueError(f"likelihood must be a PixelModel; got {self.likelihood!r}. See vig.likelihood.")
        if not callable(self.optimizer):
            raise ValueError(f"optimizer must be an Optimizer; got {self.optimizer!r}. See vig.search.")
        shares = {"mask_weight": 1.0, "surroundings": 1.0, "decoration": 0.99, "network_mask_share": 1.0}
        weights = ("recognition_weight", "appearance_weight", "prior_weight", "azimuth_weight", "view_weight")
        for name in (*shares, *weights, "gain_deviation"):
            most = shares.get(name, math.inf)
            value = getattr(self, name)
            if value is not None and (not 0 <= value <= most or value == math.inf):
                raise ValueError(f"{name} must be from 0 to {most:g}; got {value}. Choose another.")
        distance = self.camera_distance_ratio
        if distance is not None and not 0 < distance < math.inf:
            raise ValueError(
                f"camera_distance_ratio must be a ratio above 0; got {distance}. Choose another."
            )
        if self.silhouette not in ("exact", "paper"):
            raise ValueError(f"silhouette must be 'exact' or 'paper'; got {self.silhouette!r}. Choose one.")
        learned = None if self.calibration is None else self.calibration.density
        if learned not in (None, self.likelihood.density):
            raise ValueError(
                f"calibration must be of fits with density '{self.likelihood.density}'; got one of"
                f" '{learned}'. Learn one for these."
            )

    def calibration_for(self, object_class: ObjectClass) -> FitCalibration | None:
        """Return the calibration that judges fits of a class; None without one learned from such fits."""
        # Learned from fits with an outlier model: without one the evidence has another scale.
        if not self.calibrated or self.likelihood.alpha == 1:
            return None
        calibration = self.calibration or calibration_of(object_class)
        comparable = calibration is not None and calibration.density == self.likelihood.density
        return calibration if comparable else None


def resolve(settings: ExplainSettings, object_class: ObjectClass, photo: bool = False) -> ExplainSettings:
    """Return settings with nothing left open: the user's, else the class's, else those of the kind of photo.

    Args:
        settings: The user's settings; those that have been resolved stay as they are.
        object_class: Class, whose `fit_settings` are those of class.json.
        photo: A photograph, or a picture by the standard camera.

    Raises:
        UserError: The class states a setting that there is none of, or a value out of its range.
    """
    by_user = {name: value for name, value in vars(settings).items() if value is not None}
    if by_user.keys() >= PICTURE.keys():
        return settings
    unknown = object_class.fit_settings.keys() - set(CLASS_SETTINGS)
    if unknown:
        raise UserError(
            f"expected fit settings of class '{object_class.name}' among {', '.join(CLASS_SETTINGS)}; got"
            f" '{min(unknown)}'. Correct its class.json."
        )
    for name, value in object_class.fit_settings.items():
        if isinstance(value, bool) != isinstance(PICTURE[name], bool):
            kind = "true or false" if isinstance(PICTURE[name], bool) else "a number"
            raise UserError(
                f"expected {kind} as fit setting '{name}' of class '{object_class.name}'; got {value}."
                " Correct its class.json."
            )
    defaults: dict[str, Any] = PHOTO if photo else PICTURE
    try:
        return ExplainSettings(**{**defaults, **object_class.fit_settings, **by_user})
    except ValueError as error:
        raise UserError(f"in the settings of class '{object_class.name}': {error}") from error


NO_NETWORK: dict[str, Any] = {
    "stages": (
        Stage(36, 4, sigma=4.0, scale=0.5, tolerance=10.0),
        Stage(8, 6, sigma=4.0, scale=0.5, tolerance=10.0),
        Stage(6, 8, sigma=2.0, tolerance=5.0),
        Stage(6, 10, tolerance=2.0),
    ),
    "peaks": 12,
    "azimuth_weight": 0.0,
    "view_weight": 0.0,
    "network_mask_share": 0.0,
    "calibrated": False,
    "informed": False,
}
"""Settings of a search without a network: starts every 30 degrees, at three elevations; evidence decides."""


def without_network(settings: ExplainSettings) -> ExplainSettings:
    """Return the settings for a photo without a network's prediction."""
    return replace(settings, **NO_NETWORK)


TRACKING: dict[str, Any] = {
    "stages": (
        Stage(3, 3, sigma=2.0, scale=0.5, tolerance=10.0),
        Stage(2, 4, tolerance=2.0, one_per_view=True),
    ),
    "azimuth_weight": 10.0,
    "gain_deviation": 0.0,
}
"""Settings of a search near the previous frame's pose: one start is the expected pose, the network's are of
other views."""


def for_tracking(settings: ExplainSettings) -> ExplainSettings:
    """Return the settings for a frame of a video; its mask is without a minimum cut."""
    model = settings.likelihood
    mask = model.mask and replace(model.mask, exact_start=False)
    return replace(settings, likelihood=replace(model, mask=mask), **TRACKING)
