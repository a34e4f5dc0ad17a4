"""Sweet Home 3D furniture catalogues (`.sh3f`) as folders of meshes: `catalogue.sh3f:chair,table`."""

from vig_world.assets.own.catalogue.sources import Source, Sources, read_sources
from vig_world.assets.own.catalogue.unpack import mesh_folder

__all__ = ["Source", "Sources", "mesh_folder", "read_sources"]
