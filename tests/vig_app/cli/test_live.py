"""`vig fit --track --live`: files and pipes in place of cameras."""

import csv
import json
import os
import signal
import socket
import threading
import time
from dataclasses import fields
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from tests.support import run_vig
from tests.vig.photo.test_video import write_with_cover
from vig.io.errors import UserError
from vig_app.cli.options import FitCommand
from vig_app.examples import example_photos
from vig_app.runs import live
from vig_app.runs.live import CURVES, LIVE_COLUMNS, OVERLAY, LatestFrame, OverlayVideo

FRAMES = 4


def write_stream(path: Path, kind: str | None = None) -> Path:
    """A packaged photo, shown for some frames at two a second."""
    with Image.open(example_photos()[0].photo) as photo:
        picture = np.asarray(photo.convert("RGB"))
    with av.open(str(path), "w", format=kind) as file:
        stream = file.add_stream("mpeg4", rate=2)
        stream.height, stream.width = (side // 2 * 2 for side in picture.shape[:2])
        stream.pix_fmt, stream.bit_rate = "yuv420p", 4_000_000
        for _ in range(FRAMES):
            frame = av.VideoFrame.from_ndarray(
                np.ascontiguousarray(picture[: stream.height, : stream.width]), format="rgb24"
            )
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    return path


def rows_of(out: Path) -> list[dict[str, str]]:
    with open(out / "track.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_file_is_tracked_as_a_stream(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, out = write_stream(tmp_path / "pot.mp4"), tmp_path / "out"
    assert run_vig("fit", "--track", "--live", source, "--K", "200,200,75,75", "--out", out) == 0
    output = capsys.readouterr()
    rows = rows_of(out)
    assert tuple(rows[0]) == LIVE_COLUMNS and 1 <= len(rows) <= FRAMES
    assert output.out.splitlines()[-1] == str(out)
    assert output.err.startswith(
        f"vig: tracked: 0 of {len(rows)} frames are lost, the path is {out}/track.csv"
    )
    pose = [float(rows[-1][f"camera_from_object_{r}{c}"]) for r in range(3) for c in range(3)]
    turn = np.array(pose).reshape(3, 3)
    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-6)
    assert float(rows[0]["focal_px"]) == 200 and float(rows[0]["z_deviation"]) > 0
    with av.open(str(out / OVERLAY)) as video:
        shown = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    assert len(shown) == len(rows)
    blue = shown[0][..., 2].astype(int) - shown[0][..., :2].max(-1)
    assert (blue > 60).sum() > 10  # the vertical axis
    with Image.open(out / CURVES) as curves:
        assert np.asarray(curves).std() > 5


def test_a_pipe_is_tracked_to_its_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole, pipe, out = write_stream(tmp_path / "pot.ts", "mpegts"), tmp_path / "pipe", tmp_path / "out"
    os.mkfifo(pipe)
    threading.Thread(target=lambda: pipe.write_bytes(whole.read_bytes()), daemon=True).start()
    assert run_vig("fit", "--track", "--live", pipe, "--json", "--out", out) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["folder"] == str(out) and 1 <= result["frames"] == len(rows_of(out)) <= FRAMES


def test_older_frames_are_dropped_where_the_tracker_is_slower(tmp_path: Path) -> None:
    frames = iter(LatestFrame(str(write_stream(tmp_path / "pot.mp4"))))
    next(frames)
    time.sleep(1.7)  # the file lasts 1.5 seconds
    assert len(list(frames)) == 1


@pytest.mark.parametrize(
    "times",
    [
        [60_000, 60_040, 60_080],  # as of a recording of a broadcast
        [0, 40, 3_600_040],
    ],
)
def test_a_file_is_played_from_its_first_frame_on_without_its_cover(times: list[int], tmp_path: Path) -> None:
    video, began = write_with_cover(tmp_path / "film.mkv", False, 3, times), time.monotonic()
    assert {picture.shape for picture in LatestFrame(str(video))} == {(48, 64, 3)}
    assert time.monotonic() - began < 5


def test_a_stream_without_a_clock_is_played(tmp_path: Path) -> None:
    assert 1 <= len(list(LatestFrame(str(write_stream(tmp_path / "pot.m4v", "m4v"))))) <= FRAMES


@pytest.mark.parametrize("kind", ["address", "pipe", "broken off"])
def test_a_source_that_falls_silent_ends(kind: str, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    if kind == "broken off":
        data = 40 * write_stream(tmp_path / "pot.ts", "mpegts").read_bytes()  # so much is probed
        writer = os.open(pipe, os.O_RDWR)  # stays open
        threading.Thread(target=os.write, args=(writer, data), daemon=True).start()
        frames = LatestFrame(str(pipe), timeout=1)
        assert len(list(frames)) >= 1
        assert frames.problem is not None and "got none from" in frames.problem
        os.close(writer)
        return
    with socket.create_server(("127.0.0.1", 0)) as server:
        source = f"http://127.0.0.1:{server.getsockname()[1]}/" if kind == "address" else str(pipe)
        with pytest.raises(UserError, match=r"got none from '.*' for 0\.5 s"):
            LatestFrame(source, timeout=0.5)


def test_an_address_that_refuses_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            with server.accept()[0] as client:
                client.recv(1000)
                client.sendall(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n")

        threading.Thread(target=answer, daemon=True).start()
        with pytest.raises(UserError, match="which cannot be opened"):
            LatestFrame(f"http://127.0.0.1:{server.getsockname()[1]}/a.ts")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_with_whole_files(
    number: signal.Signals, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def end(pose: object) -> str:
        os.kill(os.getpid(), number)
        return ""

    handlers = [(each, signal.getsignal(each)) for each in (signal.SIGINT, signal.SIGTERM)]
    monkeypatch.setattr(live, "_line", end)
    out = tmp_path / "out"
    try:
        assert run_vig("fit", "--track", "--live", write_stream(tmp_path / "pot.mp4"), "--out", out) == code
    finally:
        for each, handler in handlers:
            signal.signal(each, handler)
    with av.open(str(out / OVERLAY)) as video:
        assert len(list(video.decode(video=0))) == len(rows_of(out)) == 1
    assert (out / CURVES).exists()


def test_what_a_kill_leaves_of_the_overlay_plays(tmp_path: Path) -> None:
    video = OverlayVideo(tmp_path / OVERLAY)
    for number in range(5):
        video.add(np.full((49, 65, 3), 40 * number, np.uint8), 0.1 * number)
    with av.open(str(tmp_path / OVERLAY)) as left:
        shown = [frame.to_ndarray(format="rgb24").mean() for frame in left.decode(video=0)]
    assert len(shown) >= 4 and np.allclose(shown, 40 * np.arange(len(shown)), atol=8)
    video.close()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--track", "--live", "99"), "got '99', which cannot be opened"),
        (("--track", "--live", "no such file.mp4"), "cannot be opened"),
        (("--live", "0"), "expected --track --live SOURCE"),
        (("photo.jpg", "--track", "--live", "0"), "without photos"),
        (("--track", "--live", "0", "--visible"), "--live without --visible"),
        (("--track", "--live", "0", "--timeout", "nan"), "--timeout in seconds, above 0"),
        (("photo.jpg", "--timeout", "5"), "--timeout with --live"),
        (("--track", "--live", "0", "--K", "1,2,3,4", "--focal", "5"), "--K, --cameras and --focal"),
    ],
)
def test_what_cannot_be_tracked_live_is_refused_in_a_line(
    arguments: tuple[str, ...], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_vig("fit", *arguments, "--out", tmp_path / "out") == 2
    errors = capsys.readouterr().err.strip().splitlines()
    assert len(errors) == 1 and words in errors[0]


def test_options_of_live_are_known() -> None:
    from vig_app.cli.track import WITHOUT_LIVE

    assert {each.name for group in FitCommand().groups for each in fields(group)} > WITHOUT_LIVE
