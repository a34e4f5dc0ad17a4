"""The raster tier: scenes as pictures, rasterised and shaded with nine light coefficients."""

from vig.synthesis.raster.draw import depth, draw
from vig.synthesis.raster.items import Item, Target
from vig.synthesis.raster.packed import Packed
from vig.synthesis.raster.pyramid import Pyramid

__all__ = ["Item", "Packed", "Pyramid", "Target", "depth", "draw"]
