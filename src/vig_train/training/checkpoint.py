"""Weights and checkpoints as safetensors."""

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import torch
from torch import nn

from vig.io.checks import read_tensors, reading
from vig.io.errors import UserError
from vig.recognition.weights import FORMAT, PACKED, STEPS, TRUNK_PREFIXES
from vig.recognition.weights import shared_trunk as trunk_of_classes
from vig_train.network import weights
from vig_train.network.network import RecognitionNetwork

MOMENTS: dict[type, tuple[str, ...]] = {
    torch.optim.AdamW: ("step", "exp_avg", "exp_avg_sq"),
    torch.optim.SGD: ("momentum_buffer",),
}
"""State that an optimiser keeps of each weight which it has changed."""

Scale = dict[str, torch.Tensor]
"""`mean` and `deviation` (M,) of the regressed numbers over the training images."""


def save_weights(
    network: RecognitionNetwork,
    scale: Scale,
    path: Path,
    shared_trunk: bool = False,
    more: Mapping[str, str] | None = None,
    packed: Sequence[str] = (),
) -> None:
    """Write a network in half precision with its settings and the targets' scale.

    Args:
        network: To write.
        scale: Scale of its targets.
        path: Path of the file.
        shared_trunk: Name the trunk in place of writing it.
        more: Further metadata of the file.
        packed: Names of matrices that are written in 4 bits, see `vig_train.network.weights.pack_matrix`.
    """
    tensors = {
        f"network.{k}": v.half() if v.is_floating_point() else v
        for k, v in network.state_dict().items()
        if not (shared_trunk and k.startswith(TRUNK_PREFIXES)) and k not in packed
    }
    for name in packed:
        levels, steps = weights.pack_matrix(network.state_dict()[name].cpu().numpy())
        parts = {f"network.{name}{PACKED}": levels, f"network.{name}{STEPS}": steps}
        tensors |= weights.as_tensors(parts)
    tensors |= {f"scale.{k}": v for k, v in scale.items()}
    metadata = {"net": "vig", "format": FORMAT, "settings": json.dumps(asdict(network.settings))}
    if shared_trunk:
        metadata["trunk"] = trunk_of_classes()[1]
    weights.save_tensors(path, tensors, metadata | dict(more or {}))


def save_checkpoint(
    path: Path, networks: Mapping[str, nn.Module], optimizer: torch.optim.Optimizer, state: dict[str, str]
) -> None:
    """Write networks by name, the optimiser's moments, and the `state` of the run."""
    tensors = {f"{name}.{k}": v for name, net in networks.items() for k, v in net.state_dict().items()}
    for parameter, moments in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{parameter}.{k}": v for k, v in moments.items()}
    weights.save_tensors(path, tensors, state)


def load_checkpoint(
    path: Path, networks: Mapping[str, nn.Module], optimizer: torch.optim.Optimizer, run: str
) -> dict[str, str]:
    """Put a checkpoint back; return the state of its run.

    Args:
        path: Path of the checkpoint.
        networks: Networks, as they were saved; they take on its weights.
        optimizer: Optimizer with `MOMENTS`; it takes on its moments.
        run: The `run` that the state must have.

    Raises:
        UserError: It is damaged, has other tensors, or is of another run.
    """
    with reading(path, "a checkpoint of a training run", "Remove it to train from the start."):
        tensors, state = read_tensors(path, "pt")
        if state["run"] != run:
            raise UserError(
                f"'{path.parent}' holds another training run's checkpoint; choose another folder or remove it"
            )
        parameters = [p for group in optimizer.param_groups for p in group["params"]]
        names = MOMENTS[type(optimizer)]
        changed = {name.split(".")[1] for name in tensors if name.startswith("optimizer.")}
        changed &= {str(i) for i in range(len(parameters))}
        expected = {f"{name}.{k}" for name, module in networks.items() for k in module.state_dict()}
        expected |= {f"optimizer.{i}.{k}" for i in changed for k in names}
        if differing := sorted(expected ^ tensors.keys()):
            raise ValueError(f"tensors are missing or unknown: {', '.join(differing)[:100]}")
        for name, module in networks.items():
            module.load_state_dict({k: tensors[f"{name}.{k}"] for k in module.state_dict()})
        moments: dict[int, dict[str, torch.Tensor]] = {int(i): {} for i in sorted(changed, key=int)}
        for i, name in itertools.product(moments, names):
            parameter, tensor = parameters[i], tensors[f"optimizer.{i}.{name}"]
            if tensor.shape != (shape := () if name == "step" else parameter.shape):
                raise ValueError(f"'{name}' of a weight must be {tuple(shape)}; it is {tuple(tensor.shape)}")
            # The fused step walks through memory: its moments must lie as the weights do.
            moments[i][name] = torch.empty_like(parameter).copy_(tensor) if tensor.ndim else tensor
        optimizer.load_state_dict(optimizer.state_dict() | {"state": moments})
    return state
