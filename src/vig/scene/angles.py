"""Angles round the circle."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
import torch

Angle = TypeVar("Angle", torch.Tensor, np.ndarray, float)


def angle_difference(a: Angle, b: Angle) -> Angle:
    """Return a - b round the circle, in [-pi, pi) radians; arrays or tensors that broadcast."""
    turn: Angle = (a - b + math.pi) % (2 * math.pi) - math.pi
    return turn
