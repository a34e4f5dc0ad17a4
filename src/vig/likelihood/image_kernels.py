"""Native functions of whole images, on the processor, all images in one launch."""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import Any

import torch
import warp as wp

from vig_renderer.device import initialise, kernel_module, native_code, start
from vig_renderer.once import make_once

CELLS = 24
"""Cells of the colour cube along each channel: about the robust model's noise, 0.03, each."""


@make_once
def image_kernels() -> dict[str, Any]:
    """Kernels by the names of their `.cc` files; a thread for each image. They take addresses of memory."""
    initialise()
    return {"minimum_cut": _kernel("minimum_cut"), "colour_density": _kernel("colour_density", CELLS=CELLS)}


def _kernel(name: str, **constants: int) -> Any:
    code = native_code(Path(__file__).parent, f"{name}.cc", real=wp.float64, **constants)

    def function(image: wp.int32, height: wp.int32, width: wp.int32, places: wp.uint64): ...

    function.__qualname__ = f"{name}_native"  # Warp identifies functions and kernels of a module by this
    native = wp.func_native(snippet=code)(function)

    def run(height: wp.int32, width: wp.int32, places: wp.uint64):
        native(wp.tid(), height, width, places)

    run.__qualname__ = name
    return wp.kernel(module=kernel_module("image", torch.float64))(run)


def _launch(name: str, size: torch.Size, *tensors: torch.Tensor) -> None:
    count, height, width = size
    places = array("Q", [tensor.data_ptr() for tensor in tensors])
    start(image_kernels()[name], count, [height, width, places.buffer_info()[0]])


def minimum_cut(free: torch.Tensor, alone: torch.Tensor, links: torch.Tensor) -> torch.Tensor:
    """Which free pixels (N, H, W) bool are visible in the cut of least capacity that has fewest of them.

    alone (N, H, W) int32: the capacity lost where a pixel is hidden, less that where it is visible. links
    (N, 8, H, W) int32, used up: that lost where of a pixel and its neighbour one is visible, for the steps
    (0, 1), (1, 0), (1, 1), (1, -1), each before its opposite; 0 unless both are free. Contiguous, on the CPU.
    """
    free, (count, height, width) = free.contiguous(), alone.shape
    visible, heights = torch.empty_like(free), alone.new_empty(count, 2, height, width)
    _launch("minimum_cut", alone.shape, free, visible, alone, links, heights, heights.long())
    return visible


def colour_density(photo: torch.Tensor, shares: torch.Tensor) -> torch.Tensor:
    """Density (N, H, W) of each pixel's colour, relative to uniform on the cube, under N weightings.

    photo (H, W, 3) linear RGB in [0, 1], else clamped, NaN to 0; shares (N, H, W), each of sum 1. A trilinear
    histogram, smoothed by one cell. On the CPU, in float64, without gradients: the result does not depend on
    threads.

    Raises:
        ValueError: They are of other shapes, or not on the CPU.
    """
    if shares.ndim != 3 or photo.shape != (*shares.shape[1:], 3):
        raise ValueError(
            f"photo must be (H, W, 3) and shares (N, H, W); got {tuple(photo.shape)}, {tuple(shares.shape)}"
        )
    if photo.device.type != "cpu" or shares.device.type != "cpu":
        raise ValueError(f"photo and shares must be on the CPU; got {photo.device}, {shares.device}")
    photo, shares = photo.double().contiguous(), shares.double().contiguous()
    density, work = torch.empty_like(shares), shares.new_empty(len(shares), 2, CELLS**3)
    _launch("colour_density", shares.shape, photo, shares, density, work)
    return density
