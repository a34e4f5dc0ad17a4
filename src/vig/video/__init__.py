"""One object through the frames of a video: followed, its views chosen together, smoothed."""

from vig.video.track import Track, TrackedFrame, track
from vig.video.tracker import TrackedPose, Tracker

__all__ = ["Track", "TrackedFrame", "TrackedPose", "Tracker", "track"]
