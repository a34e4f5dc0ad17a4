"""Photos: files in and out, and the window round an object."""

from vig.photo.images import as_photo, focal_of, read_photo, write_png
from vig.photo.outline import outline_distance
from vig.photo.window import Halved, Window

__all__ = ["Halved", "Window", "as_photo", "focal_of", "outline_distance", "read_photo", "write_png"]
