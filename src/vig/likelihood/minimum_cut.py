"""The minimum cut of images, on the processor, all in one launch."""

import functools
from array import array
from pathlib import Path
from typing import Any

import torch
import warp as wp

from vig.renderer.device import initialise, kernel_module, native_code


@functools.cache
def cut_kernel() -> Any:
    """The kernel of a minimum cut; a thread for each image. It takes addresses, of the processor's memory."""
    initialise()

    @wp.func_native(snippet=native_code(Path(__file__).parent, "minimum_cut.cc", real=wp.float32))
    def cut_one(image: wp.int32, height: wp.int32, width: wp.int32, places: wp.uint64): ...

    @wp.kernel(module=kernel_module("search", torch.float32))
    def cut(height: wp.int32, width: wp.int32, places: wp.uint64):
        cut_one(wp.tid(), height, width, places)

    return cut


def minimum_cut(free: torch.Tensor, alone: torch.Tensor, links: torch.Tensor) -> torch.Tensor:
    """Which free pixels (N, H, W) bool are visible in the cut of least capacity that has fewest of them.

    alone (N, H, W) int32: the capacity lost where a pixel is hidden, less that where it is visible. links
    (N, 8, H, W) int32, used up: that lost where of a pixel and its neighbour one is visible, for the steps
    (0, 1), (1, 0), (1, 1), (1, -1), each before its opposite; 0 unless both are free. Contiguous, on the CPU.
    """
    free, (count, height, width) = free.contiguous(), alone.shape
    visible, heights = torch.empty_like(free), alone.new_empty(count, 2, height, width)
    tensors = free, visible, alone, links, heights, heights.long()
    places = array("Q", [tensor.data_ptr() for tensor in tensors])
    wp.launch(cut_kernel(), count, [height, width, places.buffer_info()[0]], device="cpu")
    return visible
