"""Private interfaces of torch: each function documents its result when one is missing."""

import sys
from collections.abc import Iterable

import torch
from torch.autograd import forward_ad


def transforms(*cotangents: torch.Tensor | None) -> bool:
    """Return whether a torch.func transform is active, or a cotangent is a batch of them; True if unknown."""
    functorch = getattr(torch._C, "_functorch", None)
    levels = getattr(functorch, "peek_interpreter_stack", None)
    batched = getattr(functorch, "is_legacy_batchedtensor", None)
    if levels is None or levels() is not None:
        return True
    return any(each is not None and (batched is None or batched(each)) for each in cotangents)


def records() -> bool:
    """Return whether torch records operations (jit.trace, make_fx, torch.func.linearize, torch.export)."""
    proxies = getattr(sys.modules.get("torch.fx.experimental.proxy_tensor"), "get_proxy_mode", None)
    return bool(torch.jit.is_tracing()) or (proxies is not None and proxies() is not None)


def differentiates_forward(tensors: Iterable[torch.Tensor]) -> bool:
    """Return whether a transform of torch.func is active, or any tensor has a tangent; True when unknown."""
    return transforms() or any(forward_ad.unpack_dual(tensor).tangent is not None for tensor in tensors)
