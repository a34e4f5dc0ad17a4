"""Weights of recognition networks as their files hold them: packed matrices, a shared trunk."""

import functools
import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from vig.io.checks import read_tensors, reading

FORMAT = "4"
"""Version of weights files; 2 had another trunk, 3 a narrower decoder."""

TRUNK_FILE = Path(__file__).with_name("trunk.safetensors")
"""The trunk that weights files of classes leave out, as all share it."""
TRUNK_PREFIXES = ("stem.", "stages.")
"""Prefixes of the names of the trunk's weights."""

PACKED, STEPS = ".int4", ".steps"
"""Endings of the names of a packed matrix's two arrays."""
COUNTER, VARIANCE = "num_batches_tracked", "running_var"
"""Ending of the name of a number that only training reads, and of those of variances."""


def network_weights(tensors: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the network's weights among arrays of a weights file, as float32, by their names in the network.

    ValueError where one is no floating-point number, infinite, or a variance below 0.
    """
    own = {}
    for name, held in tensors.items():
        if not name.startswith("network.") or name.endswith(COUNTER):
            continue
        if not np.issubdtype(held.dtype, np.floating):
            raise ValueError(f"'{name[:100]}' must be floating-point numbers; it is {held.dtype}")
        value = held.astype(np.float32, copy=False)
        if not np.isfinite(value).all() or (name.endswith(VARIANCE) and (value < 0).any()):
            raise ValueError(f"'{name[:100]}' has numbers that are infinite, or variances below 0")
        own[name.removeprefix("network.")] = value
    return own


@functools.lru_cache(maxsize=1)
def shared_trunk() -> tuple[dict[str, np.ndarray], str]:
    """Return arrays of the trunk that all classes share, by the network's names; and their fingerprint."""
    with reading(TRUNK_FILE, "the shared trunk", "Install vig again."):
        tensors, _ = read_tensors(TRUNK_FILE)
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(name.encode() + tensors[name].tobytes())
    return tensors, digest.hexdigest()[:16]


def whole_tensors(tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str]) -> dict[str, np.ndarray]:
    """Return the arrays of a weights file: packed matrices are unpacked, the trunk it names is among them.

    Raises:
        ValueError: It was trained on another trunk, or a packed matrix is not one.
    """
    packed = [name.removesuffix(PACKED) for name in tensors if name.endswith(PACKED)]
    tensors = {name: value for name, value in tensors.items() if not name.endswith((PACKED, STEPS))} | {
        name: unpack_matrix(tensors[name + PACKED], tensors[name + STEPS]) for name in packed
    }
    if "trunk" not in metadata:
        return tensors
    trunk, fingerprint = shared_trunk()
    if metadata["trunk"] != fingerprint:
        raise ValueError(f"it goes with trunk {metadata['trunk'][:16]}, where this vig has {fingerprint}")
    return {**tensors, **{f"network.{name}": value for name, value in trunk.items()}}


def unpack_matrix(levels: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return the float32 matrix (R, 2 C) of 4-bit levels (R, C) uint8 and float16 steps (R,), see
    `vig_train.network.weights.pack_matrix`. ValueError when they are something else.
    """
    if levels.dtype != np.uint8 or levels.ndim != 2 or steps.shape != levels.shape[:1]:
        raise ValueError(f"a packed matrix of {levels.shape} {levels.dtype}, {steps.shape}")
    matrix = np.empty((len(levels), 2 * levels.shape[1]), np.float32)
    matrix[:, 0::2], matrix[:, 1::2] = levels >> 4, levels & 15
    matrix -= 8
    matrix *= steps.astype(np.float32)[:, None]
    return matrix
