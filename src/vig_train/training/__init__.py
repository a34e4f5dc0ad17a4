"""The recognition network's training on datasets, and the calibration of its outputs."""

from vig_train.training.calibration import CalibrationResult, calibrate_network
from vig_train.training.training import Epoch, TrainingSettings, train

__all__ = ["CalibrationResult", "Epoch", "TrainingSettings", "calibrate_network", "train"]
