"""The recognition network's training on datasets, and the calibration of what it states."""

from vig_lab.training.calibration import CalibrationResult, calibrate_network
from vig_lab.training.training import Epoch, TrainingSettings, train

__all__ = ["CalibrationResult", "Epoch", "TrainingSettings", "calibrate_network", "train"]
