"""The differentiable renderer: rasterisation, shading, coverage, Jacobians."""

from vig.render.device import warp_array
from vig.render.geometry import Geometry
from vig.render.jacobian import jacobian
from vig.render.primitives import Pyramid, Topology, pyramid
from vig.render.raster import NOTHING, Fragments, raster_kernels, rasterize
from vig.render.rendering import render
from vig.render.scene import DirectionalLight, MeshObject, Pinhole, Rendering, Scene
from vig.render.threads import map_on_threads, on_one_core, run_on_threads, thread_count

__all__ = [
    "NOTHING",
    "DirectionalLight",
    "Fragments",
    "Geometry",
    "MeshObject",
    "Pinhole",
    "Pyramid",
    "Rendering",
    "Scene",
    "Topology",
    "jacobian",
    "map_on_threads",
    "on_one_core",
    "pyramid",
    "raster_kernels",
    "rasterize",
    "render",
    "run_on_threads",
    "thread_count",
    "warp_array",
]
