"""One known object: its textured mesh, and its pose in a photo, in any rotation."""

from vig.known_object.fit import KnownObject, Place
from vig.known_object.follow import PoseFollower
from vig.known_object.surface import FILE, Surface

__all__ = ["FILE", "KnownObject", "Place", "PoseFollower", "Surface"]
