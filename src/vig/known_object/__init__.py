"""One known object: its textured mesh, and its pose in a photo, in any rotation."""

from vig.known_object.finding import Found as Found
from vig.known_object.finding import WholePhoto as WholePhoto
from vig.known_object.finding import find as find
from vig.known_object.fit import KnownObject as KnownObject
from vig.known_object.fit import assumed_lens as assumed_lens
from vig.known_object.follow import PoseFollower as PoseFollower
from vig.known_object.keypoints import Keypoints as Keypoints
from vig.known_object.picture import Place as Place
from vig.known_object.surface import FILE as FILE
from vig.known_object.surface import Surface as Surface
from vig.known_object.verdict import explained_share as explained_share
