"""One object through the frames of a video: followed, its views chosen together, smoothed."""

from vig.video.track import Track as Track
from vig.video.track import TrackedFrame as TrackedFrame
from vig.video.track import track as track
from vig.video.tracker import TrackedPose as TrackedPose
from vig.video.tracker import Tracker as Tracker
