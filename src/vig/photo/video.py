"""Videos taken apart into frames, PNG files in a folder."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from vig.errors import UserError
from vig.files import atomic_write
from vig.photo.images import existing_file, write_png

ENDINGS = {".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".ogv", ".ts", ".webm", ".wmv"}
"""Of files that are taken for videos."""
WHOLE = "frames.json"
"""Written when all frames are: from what file, and how many."""


def is_video(path: Path) -> bool:
    """Whether a file is a video by its name."""
    return path.suffix.lower() in ENDINGS


def frames_of(video: Path, folder: Path) -> list[Path]:
    """Write the frames of a video into a folder, one at a time, and return them in order.

    They are named after the folder, `folder-000000.png` on, and turned as the video says. Frames of the same
    file that are there are not written again.

    Raises:
        UserError: PyAV is not installed, the file is missing, no video, damaged, or without a frame, or the
            folder holds other things than frames.
    """
    stat = existing_file(video).stat()
    source = {"video": str(video.resolve()), "bytes": stat.st_size, "modified": stat.st_mtime_ns}
    try:
        told = json.loads((folder / WHOLE).read_text())
        paths = [folder / _name(folder, number) for number in range(told["frames"])]
        if told["source"] == source and all(path.exists() for path in paths):
            return paths
    except (OSError, ValueError, KeyError, TypeError):
        pass
    _check_own(folder)
    paths = []
    for picture in _decoded(video, paths, folder):
        if not paths:  # of another video of that name
            for path in folder.iterdir() if folder.is_dir() else ():
                path.unlink()
        paths.append(folder / _name(folder, len(paths)))
        write_png(paths[-1], picture)
    with atomic_write(folder / WHOLE) as temporary:
        temporary.write_text(json.dumps({"source": source, "frames": len(paths)}) + "\n")
    return paths


def _check_own(folder: Path) -> None:
    """UserError where a folder holds what is no frame: it is the user's."""
    frame = re.compile(re.escape(folder.name) + r"-\d{6}\.png")
    for path in folder.iterdir() if folder.is_dir() else ():
        if path.name != WHOLE and not frame.fullmatch(path.name):
            raise UserError(
                f"expected '{folder}' to hold frames alone; got '{path.name}' in it. Choose another --out."
            )


def _decoded(video: Path, done: list[Path], folder: Path) -> Any:
    """The pictures (H, W, 3) uint8 of a video; `done` are those written so far, for the words of an error."""
    try:
        import av
    except ImportError:
        raise UserError(
            f"expected the package av, to read '{video}'; it is not installed. Run pip install 'vig[video]'."
        ) from None
    try:
        with av.open(str(video)) as file:
            if not file.streams.video:
                raise UserError(
                    f"expected a video; got '{video}', in which there are no pictures. Name another."
                )
            for packet in file.demux(file.streams.video[0]):
                if packet.is_corrupt:
                    raise av.error.InvalidDataError(0, "a damaged packet")
                for frame in packet.decode():
                    picture = frame.to_ndarray(format="rgb24")
                    yield np.ascontiguousarray(np.rot90(picture, round(frame.rotation / 90)))
    except UserError:
        raise
    except (av.error.FFmpegError, ValueError) as error:
        if not done:
            raise UserError(
                f"expected a video; got '{video}', which cannot be read. Save or copy it again."
            ) from error
        raise UserError(
            f"expected a whole video; got '{video}', damaged after {len(done)} frames. Copy it again, or name"
            f" '{folder}', which has these."
        ) from error
    if not done:
        raise UserError(f"expected a video; got '{video}', which has no frames. Name another.")


def _name(folder: Path, number: int) -> str:
    return f"{folder.name}-{number:06d}.png"
