"""Sweet Home 3D furniture catalogues (`.sh3f`) as folders of meshes: `catalogue.sh3f:chair,table`."""

from vig_world.assets.own.catalogue.sources import Source as Source
from vig_world.assets.own.catalogue.sources import Sources as Sources
from vig_world.assets.own.catalogue.sources import read_sources as read_sources
from vig_world.assets.own.catalogue.unpack import mesh_folder as mesh_folder
