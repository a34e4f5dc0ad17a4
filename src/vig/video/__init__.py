"""One object through the frames of a video: followed, its views chosen together, smoothed."""

from vig.video.trajectory import Track, TrackedFrame, track

__all__ = ["Track", "TrackedFrame", "track"]
