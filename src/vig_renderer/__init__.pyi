from vig_renderer.rendering import jacobian as jacobian
from vig_renderer.rendering import render as render
from vig_renderer.scene import DirectionalLight as DirectionalLight
from vig_renderer.scene import MeshObject as MeshObject
from vig_renderer.scene import Pinhole as Pinhole
from vig_renderer.scene import Rendering as Rendering
from vig_renderer.scene import Scene as Scene
from vig_renderer.texture import Pyramid as Pyramid
from vig_renderer.texture import pyramid as pyramid
from vig_renderer.topology import Topology as Topology

NEAR: float
