"""The packaged catalogue of props and furniture: `models.npz`, with authors and licences in `models.csv`."""

from vig_world.assets.models.catalogue import packaged_furniture, packaged_props, rows
from vig_world.assets.models.variation import vary, vary_furniture

__all__ = ["packaged_furniture", "packaged_props", "rows", "vary", "vary_furniture"]
