"""Calibration of a fit's confidence and standard deviations, learned on validation photos.

One logistic regression on a fit's confidence features gives the probability that its view is right, one that
its mask is; a third, learned with rolled photos among others, that the photo is in distribution, without
which these mean nothing. The curvature at the fit gives deviations as if the model were exact and pixels
independent; each is widened to `r sqrt((scale d)^2 + floor^2)`, r the residual's root mean square, scale and
floor being apart for trusted fits and for others, so that 90 % intervals hold.
"""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vig.io.checks import check_number, decode, read_json, reading
from vig.io.errors import UserError
from vig.io.files import write_bytes
from vig.likelihood.pixel import DEFAULT_DENSITY
from vig.scene import ObjectClass, latent_layout
from vig.scene.functions import sigmoid

FILE = "calibration.json"
FORMAT = 7
"""Version 6 had no position deviations."""

CONFIDENCE_FEATURES = (
    "evidence_gap",  # log (1 + nats by which the best fit of another view lies behind), 0 for a reverted fit
    "view_log_probability",  # that the network gives to the fit's view
    "network_agrees",  # 1 when the network's most probable view is the fit's
    "hidden_fraction",  # share of the object's pixels that are hidden
    "log_visible_pixels",  # log (1 + their number)
    "log_residual",  # log of the residual's root mean square where the object is visible
    "sine_elevation",
    "mask_log_probability",  # mean that the network gives to the fit's classes of the object's pixels
    "log_azimuth_entropy",  # entropy of the network's view probabilities
    "log_elevation_deviation",  # deviation that the network states
    "shape_deviation",  # mean over the components, as the network states them
    "presence_log_odds",  # log odds, as predicted, that the photo shows the object at all
    "predicted_roll",  # absolute, radians: that the network sees in a photo that should stand upright
    "outline_agreement",  # intersection over union of the fit's coverage and the network's object
    "rival_log_probability",  # that the network gives to the most probable view 50 degrees away or more
)
"""Features from which the confidence in a fit is computed, in this order."""

UNCALIBRATED_POSITION = (0.1, 0.1, 0.3)
"""Position deviations of a class without a calibration, see `FitCalibration.position`: rough ones."""
UNCALIBRATED_WIDENING = 35.0
"""Factor of the deviations of fits without a calibration, as evidence counts pixels as independent: on 200
scenes of four meshes right views were 3.7 degrees off (68 % quantile) where evidence alone says 0.1."""
WITHIN_90 = 1.6449
"""Standard deviations on either side that hold 90 % of a Gaussian."""
MIN_DEVIATION = 1e-3
"""Deviation of any latent: even one that never varied, such as L00 at a set exposure, is uncertain."""


def residual(features: np.ndarray) -> np.ndarray:
    """Return root mean squares (...) of the residual where the object is visible, from features (..., C)."""
    root: np.ndarray = np.exp(features[..., CONFIDENCE_FEATURES.index("log_residual")])
    return root


@dataclass(frozen=True)
class FitCalibration:
    """Map from confidence features (C,) and curvature to a confidence and deviations of P latents.

    Attributes:
        view_weights: (C,) of the logistic regression for the view being right.
        view_bias: Its bias.
        in_distribution_weights: (C,) of that for the photo being in distribution.
        in_distribution_bias: Its bias.
        mask_weights: (C,) of that for the mask being right.
        mask_bias: Its bias.
        threshold: Confidence from which a view is trusted.
        mask_threshold: Confidence from which a mask is trusted.
        scale: (2, P) factors of deviations, row 0 for trusted fits, 1 for others.
        floor: (2, P) least deviations in units of the residual, rows as `scale`.
        position: (2, 3) standard deviations of the object's position before a known camera, added to
            those from the curvature, rows as `scale`: to the side and along the object's apparent vertical,
            in lengths of the object, and in depth, as a share of the distance. The spread of the sizes of a
            class's shapes is in it.
        density: Noise density of the fits that it was learned from, to which it is limited. A file without
            it has the default density.
    """

    view_weights: np.ndarray
    view_bias: float
    in_distribution_weights: np.ndarray
    in_distribution_bias: float
    mask_weights: np.ndarray
    mask_bias: float
    threshold: float
    mask_threshold: float
    scale: np.ndarray
    floor: np.ndarray
    position: np.ndarray = field(default_factory=lambda: np.array([UNCALIBRATED_POSITION] * 2))
    density: str = DEFAULT_DENSITY

    def confidence(self, features: np.ndarray) -> float:
        """Return the probability that a fit's view is right; it fades to 0 for photos out of distribution."""
        view = _logistic(self.view_weights, self.view_bias, features)
        return float(fade_confidence(view, self.in_distribution(features)))

    def mask_confidence(self, features: np.ndarray) -> float:
        """Return the probability that a fit's mask is right; it fades as `confidence` does."""
        mask = _logistic(self.mask_weights, self.mask_bias, features)
        return float(fade_confidence(mask, self.in_distribution(features)))

    def in_distribution(self, features: np.ndarray) -> np.ndarray:
        """Return the probability () that a photo is of the distribution learned on, 1 / 2 a priori."""
        return _logistic(self.in_distribution_weights, self.in_distribution_bias, features)

    def widen_deviations(self, deviation: np.ndarray, features: np.ndarray, trusted: bool) -> np.ndarray:
        """Return the standard deviations (P,) from those of the curvature."""
        row = 0 if trusted else 1
        wide = np.sqrt((self.scale[row] * deviation) ** 2 + self.floor[row] ** 2)
        widened: np.ndarray = np.maximum(residual(features) * wide, MIN_DEVIATION)
        return widened

    def to_json(self) -> str:
        """Return the text of the file."""
        values = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(self).items()}
        return json.dumps({"format": FORMAT, "features": CONFIDENCE_FEATURES} | values, indent=1) + "\n"

    def save(self, path: Path) -> None:
        """Write as JSON."""
        write_bytes(path, self.to_json().encode())

    @staticmethod
    def load(path: Path) -> FitCalibration:
        """Read a file of `save`. Raises UserError when there is none or it is invalid."""
        with reading(path, "a calibration", "Make it again with `vig calibrate`."):
            values = decode(dict[str, Any], read_json(path))
            if values["format"] != FORMAT:
                raise ValueError(f"it is of format {values['format']!s:.20}, where this vig reads {FORMAT}")
            names = decode(tuple[str, ...], values["features"])
            if not set(names) <= set(CONFIDENCE_FEATURES) or len(set(names)) < len(names):
                raise ValueError("it was learned with different confidence features")
            row, rows = tuple[float, ...], tuple[tuple[float, ...], ...]
            weights = dict.fromkeys(("view_weights", "in_distribution_weights", "mask_weights"), row)
            kinds = {**weights, "scale": rows, "floor": rows, "position": rows}
            arrays = {name: np.array(decode(kind, values[name]), np.float64) for name, kind in kinds.items()}
            shapes = {arrays[name].shape for name in weights}
            size = arrays["scale"].shape
            if shapes != {(len(names),)} or size != arrays["floor"].shape or size[0] != 2:
                raise ValueError("its sizes do not fit")
            for name in weights:  # features that an earlier version did not have have no weight
                by_feature = dict(zip(names, arrays[name].tolist(), strict=True))
                arrays[name] = np.array([by_feature.get(feature, 0.0) for feature in CONFIDENCE_FEATURES])
            if arrays["position"].shape != (2, 3):
                raise ValueError(f"position must be (2, 3); it is {arrays['position'].shape}")
            if any((arrays[name] < 0).any() for name in ("scale", "floor", "position")):
                raise ValueError("scale, floor and position must not be negative")
            limits = dict.fromkeys(("view_bias", "in_distribution_bias", "mask_bias"), 1e6)
            limits |= {"threshold": 2.0, "mask_threshold": 2.0}
            numbers = {name: check_number(name, values[name], -most, most) for name, most in limits.items()}
            density = decode(str, values.get("density", DEFAULT_DENSITY))
            checked: dict[str, Any] = {**arrays, **numbers, "density": density}
            return FitCalibration(**checked)


def fade_confidence(probability: np.ndarray, in_distribution: np.ndarray) -> np.ndarray:
    """Return confidence from probabilities that a view or mask is right, and the photo in distribution."""
    faded: np.ndarray = probability * np.minimum(2 * in_distribution, 1)
    return faded


def _logistic(weights: np.ndarray, bias: float, features: np.ndarray) -> np.ndarray:
    return sigmoid(features.astype(np.float64) @ weights + bias)


@functools.lru_cache(maxsize=8)
def calibration_of(object_class: ObjectClass) -> FitCalibration | None:
    """Return a class's own calibration; None when it has none."""
    path = (object_class.folder or Path()) / FILE
    if not object_class.folder or not path.exists():
        return None
    calibration, count = FitCalibration.load(path), latent_layout(object_class.shape_model.modes).size
    if calibration.scale.shape[1] != count:
        raise UserError(
            f"expected a calibration of the {count} latents of class '{object_class.name}';"
            f" '{path}' has {calibration.scale.shape[1]}. Make it again with `vig calibrate`."
        )
    return calibration
