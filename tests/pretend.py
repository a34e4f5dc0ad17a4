"""A GPU that is pretended: its tensors lie in the host's memory, but must not meet the host's own.

While `PretendDevice` is active, tensors made on or moved to "cuda:0" say that they are there, as does what
comes of them. torch refuses most operations on tensors of two devices; here all are refused, those, too, for
which it would copy and wait. Kernels run on the CPU, with tensors of the device alone.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import torch
import warp as wp
from torch.overrides import TorchFunctionMode
from torch.utils._pytree import tree_leaves, tree_map

NAME = "cuda:0"
DEVICE = torch.device(NAME)
COPIES = {torch.Tensor.copy_, torch.Tensor.to, torch.Tensor.cpu}
"""What may take a tensor from one device to the other."""
READ = {torch.Tensor.tolist, torch.Tensor.item, torch.Tensor.nonzero, torch.Tensor.cpu, torch.masked_select}
READ |= {torch.Tensor.__float__, torch.Tensor.__int__, torch.Tensor.__bool__}
"""What waits until the device has computed."""


class MixedDevicesError(RuntimeError):
    """A tensor of the host met one of the device, or was read as if it were the host's."""


def is_there(tensor: Any) -> bool:
    """Whether a tensor is on the pretended device."""
    return bool(tensor.__dict__.get("pretended")) if isinstance(tensor, torch.Tensor) else False


def _sent(result: Any) -> Any:
    for leaf in tree_leaves(result):
        if isinstance(leaf, torch.Tensor):
            leaf.__dict__["pretended"] = True
    return result


def _is_device(given: Any) -> bool:
    return isinstance(given, str | torch.device) and str(given) == NAME


class PretendDevice(TorchFunctionMode):
    """See the module. `reads` counts how often the host waited for a number of the device."""

    reads = 0

    def __torch_function__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = dict(kwargs or {})
        given = [leaf for leaf in tree_leaves((args, kwargs)) if isinstance(leaf, torch.Tensor)]
        there = [tensor for tensor in given if is_there(tensor)]
        if function == torch.Tensor.device.__get__:
            return DEVICE if there else function(*args)
        if function == torch.Tensor.data.__set__:
            function(*args)
            args[0].__dict__["pretended"] = is_there(args[1])
            return None
        self.reads += function in READ and bool(there)
        if function in (torch.Tensor.numpy, torch.Tensor.__array__) and there:
            raise MixedDevicesError("a tensor of the device was taken for an array")
        if function in (torch.Tensor.cpu, torch.Tensor.to):
            return self._moved(function, args, kwargs, there)
        here = [tensor for tensor in given if not is_there(tensor) and tensor.ndim > 0]
        if function is torch._has_compatible_shallow_copy_type:  # a module that is moved asks, then sets data
            return True
        if there and here and function not in COPIES:
            shapes = [tuple(tensor.shape) for tensor in here]
            raise MixedDevicesError(
                f"{function.__name__} of tensors of the device and of the host's {shapes}"
            )
        sent = _is_device(kwargs.get("device"))
        if sent:
            kwargs["device"] = "cpu"
        result = function(*args, **kwargs)
        if function in (torch.Tensor.copy_, torch.Tensor.__setitem__):
            return result
        return _sent(result) if sent or there else result

    def _moved(self, function: Any, args: Any, kwargs: Any, there: list[torch.Tensor]) -> Any:
        target = None
        for each in (*args[1:], kwargs.get("device")):
            if isinstance(each, torch.Tensor):
                target = DEVICE if is_there(each) else torch.device("cpu")
            elif isinstance(each, str | torch.device):
                target = torch.device(each)
        if function is torch.Tensor.cpu:
            target = torch.device("cpu")
        args, kwargs = tree_map(lambda each: "cpu" if _is_device(each) else each, (args, kwargs))
        was_there = bool(there) and is_there(args[0])
        goes_there = was_there if target is None else target == DEVICE
        result = function(*args, **kwargs)
        if was_there != goes_there and result is args[0]:
            result = result.clone()
        result.__dict__["pretended"] = goes_there
        return result


@contextmanager
def pretended(patch: pytest.MonkeyPatch) -> Iterator[PretendDevice]:
    """Within, torch and Warp have a device "cuda:0". On one thread, as the mode is a thread's own."""
    mode = PretendDevice()
    from_torch = wp.from_torch

    def checked(tensor: torch.Tensor, *args: Any, **kwargs: Any) -> Any:
        if not is_there(tensor):
            raise MixedDevicesError(f"a kernel of the device was given the host's {tuple(tensor.shape)}")
        with torch._C.DisableTorchFunction():
            return from_torch(tensor, *args, **kwargs)

    def on_cpu(call: Any) -> Any:
        @functools.wraps(call)
        def renamed(*args: Any, **kwargs: Any) -> Any:
            args, kwargs = (
                ("cpu" if _is_device(a) else a for a in args),
                {name: "cpu" if _is_device(a) else a for name, a in kwargs.items()},
            )
            return call(*args, **kwargs)

        return renamed

    patch.setattr(wp, "from_torch", checked)
    for name in ("launch", "zeros", "force_load"):
        patch.setattr(wp, name, on_cpu(getattr(wp, name)))
    patch.setattr(wp, "get_cuda_device_count", lambda: 1)
    patch.setattr(torch.cuda, "device_count", lambda: 1)
    patch.setattr(torch.cuda, "is_bf16_supported", lambda *_: False)
    patch.setattr("vig_renderer.device.current_stream", lambda device: None)
    patch.setattr("vig_renderer.device.packed_launch", lambda command: None)  # as on a GPU
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with mode:
            yield mode
    finally:
        torch.set_num_threads(before)
