"""Warp, set up once: quiet, forward kernels only, any scalar type."""

from __future__ import annotations

import ctypes
import functools
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import cast

import torch
import warp as wp

from vig.errors import UserError

wp.config.log_level = wp.LOG_ERROR
wp.config.enable_backward = False

_NATIVE = {wp.float32: "float", wp.float64: "double"}
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


def native_code(folder: Path, *files: str, real: type, **constants: int | float) -> str:
    """The code of .cc files, one after the other, for `wp.func_native`: bodies of functions.

    Before it stand the type `real` and the constants as `constexpr`, each of its Python type.
    """
    preamble = [f"typedef {_NATIVE[real]} real;"]
    for name, number in constants.items():
        if isinstance(number, float):
            preamble.append(f"constexpr real {name} = real({number!r});")
        else:
            kind = "bool" if isinstance(number, bool) else "wp::int64" if number.bit_length() > 31 else "int"
            preamble.append(f"constexpr {kind} {name} = {str(number).lower()};")
    return "\n".join([*preamble, *((folder / file).read_text() for file in files)])


def warp_array(tensor: torch.Tensor, dtype: type) -> wp.array:
    """A Warp view of a contiguous tensor, no copy; trailing axes become the vector type's."""
    initialise()
    return cast(wp.array, wp.from_torch(tensor, dtype=dtype, requires_grad=False))


class Prepared:
    """A recorded launch as a call that costs as little as may be, and whose arrays can be exchanged.

    On the CPU Warp packs a launch's arguments anew each time, which takes longer than many a kernel runs;
    here they are packed once. The launch is kept; what its arguments point to, the caller keeps.
    """

    def __init__(self, command: wp.Launch):
        self._command, self._packed = command, None
        hooks, parameters = getattr(command, "hooks", None), getattr(command, "params", None)
        self._launch: Callable[[], object] = command.launch
        if command.device.is_cpu and hooks is not None and parameters is not None:
            bounds, *arguments = parameters
            fields = [(f"argument_{i}", type(argument)) for i, argument in enumerate(arguments)]
            self._packed = type("Arguments", (ctypes.Structure,), {"_fields_": fields})(*arguments)
            self._launch = functools.partial(hooks.forward, ctypes.byref(bounds), ctypes.byref(self._packed))

    def __call__(self) -> object:
        """Launch."""
        return self._launch()

    def exchange(self, index: int, array: wp.array) -> None:
        """From now on argument `index` is another array of the same type and number of axes."""
        if self._packed is None:
            self._command.set_param_at_index(index, array)
        else:
            setattr(self._packed, f"argument_{index}", array.__ctype__())
