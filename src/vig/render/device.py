"""Warp, set up once: quiet, forward kernels only, any scalar type."""

from __future__ import annotations

import ctypes
import functools
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import cast

import torch
import warp as wp

from vig.errors import UserError

wp.config.log_level = wp.LOG_ERROR
wp.config.enable_backward = False

_starting = threading.Lock()


@functools.cache
def initialise() -> None:
    """Start Warp. UserError when its library cannot be loaded or its kernel cache not be written."""
    try:
        with _starting, _without_native_messages():
            wp.init()
    except (OSError, RuntimeError) as error:
        raise UserError(f"Warp could not start: {error}; `vig doctor` tells more") from error


@contextmanager
def _without_native_messages() -> Iterator[None]:
    """Keep Warp's library from writing to the terminal of a missing CUDA driver, whatever the log level."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def scalar_type(dtype: torch.dtype) -> type:
    """Warp's scalar for torch.float32 or torch.float64."""
    if dtype not in (torch.float32, torch.float64):
        raise ValueError(f"the renderer works in float32 or float64; got {dtype}")
    return wp.float32 if dtype == torch.float32 else wp.float64


def warp_array(tensor: torch.Tensor, dtype: type) -> wp.array:
    """A Warp view of a contiguous tensor, no copy; trailing axes become the vector type's."""
    initialise()
    return cast(wp.array, wp.from_torch(tensor, dtype=dtype, requires_grad=False))


def prepared(command: wp.Launch) -> Callable[[], object]:
    """A recorded launch as a call that costs as little as may be.

    On the CPU Warp packs a launch's arguments anew each time, which takes longer than many a kernel runs;
    here they are packed once. The caller keeps the launch, and what its arguments point to.
    """
    hooks, parameters = getattr(command, "hooks", None), getattr(command, "params", None)
    if not command.device.is_cpu or hooks is None or parameters is None:
        return command.launch
    bounds, *arguments = parameters
    fields = [(f"argument_{i}", type(argument)) for i, argument in enumerate(arguments)]
    packed = type("Arguments", (ctypes.Structure,), {"_fields_": fields})(*arguments)
    return functools.partial(hooks.forward, ctypes.byref(bounds), ctypes.byref(packed))
