"""One object through the frames of a video: followed, its views chosen together, smoothed."""

from vig.tracking.course import TrackedFrame, track

__all__ = ["TrackedFrame", "track"]
