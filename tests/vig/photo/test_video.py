"""Videos taken apart into frames: whole, turned, damaged, no videos."""

import builtins
import json
import re
import struct
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from vig.io.errors import UserError
from vig.photo.images import read_photo
from vig.photo.video import WHOLE, _encoding, frames_of, is_video

av = pytest.importorskip("av")
COUNT = 12


def write_video(path: Path, count: int = COUNT, codec: str = "mjpeg", aspect: Fraction | None = None) -> Path:
    """A video of 48 x 64 pixels whose frames become brighter, with a bright left half."""
    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec, rate=24)
        stream.height, stream.width = 48, 64
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        if aspect:
            stream.codec_context.sample_aspect_ratio = aspect
        file.start_encoding()
        for number in range(count):
            picture = np.full((48, 64, 3), 10 + 10 * number % 180, np.uint8)
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


LUMA = {1: (0.2126, 0.0722), 5: (0.299, 0.114), 6: (0.299, 0.114), 9: (0.2627, 0.0593)}
"""Weights of red and blue in luma, by H.273's code of the matrix."""


def write_flat(path: Path, colour: tuple[float, float, float], matrix: int, **codes: int) -> Path:
    """A lossless video of two equal frames of 48 x 64, 10 bits of limited range, with H.273's codes."""
    red, blue = LUMA[matrix]
    luma = red * colour[0] + (1 - red - blue) * colour[1] + blue * colour[2]
    chroma = (colour[2] - luma) / (2 - 2 * blue), (colour[0] - luma) / (2 - 2 * red)
    samples = [round(4 * (16 + 219 * luma)), *(round(4 * (128 + 224 * value)) for value in chroma)]
    with av.open(str(path), "w") as file:
        stream = file.add_stream("ffv1", rate=24)
        stream.height, stream.width, stream.pix_fmt = 48, 64, "yuv444p10le"
        for name, value in {"colorspace": matrix, "color_range": 1, **codes}.items():
            setattr(stream.codec_context, name, value)
        for number in range(2):
            frame = av.VideoFrame(64, 48, "yuv444p10le")
            frame.pts = number
            for plane, sample in zip(frame.planes, samples, strict=True):
                plane.update(np.full(plane.buffer_size // 2, sample, np.uint16).tobytes())
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    return path


def corners(path: Path) -> list[int]:
    """Red of the corners: top left, top right, bottom left, bottom right."""
    picture = pixels(path).astype(int)
    return [int(picture[row, column, 0]) for row in (4, -4) for column in (4, -4)]


ONE = 65536


@pytest.mark.parametrize(
    ("matrix", "expected"),
    [
        ((ONE, 0, 0, ONE), [40, 80, 160, 240]),
        ((0, ONE, -ONE, 0), [160, 40, 240, 80]),  # a quarter turn clockwise: a phone held upright
        ((0, -ONE, ONE, 0), [80, 240, 40, 160]),
        ((-ONE, 0, 0, -ONE), [240, 160, 80, 40]),
        ((-ONE, 0, 0, ONE), [80, 40, 240, 160]),  # mirrored: a front camera
        ((ONE, 0, 0, -ONE), [160, 240, 40, 80]),
        ((0, ONE, ONE, 0), [40, 160, 80, 240]),
    ],
)
def test_a_video_is_turned_and_mirrored_as_its_header_says(
    matrix: tuple[int, int, int, int], expected: list[int], tmp_path: Path
) -> None:
    """(x, y) goes to (a x + c y, b x + d y), by a, b, c, d of the track's header."""
    picture = np.empty((48, 64, 3), np.uint8)
    picture[:24, :32], picture[:24, 32:], picture[24:, :32], picture[24:, 32:] = 40, 80, 160, 240
    video = tmp_path / "a.mp4"
    with av.open(str(video), "w") as file:
        stream = file.add_stream("mpeg4", rate=24)
        stream.height, stream.width, stream.pix_fmt = 48, 64, "yuv420p"
        file.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        file.mux(stream.encode())
    data = bytearray(video.read_bytes())
    place = data.index(b"tkhd") + 4 + 40  # version 0: version, times, duration, layer ... precede the matrix
    a, b, c, d = matrix
    data[place : place + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)
    video.write_bytes(data)
    found = corners(frames_of(video, tmp_path / "frames")[0])
    assert np.abs(np.array(found) - expected).max() < 12


@pytest.mark.parametrize(
    ("aspect", "width"),
    [(Fraction(32, 27), 76), (Fraction(8, 9), 57), (Fraction(1, 2), 32), (Fraction(1), 64)],
)
@pytest.mark.parametrize("name", ["a.mp4", "a.avi", "a.mkv"])
def test_oblong_pixels_become_square(aspect: Fraction, width: int, name: str, tmp_path: Path) -> None:
    video = write_video(tmp_path / name, codec="mpeg4", aspect=aspect)
    for number, path in enumerate(frames_of(video, tmp_path / "frames")):
        found = pixels(path)
        assert found.shape == (48, width, 3)
        assert (
            np.abs(found[:, : width // 2 - 6].mean() - (70 + 10 * number)) < 8
        )  # the edge stays in the middle
        assert np.abs(found[:, width // 2 + 6 :].mean() - (10 + 10 * number)) < 8


@pytest.mark.parametrize(("matrix", "primaries"), [(1, 1), (5, 5), (6, 6), (9, 1)])
def test_colours_do_not_depend_on_the_matrix(matrix: int, primaries: int, tmp_path: Path) -> None:
    colour = (200 / 255, 60 / 255, 30 / 255)
    video = write_flat(tmp_path / "a.mkv", colour, matrix, color_primaries=primaries, color_trc=1)
    found = pixels(frames_of(video, tmp_path / "frames")[0]).astype(int)
    assert np.abs(found - (200, 60, 30)).max() <= 3


@pytest.mark.parametrize(
    ("transfer", "signal", "light"),
    [
        (16, 0.5096, 0.5),  # PQ of 101.5 cd/m2: half of diffuse white's 203
        (18, 0.75, 1.0),  # HLG's diffuse white
        (18, 0.5, 1000 / 203 * (1 / 12) ** 1.2),
        (8, 0.5, 0.5),
        (14, 0.5, 0.2140),  # BT.2020's own curve: as sRGB
    ],
)
def test_hdr_and_linear_videos_become_srgb(
    transfer: int, signal: float, light: float, tmp_path: Path
) -> None:
    video = write_flat(tmp_path / "a.mkv", (signal,) * 3, 9, color_primaries=9, color_trc=transfer)
    np.testing.assert_allclose(read_photo(frames_of(video, tmp_path / "frames")[1]), light, atol=0.02)


def test_wide_primaries_become_srgb(tmp_path: Path) -> None:
    """Linear light of BT.2020 (.5, .05, .05) by the matrix of BT.2087.

    Red: 1.6605 * .5 - (.5876 + .0728) * .05 = .797; green: -.1246 * .5 + (1.1329 - .0083) * .05 < 0; blue:
    -.0182 * .5 + (1.1187 - .1006) * .05 = .042.
    """
    red, other = (1.055 * light ** (1 / 2.4) - 0.055 for light in (0.5, 0.05))
    video = write_flat(tmp_path / "a.mkv", (red, other, other), 9, color_primaries=9, color_trc=14)
    found = read_photo(frames_of(video, tmp_path / "frames")[0])
    np.testing.assert_allclose(found, np.broadcast_to([0.797, 0, 0.042], found.shape), atol=0.01)


def test_unread_encodings_of_videos_are_named(tmp_path: Path) -> None:
    video = write_flat(tmp_path / "a.mkv", (0.5, 0.5, 0.5), 1, color_primaries=1, color_trc=10)
    with pytest.raises(UserError, match=r"got '.*a\.mkv' with primaries 1 and transfer 10 of H\.273"):
        frames_of(video, tmp_path / "frames")
    assert not (tmp_path / "frames").exists()


@pytest.mark.parametrize(
    ("matrix", "side_data", "words"),
    [
        (8, {}, "matrix 8 of H"),
        (14, {}, "matrix 14"),
        (2, {"DOVI_RPU_BUFFER": b"x"}, "Dolby Vision's own colours"),
    ],
)
def test_matrices_that_ffmpeg_does_not_read_are_named(
    matrix: int, side_data: dict[str, bytes], words: str, tmp_path: Path
) -> None:
    """YCgCo, ICtCp, and Dolby Vision without a fallback: frames are pretended, as no encoder writes them."""
    frame = SimpleNamespace(colorspace=matrix, side_data=side_data)
    codec = SimpleNamespace(color_primaries=2, color_trc=2)
    with pytest.raises(UserError, match=rf"got 'a\.mp4' with {words}.*Convert it to BT\.709"):
        _encoding(Path("a.mp4"), codec, frame)
    assert _encoding(Path("a.mp4"), codec, SimpleNamespace(colorspace=1, side_data={})) is None


def test_frames_of_an_earlier_vig_are_written_again(tmp_path: Path) -> None:
    video, folder = write_video(tmp_path / "a.avi"), tmp_path / "frames"
    frames_of(video, folder)
    state = json.loads((folder / WHOLE).read_text())
    del state["source"]["format"]
    (folder / WHOLE).write_text(json.dumps(state))
    (folder / "frames-000000.png").write_text("of oblong pixels")
    assert pixels(frames_of(video, folder)[0]).shape == (48, 64, 3)


def test_a_damaged_video_keeps_its_frames_and_says_where_they_are(tmp_path: Path) -> None:
    whole = write_video(tmp_path / "whole.avi").read_bytes()
    (tmp_path / "cut.avi").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(
        UserError, match=r"whole video; got .*cut\.avi', damaged after \d frames.*'.*frames'"
    ) as error:
        frames_of(tmp_path / "cut.avi", tmp_path / "frames")
    assert "\n" not in str(error.value)
    assert list((tmp_path / "frames").glob("*.png")) and not (tmp_path / "frames" / WHOLE).exists()


def write_with_cover(path: Path, flagged: bool, count: int = COUNT, times: Sequence[int] = ()) -> Path:
    """A film of 64 x 48 pixels after a cover of 32 x 16; `times`: of its frames, milliseconds."""
    with av.open(str(path), "w") as file:
        cover, film = file.add_stream("mjpeg"), file.add_stream("mpeg4", rate=24)
        cover.width, cover.height, cover.pix_fmt = 32, 16, "yuvj420p"
        film.width, film.height, film.pix_fmt = 64, 48, "yuv420p"
        cover.codec_context.time_base = film.codec_context.time_base = Fraction(1, 1000)
        if flagged:
            cover.disposition = av.stream.Disposition.attached_pic.value
        for stream, number in ((cover, 1), (film, count)):
            for at in times[:number] if times else range(0, 40 * number, 40):
                frame = av.VideoFrame(stream.width, stream.height, stream.pix_fmt)
                frame.pts, frame.time_base = at, Fraction(1, 1000)
                file.mux(stream.encode(frame))
            file.mux(stream.encode())
    return path


@pytest.mark.parametrize("name", ["flagged.mp4", "plain.mkv"])
def test_a_cover_is_not_the_film(name: str, tmp_path: Path) -> None:
    paths = frames_of(write_with_cover(tmp_path / name, name == "flagged.mp4"), tmp_path / "frames")
    assert len(paths) == COUNT and pixels(paths[0]).shape == (48, 64, 3)


def write_song(path: Path, cover: bool) -> Path:
    """Sound, beside it a picture of the cover."""
    with av.open(str(path), "w", format="mp4") as file:
        sound = file.add_stream("aac", rate=8000)
        if cover:
            picture = file.add_stream("mjpeg")
            picture.width, picture.height, picture.pix_fmt = 32, 16, "yuvj420p"
            picture.disposition = av.stream.Disposition.attached_pic.value
            file.mux(picture.encode(av.VideoFrame(32, 16, "yuvj420p")))
        noise = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        noise.sample_rate = 8000
        file.mux([*sound.encode(noise), *sound.encode()])
    return path


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda path: path.write_bytes(b""), "an empty file"),
        (lambda path: path.write_bytes(b"no video at all" * 100), "cannot be read. Save or copy it again"),
        (lambda path: None, "nothing of that name"),
        (lambda path: write_song(path, cover=False), "in which there are no pictures"),
        (lambda path: write_song(path, cover=True), "in which there are no pictures"),
        (
            lambda path: write_video(path.with_suffix(".avi"), count=0).rename(path),
            "expected a video; got .*a.mp4",
        ),
    ],
)
def test_what_is_no_video_is_refused_in_one_line(
    write: Callable[[Path], object], words: str, tmp_path: Path
) -> None:
    write(tmp_path / "a.mp4")
    with pytest.raises(UserError, match=words) as error:
        frames_of(tmp_path / "a.mp4", tmp_path / "frames")
    assert "\n" not in str(error.value)


def test_a_film_that_was_cut_off_is_said_to_be(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Where ffmpeg reads it to any end."""
    whole = write_video(tmp_path / "a.mkv", count=6 * COUNT).read_bytes()
    assert len(frames_of(tmp_path / "a.mkv", tmp_path / "whole")) == 6 * COUNT
    assert capsys.readouterr().err == ""
    (tmp_path / "a.mkv").write_bytes(whole[: len(whole) // 2])
    assert COUNT < len(frames_of(tmp_path / "a.mkv", tmp_path / "cut")) < 4 * COUNT
    assert re.search(r"a.mkv' ends after \d\.\d s of the 3\.0 s that it states", capsys.readouterr().err)


def test_transparent_pixels_are_laid_over_grey(tmp_path: Path) -> None:
    with av.open(str(tmp_path / "a.mov"), "w") as file:
        stream = file.add_stream("qtrle", rate=24)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "argb"
        picture = np.full((48, 64, 4), 255, np.uint8)
        picture[:, 32:, 3] = 0
        file.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgba")))
        file.mux(stream.encode())
    found = pixels(frames_of(tmp_path / "a.mov", tmp_path / "frames")[0])
    assert (found[:, :32] == 255).all() and 100 < found[:, 32:].min() <= found[:, 32:].max() < 200


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
