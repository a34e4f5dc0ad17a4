"""Default settings of torch and numpy, within a program that may have set others."""

import inspect
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property, wraps
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    import torch

_here, _counting = threading.local(), threading.Lock()
_inside = 0
_dtype_outside: "torch.dtype | None" = None
Public = TypeVar("Public", bound=Callable[..., Any])


@contextmanager
def default_settings(inference: bool | None = None) -> Iterator[None]:
    """Let torch make float32 tensors on the CPU without autocast, and numpy's arithmetic raise nothing.

    The default dtype is the whole process's: it is restored when the last thread leaves. inference: whether
    torch's inference mode is on; None leaves it. Within another such block nothing changes. A torch that
    is not loaded is left alone.
    """
    if getattr(_here, "inside", False):
        yield
        return
    with ExitStack() as stack:
        _here.inside = True
        stack.callback(_leave)
        if (torch := sys.modules.get("torch")) is not None and hasattr(torch, "get_default_dtype"):
            _enter_torch(torch, stack, inference)
        stack.enter_context(np.errstate(divide="warn", over="warn", under="ignore", invalid="warn"))
        yield


def _enter_torch(torch: Any, stack: ExitStack, inference: bool | None) -> None:
    """Enter the part of `default_settings` that is torch's."""
    global _inside, _dtype_outside
    with _counting:
        if not _inside:
            _dtype_outside = torch.get_default_dtype()
        _inside += 1
    stack.callback(_leave_torch, torch)
    torch.set_default_dtype(torch.float32)
    if torch.empty(0).device.type != "cpu":
        stack.enter_context(torch.device("cpu"))
    for kind in ("cpu", "cuda"):
        if torch.is_autocast_enabled(kind):
            stack.enter_context(torch.autocast(kind, enabled=False))
    if inference not in (None, torch.is_inference_mode_enabled()):
        grad = torch.is_grad_enabled()
        stack.enter_context(torch.inference_mode(inference))
        stack.enter_context(torch.set_grad_enabled(grad))


def _leave() -> None:
    _here.inside = False


def _leave_torch(torch: Any) -> None:
    global _inside
    with _counting:
        _inside -= 1
        if not _inside:
            torch.set_default_dtype(_dtype_outside)


def with_default_settings(public: Public) -> Public:
    """Run a function, or the public methods and properties of a class, within `default_settings`.

    Generators run as they are: functions that they call must do so. Tensors that outlive a call are ordinary
    ones, also of a caller in inference mode.
    """
    if isinstance(public, type):
        for name, member in list(vars(public).items()):
            if name.startswith("_") and name != "__call__":
                continue
            if isinstance(member, property) and member.fget is not None:
                setattr(public, name, member.getter(with_default_settings(member.fget)))
            elif isinstance(member, cached_property):
                member.func = with_default_settings(member.func)
            elif inspect.isfunction(member):
                setattr(public, name, with_default_settings(member))
            elif isinstance(member, staticmethod | classmethod):
                setattr(public, name, type(member)(with_default_settings(member.__func__)))
        return public
    if inspect.isgeneratorfunction(public):
        return public

    @wraps(public)
    def within(*arguments: Any, **named: Any) -> Any:
        with default_settings(inference=False):
            return public(*arguments, **named)

    return within  # type: ignore[return-value]
