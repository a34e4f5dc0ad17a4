"""The minimum cut of images, all in one launch."""

import functools
from pathlib import Path
from typing import Any

import torch
import warp as wp

from vig.renderer.device import initialise, kernel_module, launch, native_code


@functools.cache
def cut_kernel() -> Any:
    """The kernel of a minimum cut; a thread for each image."""
    initialise()

    @wp.func_native(snippet=native_code(Path(__file__).parent, "minimum_cut.cc", real=wp.float32))
    def cut_one(
        image: wp.int32,
        free: wp.array3d(dtype=wp.bool),
        alone: wp.array3d(dtype=wp.int32),
        links: wp.array4d(dtype=wp.int32),
        space: wp.array4d(dtype=wp.int32),
        amounts: wp.array4d(dtype=wp.int64),
        visible: wp.array3d(dtype=wp.bool),
    ): ...

    @wp.kernel(module=kernel_module("search", torch.float32))
    def cut(
        free: wp.array3d(dtype=wp.bool),
        alone: wp.array3d(dtype=wp.int32),
        links: wp.array4d(dtype=wp.int32),
        space: wp.array4d(dtype=wp.int32),
        amounts: wp.array4d(dtype=wp.int64),
        visible: wp.array3d(dtype=wp.bool),
    ):
        cut_one(wp.tid(), free, alone, links, space, amounts, visible)

    return cut


def minimum_cut(free: torch.Tensor, alone: torch.Tensor, links: torch.Tensor) -> torch.Tensor:
    """Which free pixels (N, H, W) bool are visible in the cut of least capacity that has fewest of them.

    alone (N, H, W) int32: the capacity lost where a pixel is hidden, less that where it is visible. links
    (N, 8, H, W) int32, used up: that lost where of a pixel and its neighbour one is visible, for the steps
    (0, 1), (1, 0), (1, 1), (1, -1), each before its opposite; 0 unless both are free.
    """
    visible, space = torch.empty_like(free), alone.new_empty(len(alone), 2, *alone.shape[1:])
    launch(cut_kernel(), len(alone), free.contiguous(), alone, links, space, space.long(), visible)
    return visible
