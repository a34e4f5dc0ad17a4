"""The recognition model: from a photo to hypotheses, bottom up."""

from vig.recognition.calibrating import calibrate
from vig.recognition.network import MASK_CLASSES, NetworkSettings, RecognitionNetwork
from vig.recognition.prediction import Prediction, Recognizer
from vig.recognition.training import TrainingSettings, train

__all__ = [
    "MASK_CLASSES",
    "NetworkSettings",
    "Prediction",
    "RecognitionNetwork",
    "Recognizer",
    "TrainingSettings",
    "calibrate",
    "train",
]
