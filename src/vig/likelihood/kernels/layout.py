"""Sizes and columns that the kernels of one evaluation share, and constants that tests share with them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch

from vig.likelihood import densities
from vig.scene import Block, LatentLayout, point_layout
from vig.search.damped_step import LANES as LANES
from vig_renderer.device import native_code, scalar_type

BEHIND_EDGE = 0.002
"""Metres by which the surface beyond an occlusion edge must lie behind it."""

BEFORE_EDGE = 0.04
"""Metres by which the edge's own surface may come forward within a pixel."""

LEAST_SQUARE = 1e-12
"""Squared length in the image of an edge's normal below which its direction is lost in rounding."""

REST = LatentLayout(
    tuple(
        Block("irradiance", 1) if block.name == "albedo" else block
        for block in point_layout(0).without("shape").blocks
    )
)
"""Columns of a row after its shape part: a point's latents, with the irradiance in place of albedo, as a
colour is albedo times irradiance."""


def padded(count: int) -> int:
    """The least multiple of `LANES` that holds so many numbers."""
    return -(-count // LANES) * LANES


@dataclass(frozen=True)
class RowLayout:
    """Columns of a row, for K shape components: shape and rest, each padded to whole registers."""

    modes: int

    @property
    def point(self) -> LatentLayout:
        """Layout of a point's vector: latents, then framing."""
        return point_layout(self.modes)

    @property
    def shape(self) -> int:
        """Columns of the shape part."""
        return padded(self.modes)

    @property
    def rest(self) -> int:
        """Columns of the rest."""
        return padded(REST.size)

    @property
    def width(self) -> int:
        """Columns in all."""
        return self.shape + self.rest

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


def native_file(dtype: torch.dtype, file: str, **constants: int | float) -> str:
    """The code of a .cc file of the templates; see `native_code`."""
    return native_code(Path(__file__).parent / "templates", file, real=scalar_type(dtype), **constants)


def density_code(name: str) -> str:
    """The two macros of a density; see `vig.likelihood.densities`."""
    return (densities.FOLDER / f"{name}.cc").read_text(encoding="utf-8")
