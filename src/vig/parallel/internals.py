"""Private interfaces of libraries: each function documents what it does when one is missing."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.process import BaseProcess

import torch
from torch import nn


def has_bfloat16() -> bool:
    """Whether the processor multiplies in bfloat16 (AVX-512 BF16, AMX); False when unknown."""
    ask = getattr(torch.cpu, "_is_avx512_bf16_supported", None)
    return bool(ask()) if ask is not None else False


def packed_convolution(
    layer: nn.Conv2d, clipped: bool, size: Iterable[int]
) -> Callable[[torch.Tensor], torch.Tensor] | None:
    """A convolution, with ReLU6 after it if `clipped`, its weights laid out as oneDNN reads them on the CPU.

    torch lays them out at each call, and clips in a second pass. `size`: (N, C, H, W) of the inputs for which
    they are laid out; others may have another. None where torch or the processor cannot do it, or on a GPU.
    """
    backend = torch.backends.mkldnn
    if not (backend.is_available() and backend.enabled and layer.weight.device.type == "cpu"):
        return None
    if layer.padding_mode != "zeros" or isinstance(layer.padding, str):
        return None
    places = *map(list, (layer.padding, layer.stride, layer.dilation)), layer.groups
    activation = ("hardtanh", [0.0, 6.0], "") if clipped else ("none", [], "")
    kind, bias = layer.weight.dtype, None
    if layer.bias is not None:
        bias = layer.bias.detach().to(kind)

    def run(image: torch.Tensor) -> torch.Tensor:
        result: torch.Tensor = torch.ops.mkldnn._convolution_pointwise(
            image.to(kind), weight, bias, *places, *activation
        )
        return result

    try:
        weight = torch.ops.mkldnn._reorder_convolution_weight(layer.weight.detach(), *places, list(size))
        run(torch.zeros(*size))
    except (AttributeError, RuntimeError, TypeError):
        return None
    return run


def process_of(executor: ProcessPoolExecutor) -> BaseProcess | None:
    """The process of an executor that has one, for its exit code; None when unknown."""
    return next(iter((getattr(executor, "_processes", None) or {}).values()), None)
