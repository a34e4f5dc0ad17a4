"""Photos: files in and out, and the window round an object."""

from vig.photo.images import as_photo, read_photo, write_png
from vig.photo.lens import Intrinsics, focal_of
from vig.photo.outline import outline_distance
from vig.photo.window import ImagePyramid, Window

__all__ = [
    "ImagePyramid",
    "Intrinsics",
    "Window",
    "as_photo",
    "focal_of",
    "outline_distance",
    "read_photo",
    "write_png",
]
