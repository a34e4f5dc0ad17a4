"""Private interfaces of torch and Warp: each function documents what it does when one is missing."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Iterable
from typing import Any

import torch
from torch.autograd import forward_ad


def packed_launch(command: Any) -> tuple[Callable[[], object], Any] | None:
    """A recorded CPU launch as a call, and the C structure of its arguments `argument_0`, `argument_1`, ...

    Warp packs a launch's arguments anew each time, which takes longer than many a kernel runs; here they are
    packed once. None on a GPU and where Warp has no such parts: `command.launch` does the same.
    """
    hooks, parameters = getattr(command, "hooks", None), getattr(command, "params", None)
    forward = getattr(hooks, "forward", None)
    if not command.device.is_cpu or forward is None or parameters is None:
        return None
    bounds, *arguments = parameters
    fields = [(f"argument_{i}", type(argument)) for i, argument in enumerate(arguments)]
    packed = type("Arguments", (ctypes.Structure,), {"_fields_": fields})(*arguments)
    structures = ctypes.byref(bounds), ctypes.byref(packed)
    return lambda: forward(*structures), packed


def transforms(*cotangents: torch.Tensor | None) -> bool:
    """Whether a transform of torch.func is active, or a cotangent is a batch of them; True when unknown."""
    functorch = getattr(torch._C, "_functorch", None)
    levels = getattr(functorch, "peek_interpreter_stack", None)
    batched = getattr(functorch, "is_legacy_batchedtensor", None)
    if levels is None or levels() is not None:
        return True
    return any(each is not None and (batched is None or batched(each)) for each in cotangents)


def records() -> bool:
    """Whether torch records operations (torch.jit.trace, make_fx, torch.func.linearize, torch.export)."""
    proxies = getattr(sys.modules.get("torch.fx.experimental.proxy_tensor"), "get_proxy_mode", None)
    return bool(torch.jit.is_tracing()) or (proxies is not None and proxies() is not None)


def differentiates_forward(tensors: Iterable[torch.Tensor]) -> bool:
    """Whether a transform of torch.func is active, or any of the tensors has a tangent; True when unknown."""
    return transforms() or any(forward_ad.unpack_dual(tensor).tangent is not None for tensor in tensors)
