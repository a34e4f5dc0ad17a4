"""Types of the kernels and where a point's numbers stand in a row of derivatives."""

import functools
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import torch
import warp as wp

from vig.renderer.device import initialise, native_code, scalar_type
from vig.scene import Block, LatentLayout, point_layout
from vig.scene.light import L_COUNT

LANES = 16
"""Numbers in a padded vector, and pixels taken at a time: whole vector registers of a processor."""

REST = LatentLayout(
    (
        Block("azimuth", 1),
        Block("elevation", 1),
        Block("light", L_COUNT),
        Block("irradiance", 1),
        Block("framing", 3),
    )
)
"""Columns of a row behind its shape part: a point's latents but albedo, in whose place stands the irradiance
itself, as a colour is albedo times irradiance."""


@dataclass(frozen=True)
class RowLayout:
    """Columns of a row, for K shape components: shape and rest, each padded to whole registers."""

    modes: int

    @property
    def point(self) -> LatentLayout:
        """Where a point's numbers stand in its vector: latents, then framing."""
        return point_layout(self.modes)

    @property
    def shape(self) -> int:
        """Columns of the shape part."""
        return -(-self.modes // LANES) * LANES

    @property
    def width(self) -> int:
        """Columns in all."""
        return self.shape + LANES

    def columns(self) -> list[int]:
        """The column of each of a point's numbers; the three of albedo share the irradiance's."""
        columns: list[int] = []
        for block in self.point.blocks:
            if block.name == "shape":
                columns += range(block.size)
            elif block.name == "albedo":
                columns += [self.shape + REST.at("irradiance")] * block.size
            else:
                columns += (self.shape + place for place in REST.indices(block.name))
        return columns


def module_name(part: str, dtype: torch.dtype, modes: int) -> str:
    """The name under which kernels of this scalar type and width are cached."""
    return f"vig_{part}_{str(dtype).removeprefix('torch.')}_{modes}"


def native_file(dtype: torch.dtype, *files: str, **constants: int | float) -> str:
    """The code of .cc files of this folder; see `native_code`."""
    return native_code(Path(__file__).parent, *files, real=scalar_type(dtype), **constants)


@functools.cache
def kernel_types(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """Warp's types for one scalar type and number of shape components."""
    initialise()
    real = scalar_type(dtype)
    rows = RowLayout(modes)
    return SimpleNamespace(
        real=real,
        rows=rows,
        **{f"vec{length}": wp.types.vector(length, real) for length in (2, 3, 4)},
        mat33=wp.types.matrix((3, 3), real),
        shape_row=wp.types.vector(rows.shape, real),
        rest_row=wp.types.vector(LANES, real),
        lobe_vector=wp.types.vector(L_COUNT, real),
    )
