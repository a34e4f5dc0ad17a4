"""A recognizer in place of a network, for classes that none was trained for."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from vig.recognition.network import NetworkSettings
from vig.recognition.prediction import Prediction
from vig.recognition.recognizer import Recognizer
from vig.scene import ObjectClass, regressed_layout

ELEVATION = math.radians(25.0), math.radians(20.0)
"""Mean and standard deviation of the camera's elevation in photos, radians: people hold cameras there."""
ALBEDO = 0.4, 0.4
"""Mean and standard deviation of each channel of the albedo."""


class UninformedRecognizer(Recognizer):
    """Recognizer with one prediction for all photos: any azimuth, and numbers as usual in photos."""

    informed = has_map = False

    def __init__(self, object_class: ObjectClass):
        self.symmetry, self.mirror = object_class.symmetry, object_class.mirror
        layout = regressed_layout(object_class.shape_model.modes)
        self._mean, self._deviation = (each(layout.size, np.float32) for each in (np.zeros, np.ones))
        for name, (mean, deviation) in (("elevation", ELEVATION), ("albedo", ALBEDO)):
            self._mean[layout[name]], self._deviation[layout[name]] = mean, deviation
        lights = np.sqrt(object_class.light_prior_covariance.diagonal())
        self._mean[layout["light"]] = object_class.light_prior_mean
        # 3.0: over the standard deviations of the class's lights, at an exposure that is not known
        self._deviation[layout["light"]] = 3.0 * lights + 0.2

    def __call__(self, photos: Any, batch: int = 32, sides: Sequence[bool] = ()) -> Prediction:
        """Predict for photos (N, S, S, 3), see `Recognizer.__call__`."""
        count, bins = len(photos), NetworkSettings().azimuth_bins
        # (0.5, 0.1, 0.4): shares of `MASK_CLASSES` among the pixels of boxes; hints overrule them: beyond the
        # box is nothing
        return Prediction(
            np.full((count, bins), 1 / bins, np.float32),
            np.tile(self._mean, (count, 1)),
            np.tile(self._deviation, (count, 1)),
            np.tile(np.array((0.5, 0.1, 0.4), np.float32), (*photos.shape[:3], 1)),
            np.zeros(count, np.float32),
            np.full(count, 0.5, np.float32),
        ).fold(self.symmetry)
