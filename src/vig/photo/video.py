"""Videos taken apart into frames, PNG files in a folder."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from vig.io.errors import UserError
from vig.io.files import write_json
from vig.io.printing import note
from vig.photo.checks import existing_file
from vig.photo.colour import Encoding, coded_encoding
from vig.photo.images import as_srgb, coded_photo, write_png

ENDINGS = frozenset(".3gp .avi .flv .m2ts .m4v .mkv .mov .mp4 .mpeg .mpg .mts .ogv .ts .webm .wmv".split())
"""Endings of files that are taken for videos."""
PICTURE_CODECS = frozenset("bmp gif jpeg2000 mjpeg png tiff webp".split())
"""Codecs of covers that are not marked as such, in a film of another codec."""
FORMAT = 2  # version of frames: others, of an earlier vig, are written anew
WHOLE = "frames.json"  # written after all frames: their file, and their number


def is_video(path: Path) -> bool:
    """Return whether a file is a video by its name."""
    return path.suffix.lower() in ENDINGS


def frames_of(video: Path, folder: Path) -> list[Path]:
    """Write the frames of a video into a folder, one at a time, and return them in order.

    They are named after the folder, `folder-000000.png` on, turned and mirrored as the video states, oblong
    pixels made square, HDR and wide colours made sRGB. Existing frames of the file stay.

    Raises:
        UserError: PyAV is not installed, the file is missing, no video, damaged, or without a frame, or the
            folder holds other things than frames.
    """
    stat = existing_file(video).stat()
    source = {"video": str(video.resolve()), "bytes": stat.st_size, "modified": stat.st_mtime_ns}
    source["format"] = FORMAT
    try:
        record = json.loads((folder / WHOLE).read_text())
        paths = [folder / _name(folder, number) for number in range(record["frames"])]
        if record["source"] == source and all(path.exists() for path in paths):
            return paths
    except (OSError, ValueError, KeyError, TypeError):
        pass
    frame, there = re.compile(re.escape(folder.name) + r"-\d{6}\.png"), []
    for path in folder.iterdir() if folder.is_dir() else ():
        if path.name != WHOLE and not frame.fullmatch(path.name):  # it is the user's
            raise UserError(
                f"expected '{folder}' to hold frames alone; got '{path.name}' in it. Choose another --out."
            )
        there.append(path)
    paths = []
    for picture in _decode_pictures(video, paths, folder):
        if not paths:  # from another video of that name
            for path in there:
                path.unlink()
        paths.append(folder / _name(folder, len(paths)))
        write_png(paths[-1], picture)
    write_json(folder / WHOLE, {"source": source, "frames": len(paths)}, None)
    return paths


class Video:
    """An open file, camera or address: its stream of pictures, and these as they are meant to be seen.

    Attributes:
        file: PyAV's container.
        stream: Stream of the pictures, no cover.
    """

    def __init__(self, source: str, kind: str | None = None, timeout: float | None = None):
        """Open a source of ffmpeg's; `kind`: its format; `timeout`: seconds for it to answer.

        Raises:
            UserError: PyAV is not installed, or the source has no pictures but a cover.
            av_errors(): It cannot be opened.
        """
        try:
            import av
        except ImportError:
            raise UserError(
                f"expected the package av, to read '{source}'; it is not installed. Run pip install"
                " 'vig[video]'."
            ) from None
        self.file: Any = av.open(source, format=kind, timeout=timeout)
        cover = av.stream.Disposition.attached_pic
        streams = [stream for stream in self.file.streams.video if not stream.disposition & cover]
        films = [stream for stream in streams if stream.codec_context.name not in PICTURE_CODECS] or streams
        best = self.file.streams.best("video")
        if not streams:
            raise UserError(
                f"expected a video; got '{source}', in which there are no pictures. Name another."
            )
        self.stream: Any = best if best in films else films[0]
        self._name = source
        self._peak: float | None = None

    def picture(self, frame: Any) -> np.ndarray:
        """Return a frame (H, W, 3) as uint8 sRGB: upright, pixels square, transparent ones laid over grey.

        Raises:
            UserError: Its colour encoding is unknown.
        """
        encoding = _encoding(self._name, self.stream.codec_context, frame)
        if encoding:
            light, self._peak = encoding.light_and_peak(frame.to_ndarray(format="rgb48le"), 65535, self._peak)
            picture = as_srgb(light)
        elif any(component.is_alpha for component in frame.format.components):
            picture = as_srgb(coded_photo(Image.fromarray(frame.to_ndarray(format="rgba"))))
        else:
            picture = frame.to_ndarray(format="rgb24")
        height, width = picture.shape[:2]
        square = max(
            1, round(width * (self.stream.sample_aspect_ratio or 1))
        )  # pixels of a row of square ones
        if square != width:
            picture = np.asarray(Image.fromarray(picture).resize((square, height), Image.Resampling.BICUBIC))
        return np.ascontiguousarray(_apply_display_matrix(picture, frame.side_data.get("DISPLAYMATRIX")))


def av_errors() -> tuple[type[Exception], ...]:
    """Return the exceptions that PyAV raises where a source cannot be read."""
    try:
        from av.error import FFmpegError
    except ImportError:
        return ()
    return FFmpegError, OSError, ValueError


def _decode_pictures(path: Path, done: list[Path], folder: Path) -> Iterator[np.ndarray]:
    """Yield the pictures (H, W, 3) uint8 of a video; `done`: those written so far, for an error."""
    try:
        video = Video(str(path))
        seconds = 0.0
        with video.file:
            for packet in video.file.demux(video.stream):
                if packet.is_corrupt:
                    raise ValueError("a damaged packet")
                for frame in packet.decode():
                    seconds = frame.time or seconds
                    yield video.picture(frame)
            # What Matroska and WebM state, which ffmpeg reads to any end.
            length = re.fullmatch(r"(\d+):(\d+):(\d+\.?\d*)", video.stream.metadata.get("DURATION", ""))
            hours, minutes, rest = map(float, length.groups()) if length else (0.0, 0.0, 0.0)
            stated = 3600 * hours + 60 * minutes + rest
        if done and seconds < 0.9 * stated - 1:
            note(f"'{path}' ends after {seconds:.1f} s of the {stated:.1f} s that it states; is it whole?")
    except UserError:
        raise
    except av_errors() as error:
        if not done:
            raise UserError(
                f"expected a video; got '{path}', which cannot be read. Save or copy it again."
            ) from error
        raise UserError(
            f"expected a whole video; got '{path}', damaged after {len(done)} frames. Copy it again, or name"
            f" '{folder}', which has these."
        ) from error
    if not done:
        raise UserError(f"expected a video; got '{path}', which has no frames. Name another.")


def _encoding(video: str | Path, codec: Any, frame: Any) -> Encoding | None:
    """Return the samples' encoding where a video is HDR or has other primaries than sRGB's like, or None."""
    primaries, transfer, matrix = int(codec.color_primaries), int(codec.color_trc), int(frame.colorspace)
    try:
        # Of H.273 (YCgCo, constant luminance, ICtCp): ffmpeg mistakes them for others without an error.
        if matrix in (8, 10, 12, 13, 14):
            raise ValueError(f"matrix {matrix} of H.273")
        if transfer in (0, 2) and frame.side_data.get("DOVI_RPU_BUFFER"):
            raise ValueError("Dolby Vision's own colours alone")
        # Reserved or not stated; and the curves of analogue television, which nobody shows them by.
        return coded_encoding(
            2 if primaries in (0, 3) else primaries, 2 if transfer in (0, 3, 4, 5) else transfer
        )
    except ValueError as error:
        raise UserError(
            f"expected a known colour encoding; got '{video}' with {error}. Convert it to BT.709."
        ) from error


def _apply_display_matrix(picture: np.ndarray, matrix: Any) -> np.ndarray:
    """Turn and mirror a picture by a display matrix: (x, y) goes to (a x + c y, b x + d y), in 16.16."""
    if matrix is None:
        return picture
    a, b, _, c, d = np.frombuffer(bytes(matrix), np.int32)[:5]
    if abs(b) > abs(a):
        picture, a, d = picture.transpose(1, 0, 2), c, b
    return picture[:: -1 if d < 0 else 1, :: -1 if a < 0 else 1]


def _name(folder: Path, number: int) -> str:
    return f"{folder.name}-{number:06d}.png"
