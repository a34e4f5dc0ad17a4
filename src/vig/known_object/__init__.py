"""One known object: its textured mesh, and its pose in a photo, in any rotation."""

from vig.known_object.finding import Found, WholePhoto, find
from vig.known_object.fit import KnownObject, assumed_lens
from vig.known_object.follow import PoseFollower
from vig.known_object.keypoints import Keypoints
from vig.known_object.picture import Place
from vig.known_object.surface import FILE, Surface
from vig.known_object.verdict import explained_share

__all__ = [
    "FILE",
    "Found",
    "Keypoints",
    "KnownObject",
    "Place",
    "PoseFollower",
    "Surface",
    "WholePhoto",
    "assumed_lens",
    "explained_share",
    "find",
]
