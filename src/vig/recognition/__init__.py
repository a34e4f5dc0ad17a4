"""The recognition network: from a photo to hypotheses, bottom up."""

from vig.recognition.calibration import CalibrationResult, calibrate_network
from vig.recognition.network import MASK_CLASSES, NetworkCalibration, NetworkSettings, RecognitionNetwork
from vig.recognition.prediction import Prediction, Recognizer
from vig.recognition.training import Epoch, TrainingSettings, train

__all__ = [
    "MASK_CLASSES",
    "CalibrationResult",
    "Epoch",
    "NetworkCalibration",
    "NetworkSettings",
    "Prediction",
    "RecognitionNetwork",
    "Recognizer",
    "TrainingSettings",
    "calibrate_network",
    "train",
]
