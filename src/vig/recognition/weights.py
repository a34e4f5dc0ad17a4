"""Weights of recognition networks as their files hold them: packed matrices, a shared trunk."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping
from pathlib import Path

import torch
from torch import nn

from vig.io.checks import read_tensors, reading

FORMAT = "4"
"""Of weights files; 2 had another trunk, 3 a narrower decoder."""

TRUNK_FILE = Path(__file__).with_name("trunk.safetensors")
"""The trunk that weights files of classes leave out, as all share it."""
TRUNK_PREFIXES = ("stem.", "stages.")
"""What the names of the trunk's weights begin with."""

PACKED, STEPS = ".int4", ".steps"
"""What the names of a packed matrix's two tensors end with."""


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


@functools.lru_cache(maxsize=1)
def shared_trunk() -> tuple[dict[str, torch.Tensor], str]:
    """Tensors of the trunk that all classes share, by the network's names; and their fingerprint."""
    with reading(TRUNK_FILE, "the shared trunk", "Install vig again."):
        tensors, _ = read_tensors(TRUNK_FILE, "pt")
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(name.encode() + tensors[name].numpy().tobytes())
    return tensors, digest.hexdigest()[:16]


def whole_tensors(
    tensors: Mapping[str, torch.Tensor], metadata: Mapping[str, str]
) -> dict[str, torch.Tensor]:
    """The tensors of a weights file: packed matrices are unpacked, the trunk that it names is among them.

    Raises:
        ValueError: It was trained on another trunk, or a packed matrix is not one.
    """
    packed = [name.removesuffix(PACKED) for name in tensors if name.endswith(PACKED)]
    tensors = {name: value for name, value in tensors.items() if not name.endswith((PACKED, STEPS))} | {
        name: unpacked(tensors[name + PACKED], tensors[name + STEPS]) for name in packed
    }
    if "trunk" not in metadata:
        return tensors
    trunk, fingerprint = shared_trunk()
    if metadata["trunk"] != fingerprint:
        raise ValueError(f"it goes with trunk {metadata['trunk'][:16]}, where this vig has {fingerprint}")
    return {**tensors, **{f"network.{name}": value for name, value in trunk.items()}}


def packed(matrix: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """A matrix (R, 2 C) in 4 bits each: (R, C) uint8, and (R,) float16 steps, a row's largest over 7."""
    steps = (matrix.abs().amax(1) / 7).clamp_min(1e-7).half()
    levels = (matrix / steps.float()[:, None]).round().clamp(-8, 7).to(torch.int16) + 8
    return (levels[:, ::2] * 16 + levels[:, 1::2]).to(torch.uint8), steps


def unpacked(levels: torch.Tensor, steps: torch.Tensor) -> torch.Tensor:
    """The float32 matrix (R, 2 C) of what `packed` gives. ValueError when they are something else."""
    if levels.dtype != torch.uint8 or levels.ndim != 2 or steps.shape != levels.shape[:1]:
        raise ValueError(f"a packed matrix of {tuple(levels.shape)} {levels.dtype}, {tuple(steps.shape)}")
    pairs = torch.stack([levels // 16, levels % 16], 2).flatten(1).float() - 8
    return pairs * steps.float()[:, None]
