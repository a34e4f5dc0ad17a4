"""Weights of networks in torch from their files, and matrices packed into these."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file
from torch import nn

from vig.io.checks import decode, parse_json, read_tensors, reading
from vig.io.files import atomic_write
from vig.recognition.network import NetworkSettings
from vig.recognition.weights import whole_tensors
from vig_train.network.network import RecognitionNetwork


def load_network(network: nn.Module, tensors: Mapping[str, torch.Tensor]) -> None:
    """Give a network made on torch's "meta" device, which holds no numbers, the tensors of a weights file.

    Floating-point tensors of any precision become float32. Raises ValueError when names, shapes or types
    are not the network's, so that a file cannot ask for more memory than it fills.
    """
    wanted = network.state_dict()
    if odd := sorted(wanted.keys() ^ tensors.keys()):
        raise ValueError(f"weights are missing or unknown: {', '.join(odd)[:100]}")
    for name, held in tensors.items():
        floats = held.is_floating_point(), wanted[name].is_floating_point()
        if held.shape != wanted[name].shape or floats[0] != floats[1]:
            raise ValueError(
                f"'{name}' must be {tuple(wanted[name].shape)} {wanted[name].dtype};"
                f" it is {tuple(held.shape)} {held.dtype}"
            )
    own = {name: held.to(wanted[name].dtype) for name, held in tensors.items()}
    for name, value in own.items():
        if not value.isfinite().all() or (name.endswith("running_var") and (value < 0).any()):
            raise ValueError(f"'{name}' has numbers that are infinite, or variances below 0")
    network.load_state_dict(own, assign=True)


def save_tensors(
    path: Path, tensors: Mapping[str, torch.Tensor], metadata: dict[str, str] | None = None
) -> None:
    """Write tensors of any device and layout as a safetensors file, whole or not at all."""
    with atomic_write(path) as temporary:
        save_file({name: each.contiguous().cpu() for name, each in tensors.items()}, temporary, metadata)


def as_tensors(arrays: Mapping[str, np.ndarray]) -> dict[str, torch.Tensor]:
    """Return arrays of a weights file as torch's tensors."""
    return {name: torch.from_numpy(np.array(value)) for name, value in arrays.items()}


def read_network(path: Path) -> RecognitionNetwork:
    """Return the network of a weights file, ready to predict; UserError when it is none."""
    with reading(path, "recognition weights", "Take a file of `vig train`."):
        tensors, metadata = read_tensors(path)
        settings = decode(NetworkSettings, parse_json(metadata["settings"]))
        with torch.device("meta"):
            network = RecognitionNetwork(settings)
        whole = as_tensors(whole_tensors(tensors, metadata))
        own = {k.removeprefix("network."): v for k, v in whole.items() if k.startswith("network.")}
        load_network(network, own)
    return network.eval().to(memory_format=torch.channels_last)  # type: ignore[call-overload]


def pack_matrix(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pack a matrix (R, 2 C) into 4 bits: (R, C) uint8, and (R,) float16 steps, a row's largest over 7."""
    steps = np.maximum(np.abs(matrix).max(1) / np.float32(7), np.float32(1e-7)).astype(np.float16)
    levels = np.clip(np.round(matrix / steps.astype(np.float32)[:, None]), -8, 7).astype(np.int16) + 8
    return (levels[:, ::2] * 16 + levels[:, 1::2]).astype(np.uint8), steps
