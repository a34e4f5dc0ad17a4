"""Functions that numpy does not have, and arrays of a caller's tensors."""

import math
from typing import Any

import numpy as np

from vig_renderer.arrays import is_tensor


def numpy_of_tensor(value: Any) -> Any:
    """Return the array of one of torch's tensors; anything else as it is."""
    if not is_tensor(value):
        return value
    host = value.detach().cpu()
    return (host.float() if str(host.dtype) == "torch.bfloat16" else host).numpy()  # numpy has no bfloat16


def sigmoid(log_odds: np.ndarray) -> np.ndarray:
    """Return probabilities of log odds, in their dtype."""
    half = log_odds.dtype.type(0.5)
    probability: np.ndarray = half + half * np.tanh(half * log_odds)
    return probability


def log_odds(probability: float) -> float:
    """Return the log odds of a probability, or of 0.001 or 0.999 where it is nearer to 0 or 1."""
    bounded = min(max(probability, 1e-3), 1 - 1e-3)
    return math.log(bounded / (1 - bounded))


def softmax(logits: np.ndarray, axis: int = -1) -> np.ndarray:
    """Return probabilities of logits along an axis."""
    powers = np.exp(logits - logits.max(axis, keepdims=True))
    probability: np.ndarray = powers / powers.sum(axis, keepdims=True)
    return probability
