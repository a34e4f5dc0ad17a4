"""Functions of arrays that numpy does not have, and the module that has those of an array."""

from __future__ import annotations

import sys
from typing import Any, TypeAlias

import numpy as np

Array: TypeAlias = Any
"""An array of numpy or, of a caller who has torch, one of its tensors."""


def namespace(array: Any) -> Any:
    """The module with the functions of an array: numpy, or that of a caller's tensors.

    What is written with it (scenes, not fits) also takes tensors of torch, and is differentiated there.
    """
    kind = type(array).__module__.split(".")[0]
    return np if kind in ("numpy", "builtins") else sys.modules[kind]


def sigmoid(log_odds: np.ndarray) -> np.ndarray:
    """Probabilities of log odds, in their dtype."""
    half = log_odds.dtype.type(0.5)
    probability: np.ndarray = half + half * np.tanh(half * log_odds)
    return probability


def softmax(logits: np.ndarray, axis: int = -1) -> np.ndarray:
    """Probabilities of logits along an axis."""
    powers = np.exp(logits - logits.max(axis, keepdims=True))
    probability: np.ndarray = powers / powers.sum(axis, keepdims=True)
    return probability
