"""One object through the frames of a video: followed, its views chosen together, smoothed."""

from vig.video.tracker import TrackedPose, Tracker
from vig.video.trajectory import Track, TrackedFrame, track

__all__ = ["Track", "TrackedFrame", "TrackedPose", "Tracker", "track"]
