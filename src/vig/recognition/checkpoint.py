"""Weights and checkpoints as safetensors."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import torch
from safetensors.torch import save_file

from vig.checks import read_tensors, reading
from vig.errors import UserError
from vig.files import atomic_write
from vig.recognition.network import RecognitionNetwork

FORMAT = "2"
"""Of weights files; 1 had the regressed numbers in another order."""

Scale = dict[str, torch.Tensor]
"""`mean` and `deviation` (M,) of the regressed numbers over the training images."""


def save_weights(network: RecognitionNetwork, scale: Scale, path: Path) -> None:
    """Write a network in half precision with its settings and the targets' scale."""
    tensors = {
        f"network.{k}": v.half() if v.is_floating_point() else v for k, v in network.state_dict().items()
    }
    tensors |= {f"scale.{k}": v for k, v in scale.items()}
    with atomic_write(path) as temporary:
        save_file(
            {k: v.contiguous().cpu() for k, v in tensors.items()},
            temporary,
            metadata={"net": "vig", "format": FORMAT, "settings": json.dumps(asdict(network.settings))},
        )


def save_checkpoint(
    path: Path,
    networks: dict[str, RecognitionNetwork],
    optimizer: torch.optim.Optimizer,
    told: dict[str, str],
) -> None:
    """Write networks by name, the optimiser's moments, and what was `told` of the run."""
    tensors = {f"{name}.{k}": v for name, net in networks.items() for k, v in net.state_dict().items()}
    for parameter, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{parameter}.{k}": v for k, v in state.items()}
    with atomic_write(path) as temporary:
        save_file({k: v.contiguous().cpu() for k, v in tensors.items()}, temporary, metadata=told)


def load_checkpoint(
    path: Path, networks: dict[str, RecognitionNetwork], optimizer: torch.optim.Optimizer, run: str
) -> dict[str, str]:
    """Put a checkpoint back; returns what was told of its run.

    Raises UserError when it is damaged or another `run`'s.
    """
    with reading(path, "a checkpoint of a training run", "Remove it to train from the start."):
        tensors, told = read_tensors(path, "pt")
        if told["run"] != run:
            raise UserError(
                f"'{path.parent}' holds another training run's checkpoint; choose another folder or remove it"
            )
        for name, module in networks.items():
            prefix = f"{name}."
            module.load_state_dict(
                {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
            )
        state: dict[int, dict[str, torch.Tensor]] = {}
        parameters = [p for group in optimizer.param_groups for p in group["params"]]
        for key, tensor in tensors.items():
            if key.startswith("optimizer."):
                _, parameter, name = key.split(".", 2)
                own = parameters[int(parameter)]
                if tensor.ndim:  # the fused step walks through memory: its state must lie as the weights do
                    if tensor.shape != own.shape:
                        raise ValueError(f"'{key}' must be {tuple(own.shape)}; it is {tuple(tensor.shape)}")
                    tensor = torch.empty_like(own).copy_(tensor)
                state.setdefault(int(parameter), {})[name] = tensor
        whole = optimizer.state_dict()
        whole["state"] = state
        optimizer.load_state_dict(whole)
    return told
