"""The paper's networks in the place of vig's recognition network."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open

from vig.recognition import Prediction, Recognizer
from vig.scene import ObjectClass, srgb_from_linear
from vig_paper.network.network import networks_from
from vig_train.network.network import bfloat16
from vig_train.network.weights import as_tensors


class PaperRecognizer(Recognizer):
    """The paper's four networks, from the weights of `vig reproduce --net paper`."""

    kind = "paper"
    has_map = False

    def _read(self, path: Path, settings: dict[str, Any], tensors: dict[str, np.ndarray]) -> None:
        self.network = networks_from(settings, as_tensors(tensors)).eval()
        self.settings = self.network.settings
        self.weights = {name: value.numpy() for name, value in self.network.state_dict().items()}
        numbers = len(self.network.deviation)  # predicted unscaled
        self.mean, self.deviation = np.zeros(numbers, np.float32), np.ones(numbers, np.float32)

    @torch.inference_mode()
    def _predict(self, photos: np.ndarray, sides: Sequence[bool]) -> Prediction:
        pixels = torch.from_numpy(srgb_from_linear(photos)).permute(0, 3, 1, 2)
        with bfloat16(pixels.device):
            outputs = self.network(pixels)
        count = len(photos)  # the paper has neither rolled cameras nor photos without the object
        azimuth, numbers, deviation, mask = outputs
        arrays = [each.numpy().copy() for each in (azimuth, numbers, deviation, mask)]
        arrays += [np.zeros(count, np.float32), np.ones(count, np.float32)]
        return Prediction(*arrays)


def recognizer_of(object_class: ObjectClass, weights: Path | None = None) -> Recognizer:
    """Return the recognizer of a class, or of other weights, vig's or the paper's; UserError without any."""
    path = weights or (object_class.folder or Path()) / "recognition.safetensors"
    return _kind_of(path).of_class(object_class, weights)


def _kind_of(path: Path) -> type[Recognizer]:
    try:
        with safe_open(path, framework="pt") as file:
            return PaperRecognizer if (file.metadata() or {}).get("net") == "paper" else Recognizer
    except (OSError, SafetensorError):
        return Recognizer  # whose error names the fault
