"""One known object: its textured mesh, and its pose in a photo, in any rotation."""

from vig.known.known_object import KnownObject, Place
from vig.known.surface import FILE, Surface

__all__ = ["FILE", "KnownObject", "Place", "Surface"]
