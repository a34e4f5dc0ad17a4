"""Photos: files in and out, and the window round an object."""

from vig.photo.images import read_photo, write_png
from vig.photo.window import Window

__all__ = [
    "Window",
    "read_photo",
    "write_png",
]
