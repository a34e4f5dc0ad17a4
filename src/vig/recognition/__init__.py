"""The recognition network: from a photo to hypotheses, bottom up."""

from vig.recognition.find import box_in_window, find, upright
from vig.recognition.network import MASK_CLASSES, NetworkCalibration, NetworkSettings, RecognitionNetwork
from vig.recognition.prediction import WEIGHTS_FILE, Prediction, Recognizer
from vig.recognition.uninformed import UninformedRecognizer

__all__ = [
    "MASK_CLASSES",
    "WEIGHTS_FILE",
    "NetworkCalibration",
    "NetworkSettings",
    "Prediction",
    "RecognitionNetwork",
    "Recognizer",
    "UninformedRecognizer",
    "box_in_window",
    "find",
    "upright",
]
