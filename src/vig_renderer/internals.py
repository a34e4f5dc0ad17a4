"""Private interfaces of torch: each function documents its result when one is missing."""

from __future__ import annotations

import sys

import torch


def transforms(*cotangents: torch.Tensor | None) -> bool:
    """Return whether a transform of torch.func is active, or a cotangent is a batch; False if unknown."""
    functorch = getattr(torch._C, "_functorch", None)
    levels = getattr(functorch, "peek_interpreter_stack", lambda: None)
    batched = getattr(functorch, "is_legacy_batchedtensor", lambda tensor: False)
    return levels() is not None or any(each is not None and batched(each) for each in cotangents)


def records() -> bool:
    """Return whether torch records operations (jit.trace, make_fx, torch.func.linearize, torch.export)."""
    proxies = getattr(sys.modules.get("torch.fx.experimental.proxy_tensor"), "get_proxy_mode", None)
    return bool(torch.jit.is_tracing()) or (proxies is not None and proxies() is not None)
