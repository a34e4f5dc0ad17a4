"""Videos taken apart into frames: whole, turned, damaged, no videos."""

from __future__ import annotations

import builtins
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from vig.errors import UserError
from vig.photo.video import WHOLE, frames_of, is_video

av = pytest.importorskip("av")
COUNT = 12


def write_video(path: Path, count: int = COUNT, codec: str = "mjpeg") -> Path:
    """A video of 48 x 64 pixels whose frames become brighter, with a bright left half."""
    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec, rate=24)
        stream.height, stream.width = 48, 64
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        file.start_encoding()
        for number in range(count):
            picture = np.full((48, 64, 3), 10 + 10 * number, np.uint8)
            picture[:, :32] += 60
            file.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        file.mux(stream.encode())
    return path


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture)


@pytest.mark.parametrize(
    ("name", "codec"), [("turn.avi", "mjpeg"), ("turn.mp4", "mpeg4"), ("turn.mkv", "mjpeg")]
)
def test_frames_are_written_in_order_and_named_after_the_video(name: str, codec: str, tmp_path: Path) -> None:
    paths = frames_of(write_video(tmp_path / name, codec=codec), tmp_path / "frames" / "turn")
    assert [path.name for path in paths] == [f"turn-{number:06d}.png" for number in range(COUNT)]
    for number, path in enumerate(paths):
        found = pixels(path)
        assert found.shape == (48, 64, 3)
        assert abs(float(found[:, 40:].mean()) - (10 + 10 * number)) < 8
        assert abs(float(found[:, :24].mean()) - (70 + 10 * number)) < 8


def test_frames_that_are_there_are_not_written_again_unless_the_video_changed(tmp_path: Path) -> None:
    video, folder = write_video(tmp_path / "a.avi"), tmp_path / "frames"
    first = [path.stat().st_mtime_ns for path in frames_of(video, folder)]
    assert [path.stat().st_mtime_ns for path in frames_of(video, folder)] == first
    (folder / WHOLE).unlink()  # as a kill half-way leaves it
    assert [path.stat().st_mtime_ns for path in frames_of(video, folder)] != first
    write_video(video, count=5)
    assert len(frames_of(video, folder)) == 5 == len(list(folder.glob("*.png")))


def test_a_video_is_turned_as_its_header_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A phone held upright: -90 is a quarter turn clockwise, which puts the bright left half on top."""

    class Turned:
        rotation = -90

        def to_ndarray(self, format: str) -> Any:
            picture = np.zeros((48, 64, 3), np.uint8)
            picture[:, :32] = 200
            return picture

    class Packet:
        is_corrupt = False

        def decode(self) -> list[Turned]:
            return [Turned()]

    class File:
        class streams:  # noqa: N801
            video = (0,)

        def demux(self, _: Any) -> list[Packet]:
            return [Packet()]

        def __enter__(self) -> File:
            return self

        def __exit__(self, *_: Any) -> None:
            pass

    monkeypatch.setattr(av, "open", lambda _: File())
    (tmp_path / "a.mp4").write_bytes(b"x")
    found = pixels(frames_of(tmp_path / "a.mp4", tmp_path / "frames")[0])
    assert found.shape == (64, 48, 3) and (found[:32] == 200).all() and (found[32:] == 0).all()


def test_a_damaged_video_keeps_its_frames_and_says_where_they_are(tmp_path: Path) -> None:
    whole = write_video(tmp_path / "whole.avi").read_bytes()
    (tmp_path / "cut.avi").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(
        UserError, match=r"whole video; got .*cut\.avi', damaged after \d frames.*'.*frames'"
    ) as error:
        frames_of(tmp_path / "cut.avi", tmp_path / "frames")
    assert "\n" not in str(error.value)
    assert list((tmp_path / "frames").glob("*.png")) and not (tmp_path / "frames" / WHOLE).exists()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "an empty file"),
        (b"no video at all" * 100, "cannot be read. Save or copy it again"),
        (None, "nothing of that name"),
    ],
)
def test_what_is_no_video_is_refused_in_one_line(data: bytes | None, words: str, tmp_path: Path) -> None:
    if data is not None:
        (tmp_path / "a.mp4").write_bytes(data)
    with pytest.raises(UserError, match=words) as error:
        frames_of(tmp_path / "a.mp4", tmp_path / "frames")
    assert "\n" not in str(error.value)


def test_sound_alone_is_refused(tmp_path: Path) -> None:
    with av.open(str(tmp_path / "sound.mkv"), "w") as file:
        stream = file.add_stream("pcm_s16le", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
        frame.sample_rate = 8000
        file.mux(stream.encode(frame))
    with pytest.raises(UserError, match="in which there are no pictures"):
        frames_of(tmp_path / "sound.mkv", tmp_path / "frames")


def test_a_video_without_frames_is_refused(tmp_path: Path) -> None:
    write_video(tmp_path / "none.avi", count=0)
    with pytest.raises(UserError, match="expected a video; got .*none.avi"):
        frames_of(tmp_path / "none.avi", tmp_path / "frames")


def test_without_pyav_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    video, given = write_video(tmp_path / "a.avi"), builtins.__import__

    def without(name: str, *others: Any, **more: Any) -> Any:
        if name == "av":
            raise ModuleNotFoundError(name)
        return given(name, *others, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UserError, match=r"expected the package av.*pip install 'vig\[video\]'"):
        frames_of(video, tmp_path / "frames")


def test_videos_are_known_by_their_endings() -> None:
    assert is_video(Path("A.MP4")) and is_video(Path("b.mov")) and not is_video(Path("c.gif"))


def test_a_folder_that_is_not_of_frames_is_left_alone(tmp_path: Path) -> None:
    folder = tmp_path / "frames" / "turn"
    folder.mkdir(parents=True)
    (folder / "labels.txt").write_text("mine")
    (folder / "turn-000000.png").write_text("of a video before")
    video = tmp_path / "turn.mp4"
    video.write_text("no video")
    with pytest.raises(UserError, match=r"to hold frames alone; got 'labels\.txt'"):
        frames_of(video, folder)
    (folder / "labels.txt").unlink()
    with pytest.raises(UserError, match="cannot be read"):
        frames_of(video, folder)
    assert (folder / "turn-000000.png").read_text() == "of a video before"
