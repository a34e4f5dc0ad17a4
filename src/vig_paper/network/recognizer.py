"""The paper's networks in the place of vig's recognition network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open

from vig.recognition import Prediction, Recognizer
from vig.recognition.network import bfloat16
from vig.scene import ObjectClass, srgb_from_linear
from vig_paper.network.network import networks_from


class PaperRecognizer(Recognizer):
    """The paper's four networks, from the weights of `vig reproduce --net paper`."""

    kind = "paper"
    has_map = False

    def _read(self, settings: dict[str, Any], tensors: dict[str, torch.Tensor]) -> None:
        self.network = networks_from(settings, tensors)
        numbers = len(self.network.deviation)  # predicted unscaled
        self.mean, self.deviation = torch.zeros(numbers), torch.ones(numbers)

    @torch.inference_mode()
    def _predict(self, photos: torch.Tensor, sides: Sequence[bool]) -> Prediction:
        with bfloat16(photos.device):
            outputs = self.network(srgb_from_linear(photos).permute(0, 3, 1, 2))
        count = len(photos)  # the paper knows neither a rolled camera nor photos without the object
        azimuth, numbers, deviation, mask = outputs
        return Prediction(azimuth, numbers, deviation, mask, torch.zeros(count), torch.ones(count))


def recognizer_of(object_class: ObjectClass, weights: Path | None = None) -> Recognizer:
    """The recognizer of a class, or of other weights, vig's or the paper's; UserError when it has none."""
    path = weights or (object_class.folder or Path()) / "recognition.safetensors"
    return _kind_of(path).of_class(object_class, weights)


def _kind_of(path: Path) -> type[Recognizer]:
    try:
        with safe_open(path, framework="pt") as file:
            return PaperRecognizer if (file.metadata() or {}).get("net") == "paper" else Recognizer
    except (OSError, SafetensorError):
        return Recognizer  # whose error names what is wrong
