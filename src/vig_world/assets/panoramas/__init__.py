"""Procedural indoor environment maps, and the light that a panorama gives.

A room is drawn as boxes, flat things on its walls, windows and lamps (`rooms`, `furnishing`); rays from the
eye find what is seen (`tracing`); each point is lit by the sources that it sees and by light from all the
room (`painting`), and has the albedo of what it belongs to (`finishes`)."""

from vig_world.assets.panoramas.light import grey_light, light_parts, local_light
from vig_world.assets.panoramas.painting import panorama
from vig_world.assets.panoramas.tracing import directions

__all__ = [
    "directions",
    "grey_light",
    "light_parts",
    "local_light",
    "panorama",
]
