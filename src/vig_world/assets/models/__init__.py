"""The packaged catalogue of props and furniture: `models.npz`, with authors and licences in `models.csv`."""

from vig_world.assets.models.catalogue import packaged_furniture as packaged_furniture
from vig_world.assets.models.catalogue import packaged_props as packaged_props
from vig_world.assets.models.catalogue import rows as rows
from vig_world.assets.models.variation import vary as vary
from vig_world.assets.models.variation import vary_furniture as vary_furniture
