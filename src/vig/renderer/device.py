"""Warp, set up once: quiet, forward kernels only, any scalar type."""

from __future__ import annotations

import functools
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import torch
import warp as wp

from vig.errors import UserError
from vig.parallel.internals import packed_launch

if hasattr(wp, "LOG_ERROR"):
    wp.config.log_level = wp.LOG_ERROR
else:  # Warp 1.13 has no levels
    wp.config.quiet = True
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

    The launch is kept; what its arguments point to, the caller keeps.
    """

    def __init__(self, command: wp.Launch):
        self._command = command
        self._launch: Callable[[], object] = command.launch
        self._packed: Any = None
        if (packed := packed_launch(command)) is not None:
            self._launch, self._packed = packed

    def __call__(self) -> object:
        """Launch."""
        return self._launch()

    def exchange(self, index: int, argument: Any) -> None:
        """From now on argument `index` is another array or struct of the same type."""
        if self._packed is None:
            self._command.set_param_at_index(index, argument)
        else:
            setattr(self._packed, f"argument_{index}", argument.__ctype__())
