"""Recognition: from a photo to hypotheses, bottom up."""

from vig.recognition.find import box_in_window, find, upright
from vig.recognition.network import MASK_CLASSES, NetworkCalibration, NetworkSettings
from vig.recognition.prediction import Prediction
from vig.recognition.recognizer import WEIGHTS_FILE, Recognizer
from vig.recognition.uninformed import UninformedRecognizer

__all__ = [
    "MASK_CLASSES",
    "WEIGHTS_FILE",
    "NetworkCalibration",
    "NetworkSettings",
    "Prediction",
    "Recognizer",
    "UninformedRecognizer",
    "box_in_window",
    "find",
    "upright",
]
