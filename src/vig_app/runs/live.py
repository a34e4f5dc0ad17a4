"""A run over the frames of a camera or stream, tracked as they come."""

import csv
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from signal import SIGINT
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig.photo.pinhole import project
from vig.photo.video import Video, av_errors
from vig.video import TrackedPose, Tracker
from vig_app.pictures import overlay
from vig_app.results import POSE, TRACK
from vig_app.runs.ledger import ledger_of
from vig_app.runs.tracked import row_of_pose

CAMERAS = {
    "linux": ("v4l2", "/dev/video{}"),
    "darwin": ("avfoundation", "{}"),
    "win32": ("dshow", "video={}"),
}
"""For each system: ffmpeg's input format, and its name of a camera."""
LIVE_COLUMNS = (
    "frame", "seconds", "lost", "hidden_fraction", "azimuth_deg", "azimuth_deviation_deg", "elevation_deg",
    "elevation_deviation_deg", "focal_px", "center_x", "center_y", *POSE,
    *(f"{number}_deviation" for number in ("x", "y", "z", "turn_x", "turn_y", "turn_z")), "step_seconds",
)  # fmt: skip
"""Columns of track.csv; deviations of the place in metres, of turns in radians."""
OVERLAY, CURVES = "overlay.mp4", "track.png"
CODECS = {"libx264": {"tune": "zerolatency"}, "mpeg4": {}}
"""Codecs of the overlay video with options that keep no frame back; the first that exists is taken."""
CONTAINER = {"movflags": "hybrid_fragmented+frag_every_frame", "flush_packets": "1"}
"""Options of the overlay video's file: it plays even after a kill."""
TIMEOUT = 10.0  # seconds without a frame after which a source is given up
CLOCK = Fraction(1, 1000)  # unit of the overlay video's times, seconds


class LatestFrame:
    """The newest picture of a source that is read on a thread of its own; older ones are dropped.

    A file is played at its own speed from its first frame on, as a camera would show it.

    Attributes:
        problem: Why the source was given up before its end; None where it was not.
    """

    def __init__(self, source: str, timeout: float = TIMEOUT):
        """Open a camera by its number, an address, a file, or "-" for standard input; wait for a frame.

        Args:
            source: A camera, an address, a file or "-".
            timeout: Seconds without a frame after which it is given up.

        Raises:
            UserError: PyAV is not installed, or the source cannot be opened, has no pictures, or is silent.
        """
        self._source, self._timeout = source, timeout
        self._news, self._ended = threading.Condition(), False
        self._frame: Any = None
        self.problem: str | None = None
        self._thread = threading.Thread(target=self._read, daemon=True)  # it may block where nothing ends it
        self._thread.start()
        self._wait()
        if self._frame is None:
            raise UserError(self.problem or f"expected a video; got '{source}', which has no frames.")

    def __iter__(self) -> Iterator[np.ndarray]:
        """Yield pictures (H, W, 3) uint8 sRGB, each the newest when asked for, until the source ends."""
        while True:
            self._wait()
            with self._news:
                frame, self._frame = self._frame, None
            if frame is None:
                return
            yield self._video.picture(frame)

    def close(self) -> None:
        """Stop reading."""
        self._ended = True
        self._thread.join(1.0)

    def _wait(self) -> None:
        """Wait for a picture or the end; a source that is silent has ended."""
        until = time.monotonic() + self._timeout
        with self._news:
            while self._frame is None and not self._ended:
                if time.monotonic() > until:
                    self._ended = True
                    self.problem = (
                        f"expected frames; got none from '{self._source}' for {self._timeout:g} s. Check that"
                        " it sends, or give a longer --timeout."
                    )
                self._news.wait(0.1)  # so that Ctrl-C is seen

    def _read(self) -> None:
        problem = None
        try:
            self._video = self._open_video()
            for frame in self._play(self._video):
                with self._news:
                    if self._ended:
                        return
                    self._frame = frame
                    self._news.notify()
        except UserError as error:
            problem = str(error)
        except av_errors() as error:
            problem = f"expected frames to the end of '{self._source}'; got an error ({_reason(error)})."
        with self._news:
            self.problem = self.problem or problem
            self._ended = True
            self._news.notify()

    def _open_video(self) -> Video:
        kind, name = None, "pipe:0" if self._source == "-" else self._source
        if self._source.isdecimal():
            kind, pattern = CAMERAS.get(sys.platform, CAMERAS["linux"])
            name = pattern.format(self._source)
        try:
            return Video(name, kind, 2 * self._timeout)
        except UserError:
            raise
        except av_errors() as error:
            raise UserError(
                f"expected a camera, address, file or pipe with --live; got '{self._source}', which cannot be"
                f" opened ({_reason(error)}). Check its name, and that nothing else uses it."
            ) from None

    def _play(self, video: Video) -> Iterator[Any]:
        """Yield frames, those of a file at its own speed; a clock may begin anywhere, jump, or be missing."""
        paced = not self._source.isdecimal() and Path(self._source).is_file()
        usual, longest = float(1 / (video.stream.average_rate or 25)), self._timeout / 2
        due, before = time.monotonic(), None  # times of the frame before, on this machine's clock and its own
        for packet in video.file.demux(video.stream):
            try:
                frames = packet.decode()
            except ValueError:  # such as before the first whole picture of a stream that is joined
                continue
            for frame in frames:
                if paced and before is not None:
                    step = frame.time - before if frame.time is not None else usual
                    due += step if 0 <= step <= longest else usual
                    time.sleep(max(0.0, due - time.monotonic()))
                before = frame.time if frame.time is not None else (before or 0.0) + usual
                yield frame


class OverlayVideo:
    """A video of frames with the object's outline and axes, written so that it plays at any time."""

    def __init__(self, path: Path):
        self._path, self._last = path, -1
        self._container: Any = None

    def add(self, picture: np.ndarray, seconds: float) -> None:
        """Add a picture (H, W, 3) uint8 at its time."""
        import av

        height, width = (side // 2 * 2 for side in picture.shape[:2])
        if self._container is None:
            codec = next(name for name in CODECS if name in av.codecs_available)
            self._container = av.open(str(self._path), "w", options=CONTAINER)
            self._stream: Any = self._container.add_stream(codec, rate=30, options=CODECS[codec])
            self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, "yuv420p"
            self._stream.codec_context.time_base = CLOCK
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture[:height, :width]), "rgb24")
        self._last = frame.pts = max(self._last + 1, round(seconds / CLOCK))
        frame.time_base = CLOCK
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        """Write the rest."""
        if self._container is not None:
            self._container.mux(self._stream.encode())
            self._container.close()


@dataclass(frozen=True)
class LiveRun:
    """A run over a camera or stream that ended.

    Attributes:
        poses: Poses of the frames from the first in which the object was found.
        problem: Why it ended before the stream's end, in a line; None if it did not.
        signal: Number of the signal that ended it; None if none did.
    """

    poses: list[TrackedPose]
    problem: str | None = None
    signal: int | None = None


def run_live(
    source: str,
    tracker: Tracker,
    out: Path,
    box: tuple[float, float, float, float] | None = None,
    say: Callable[[str], None] = print,
    timeout: float = TIMEOUT,
) -> LiveRun:
    """Track the object before a camera, into track.csv, track.png and a video, until its stream ends.

    KeyboardInterrupt ends it, too: Ctrl-C, or a handler that raises it with its signal's number.

    Args:
        source: A source as `LatestFrame` takes it.
        tracker: Tracker that was not started.
        out: Folder of the files; made where it is missing.
        box: Box of the object in the first frame; else it is sought, frame after frame.
        say: Called with a line about a frame, once a second.
        timeout: Seconds without a frame after which the source is given up.

    Raises:
        UserError: The source cannot be opened or sends no frame, `out` cannot be written, or, in the first
            frame, see `Tracker.start`.
    """
    poses: list[TrackedPose] = []
    problem = stopped_by = None
    frames = LatestFrame(source, timeout)
    with ExitStack() as stack:
        stack.callback(frames.close)
        stack.enter_context(ledger_of(out))
        file = stack.enter_context(open(out / f"{TRACK}.csv", "w", newline="", encoding="utf-8"))
        video = OverlayVideo(out / OVERLAY)
        stack.callback(video.close)
        table = csv.DictWriter(file, LIVE_COLUMNS)
        table.writeheader()
        began, said = time.monotonic(), -math.inf
        try:
            for picture in frames:
                seconds = time.monotonic() - began
                pose = tracker.start(picture, box=box) if box is not None and not poses else tracker(picture)
                if pose is not None:
                    poses.append(pose)
                    deviations = np.sqrt(np.diag(pose.covariance)).tolist()
                    row = dict(zip(LIVE_COLUMNS[-7:-1], deviations, strict=True))
                    row |= {"seconds": round(seconds, 3), "step_seconds": round(pose.seconds, 4)}
                    table.writerow(row_of_pose(pose, LIVE_COLUMNS) | row)
                    file.flush()
                    picture = draw_pose(picture, pose, tracker)
                video.add(picture, seconds)
                # 1.0: seconds between printed lines
                if seconds - said >= 1.0:
                    say(_line(pose))
                    said = seconds
            problem = frames.problem
        except KeyboardInterrupt as stop:
            stopped_by = stop.args[0] if stop.args else SIGINT
        except UserError as error:  # such as a frame of another size
            if not poses:
                for name in (f"{TRACK}.csv", OVERLAY):
                    (out / name).unlink(missing_ok=True)
                raise
            problem = str(error)
    if poses:
        with atomic_write(out / CURVES) as temporary:
            curves(poses).save(temporary, "PNG")
    return LiveRun(poses, problem, stopped_by)


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)


def draw_pose(picture: np.ndarray, pose: TrackedPose, tracker: Tracker) -> np.ndarray:
    """Return a frame (H, W, 3) uint8 with the object's outline, and its axes: x red, y green, z blue."""
    shown = picture if pose.lost else overlay(pose.explanation)
    image = Image.fromarray(shown)
    length = 0.6 * float(np.ptp(tracker.explainer.object_class.shape_model.mean, axis=0).max())
    points = np.concatenate([np.zeros((1, 3)), length * np.eye(3)])
    matrix = pose.camera_from_object
    seen = project(pose.camera.K, matrix, points)
    if (seen[:, 2] > 0).all():
        origin, *ends = map(tuple, seen[:, :2].tolist())
        draw, width = ImageDraw.Draw(image), max(1, min(image.size) // 160)
        for end, colour in zip(ends, ((230, 60, 50), (70, 190, 70), (70, 110, 240)), strict=True):
            draw.line([origin, end], tuple(c // 3 for c in colour) if pose.lost else colour, width)
    return np.asarray(image)


def curves(poses: list[TrackedPose]) -> Image.Image:
    """Return azimuth and elevation over frames, each in a band of a standard deviation; lost frames grey."""
    # (1000, 280): pixels of the picture of one curve
    (width, height), margin = (1000, 280), 40
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


def _line(pose: TrackedPose | None) -> str:
    if pose is None:
        return "the object was not found yet"
    hidden = "" if pose.hidden_fraction is None else f", {pose.hidden_fraction:.0%} hidden"
    return (
        f"frame {pose.number}: azimuth {pose.azimuth_deg:.1f}, elevation {pose.elevation_deg:.1f} degrees"
        f"{hidden}, {1000 * pose.seconds:.0f} ms{', lost' if pose.lost else ''}"
    )
