"""Photos: files in and out, and the window round an object."""

from vig.photo.images import as_photo as as_photo
from vig.photo.images import read_photo as read_photo
from vig.photo.images import write_png as write_png
from vig.photo.lens import Intrinsics as Intrinsics
from vig.photo.lens import focal_of as focal_of
from vig.photo.outline import outline_distance as outline_distance
from vig.photo.window import ImagePyramid as ImagePyramid
from vig.photo.window import Window as Window
