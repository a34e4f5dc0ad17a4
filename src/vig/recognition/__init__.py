"""The recognition network: from a photo to hypotheses, bottom up."""

from vig.recognition.find import box_in_window, find, upright
from vig.recognition.network import MASK_CLASSES, NetworkCalibration, NetworkSettings, RecognitionNetwork
from vig.recognition.prediction import Prediction, Recognizer

__all__ = [
    "MASK_CLASSES",
    "NetworkCalibration",
    "NetworkSettings",
    "Prediction",
    "RecognitionNetwork",
    "Recognizer",
    "box_in_window",
    "find",
    "upright",
]
