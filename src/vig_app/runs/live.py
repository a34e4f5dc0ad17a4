"""A run over the frames of a camera or stream, tracked as they come."""

from __future__ import annotations

import csv
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig.video import TrackedPose, Tracker
from vig_app.results import POSE, TRACK
from vig_app.runs.ledger import ledger_of

CAMERAS = {
    "linux": ("v4l2", "/dev/video{}"),
    "darwin": ("avfoundation", "{}"),
    "win32": ("dshow", "video={}"),
}
"""Of each system: ffmpeg's input format, and what it calls a camera."""
LIVE_COLUMNS = (
    "frame", "seconds", "lost", "hidden_fraction", "azimuth_deg", "azimuth_deviation_deg", "elevation_deg",
    "elevation_deviation_deg", "focal_px", "center_x", "center_y", *POSE,
    *(f"{number}_deviation" for number in ("x", "y", "z", "turn_x", "turn_y", "turn_z")), "step_seconds",
)  # fmt: skip
"""Of track.csv; deviations of the place in metres, of turns in radians."""
OVERLAY, CURVES = "overlay.mp4", "track.png"
CODECS = ("libx264", "mpeg4")
CLOCK = Fraction(1, 1000)
"""Unit of the overlay video's times, seconds."""
AXIS = 0.6
"""Length of a drawn axis, of the object's longest side."""
AXIS_COLOURS = ((230, 60, 50), (70, 190, 70), (70, 110, 240))
LINE_EVERY = 1.0
"""Seconds between printed lines."""
CURVE_SIZE = 1000, 280
"""Pixels of the picture of one curve."""


class LatestFrame:
    """The newest frame of a source that is read on a thread of its own; older ones are dropped.

    A file is played at its own speed, as a camera would show it.
    """

    def __init__(self, source: str):
        """Open a camera by its number, an address, a file, or "-" for standard input.

        Raises:
            UserError: PyAV is not installed, or the source cannot be opened or has no pictures.
        """
        try:
            import av
        except ImportError:
            raise UserError(
                "expected the package av for --live; it is not installed. Run pip install 'vig[video]'."
            ) from None
        kind, name = None, source
        if source.isdecimal():
            kind, pattern = CAMERAS.get(sys.platform, CAMERAS["linux"])
            name = pattern.format(source)
        self._paced = not source.isdecimal() and Path(source).is_file()
        try:
            self._container: Any = av.open("pipe:0" if source == "-" else name, format=kind)
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            raise UserError(
                f"expected a camera, address, file or pipe with --live; got '{source}', which cannot be"
                f" opened ({why}). Check its name, and that nothing else uses it."
            ) from None
        if not self._container.streams.video:
            raise UserError(f"expected a stream of pictures; got '{source}', which has none. Name another.")
        self._errors = av.error.FFmpegError
        self._news, self._ended = threading.Condition(), False
        self._frame: Any = None
        threading.Thread(target=self._read, daemon=True).start()

    def __iter__(self) -> Iterator[np.ndarray]:
        """Pictures (H, W, 3) uint8 sRGB, each the newest when it is asked for, until the source ends."""
        while True:
            with self._news:
                while self._frame is None and not self._ended:
                    self._news.wait(0.1)  # so that Ctrl-C is seen
                frame, self._frame = self._frame, None
            if frame is None:
                return
            yield frame.to_ndarray(format="rgb24")

    def close(self) -> None:
        """Stop reading."""
        self._ended = True

    def _read(self) -> None:
        began = time.monotonic()
        with suppress(self._errors, OSError):  # a camera that is unplugged ends as a file does
            for frame in self._container.decode(video=0):
                if self._paced and frame.time is not None:
                    time.sleep(max(0.0, frame.time - (time.monotonic() - began)))
                with self._news:
                    self._frame = frame
                    self._news.notify()
                if self._ended:
                    break
        with self._news:
            self._ended = True
            self._news.notify()


class OverlayVideo:
    """A video of frames with the object's outline and axes, written as it goes."""

    def __init__(self, path: Path):
        import av

        self._av, self._last = av, -1
        self._stream: Any = None
        self._container: Any = av.open(str(path), "w")

    def add(self, picture: np.ndarray, seconds: float) -> None:
        """Add a picture (H, W, 3) uint8 at its time."""
        height, width = (side // 2 * 2 for side in picture.shape[:2])
        if self._stream is None:
            codec = next(name for name in CODECS if name in self._av.codecs_available)
            self._stream = self._container.add_stream(codec, rate=30)
            self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, "yuv420p"
            self._stream.codec_context.time_base = CLOCK
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(picture[:height, :width]), "rgb24")
        self._last = frame.pts = max(self._last + 1, round(seconds / CLOCK))
        frame.time_base = CLOCK
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        """Write what is left."""
        if self._stream is not None:
            self._container.mux(self._stream.encode())
        self._container.close()


def run_live(
    source: str,
    tracker: Tracker,
    out: Path,
    box: tuple[float, float, float, float] | None = None,
    say: Callable[[str], None] = print,
) -> list[TrackedPose]:
    """Track the object before a camera, into track.csv, track.png and a video, until its stream ends.

    Ctrl-C ends it, too.

    Args:
        source: As `LatestFrame` takes it.
        tracker: Not started.
        out: Folder of the files; made where it is missing.
        box: Round the object in the first frame; else it is sought, frame after frame.
        say: Is called with a line about a frame, once a second.

    Raises:
        UserError: The source cannot be opened, `out` cannot be written, or as `Tracker.start`.
    """
    frames = LatestFrame(source)
    poses: list[TrackedPose] = []
    with ExitStack() as stack:
        stack.callback(frames.close)
        stack.enter_context(ledger_of(out))
        file = stack.enter_context(open(out / f"{TRACK}.csv", "w", newline="", encoding="utf-8"))
        video = OverlayVideo(out / OVERLAY)
        stack.callback(video.close)
        table = csv.DictWriter(file, LIVE_COLUMNS)
        table.writeheader()
        began, said = time.monotonic(), -math.inf
        stack.enter_context(suppress(KeyboardInterrupt))
        for picture in frames:
            seconds = time.monotonic() - began
            pose = tracker.start(picture, box=box) if box is not None and not poses else tracker(picture)
            if pose is not None:
                poses.append(pose)
                table.writerow(_row(pose, seconds))
                file.flush()
                picture = drawn(picture, pose, tracker)
            video.add(picture, seconds)
            if seconds - said >= LINE_EVERY:
                say(_line(pose))
                said = seconds
    if poses:
        with atomic_write(out / CURVES) as temporary:
            curves(poses).save(temporary, "PNG")
    return poses


def drawn(picture: np.ndarray, pose: TrackedPose, tracker: Tracker) -> np.ndarray:
    """A frame (H, W, 3) uint8 with the object's outline, and its axes: x red, y green, z blue."""
    shown = picture if pose.lost else pose.explanation.overlay()
    image = Image.fromarray(shown)
    length = AXIS * float(np.ptp(tracker.explainer.object_class.shape_model.mean, axis=0).max())
    points = np.concatenate([np.zeros((1, 3)), length * np.eye(3)])
    matrix = pose.camera_from_object
    seen = (points @ matrix[:3, :3].T + matrix[:3, 3]) @ pose.camera.K.T
    if (seen[:, 2] > 0).all():
        origin, *ends = map(tuple, (seen[:, :2] / seen[:, 2:]).tolist())
        draw, width = ImageDraw.Draw(image), max(1, min(image.size) // 160)
        for end, colour in zip(ends, AXIS_COLOURS, strict=True):
            draw.line([origin, end], tuple(c // 3 for c in colour) if pose.lost else colour, width)
    return np.asarray(image)


def curves(poses: list[TrackedPose]) -> Image.Image:
    """Azimuth and elevation over the frames, each with a band of a standard deviation; lost frames grey."""
    (width, height), margin = CURVE_SIZE, 40
    image = Image.new("RGB", (width, 2 * height), "white")
    draw = ImageDraw.Draw(image)
    numbers = np.array([pose.number for pose in poses], float)
    across = margin + (width - 2 * margin) * (numbers - numbers[0]) / max(1.0, np.ptp(numbers))
    for row, name in enumerate(("azimuth", "elevation")):
        values, deviations = (
            np.array([getattr(pose, f"{name}{kind}_deg") for pose in poses]) for kind in ("", "_deviation")
        )
        values = np.unwrap(values, period=360)
        low, high = float((values - deviations).min()), float((values + deviations).max())
        top = row * height + margin // 2

        def down(value: Any, low: float = low, high: float = high, top: int = top) -> Any:
            return top + (height - margin) * (high - value) / max(high - low, 1e-6)

        upper, lower = down(values + deviations), down(values - deviations)
        band = [*zip(across, upper, strict=True), *zip(across[::-1], lower[::-1], strict=True)]
        draw.polygon(band, fill=(205, 220, 245))
        here = down(values)
        for start in range(len(poses) - 1):
            colour = (150, 150, 150) if poses[start + 1].lost else (30, 70, 170)
            draw.line([across[start], here[start], across[start + 1], here[start + 1]], colour, 2)
        draw.text((margin, top), f"{name}, degrees: {low:.0f} to {high:.0f}", (0, 0, 0))
        draw.line([margin, top + height - margin, width - margin, top + height - margin], (0, 0, 0))
    draw.text((width - 3 * margin, 2 * height - margin // 2), f"frame {poses[-1].number}", (0, 0, 0))
    return image


def _row(pose: TrackedPose, seconds: float) -> dict[str, Any]:
    deviations = np.sqrt(np.diag(pose.covariance)).tolist()
    values = [*pose.camera_from_object[:3].ravel().tolist(), *deviations]
    return {
        **{name: value for name, value in vars(pose).items() if name in LIVE_COLUMNS},
        "frame": pose.number,
        "seconds": round(seconds, 3),
        "focal_px": pose.camera.focal,
        "center_x": pose.camera.cx,
        "center_y": pose.camera.cy,
        **dict(zip((*POSE, *LIVE_COLUMNS[-7:-1]), values, strict=True)),
        "step_seconds": round(pose.seconds, 4),
    }


def _line(pose: TrackedPose | None) -> str:
    if pose is None:
        return "the object was not found yet"
    hidden = "" if pose.hidden_fraction is None else f", {pose.hidden_fraction:.0%} hidden"
    return (
        f"frame {pose.number}: azimuth {pose.azimuth_deg:.1f}, elevation {pose.elevation_deg:.1f} degrees"
        f"{hidden}, {1000 * pose.seconds:.0f} ms{', lost' if pose.lost else ''}"
    )
