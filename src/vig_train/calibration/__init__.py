"""Learns a `vig.inference.FitCalibration` on validation photos: when fits are right, how far they are off."""

from vig_train.calibration.learning import CalibrationSamples, describe, learn
from vig_train.calibration.positions import POSITION_PHOTOS, calibrate_positions
from vig_train.calibration.samples import StudioPhotos, calibrate_fits, fit_count

__all__ = [
    "POSITION_PHOTOS",
    "CalibrationSamples",
    "StudioPhotos",
    "calibrate_fits",
    "calibrate_positions",
    "describe",
    "fit_count",
    "learn",
]
