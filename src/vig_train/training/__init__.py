"""The recognition network's training on datasets, and the calibration of its outputs."""

from vig_train.training.calibration import CalibrationResult as CalibrationResult
from vig_train.training.calibration import calibrate_network as calibrate_network
from vig_train.training.training import Epoch as Epoch
from vig_train.training.training import TrainingSettings as TrainingSettings
from vig_train.training.training import train as train
