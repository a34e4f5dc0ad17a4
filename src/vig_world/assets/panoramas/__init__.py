"""Procedural indoor environment maps, and the light that a panorama gives.

A room is drawn as boxes, flat things on its walls, windows and lamps (`rooms`, `furnishing`); rays from the
viewpoint find the visible surfaces (`tracing`); each point is lit by visible sources and ambient light
(`painting`), and has the albedo of its surface (`finishes`).
"""

from vig_world.assets.panoramas.light import light_parts, local_light
from vig_world.assets.panoramas.painting import panorama
from vig_world.assets.panoramas.tracing import directions

__all__ = [
    "directions",
    "light_parts",
    "local_light",
    "panorama",
]
