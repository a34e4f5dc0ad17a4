"""`vig fit` of videos, and with `--track`."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as parquet
import pytest
from PIL import Image

from tests.support import run_vig
from tests.vig.photo.test_video import write_video
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_app.cli import fit as fit_verb
from vig_app.corrections import State
from vig_app.examples import example_photos
from vig_app.results import TRACK_COLUMNS, write_table
from vig_app.runs import ledger_of


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """A folder of three frames that show the same."""
    folder = tmp_path / "pot"
    folder.mkdir()
    with Image.open(example_photos()[0].photo) as photo:
        for number in range(3):
            photo.convert("RGB").save(folder / f"{number}.png")
    return folder


def test_a_folder_of_frames_is_tracked(
    frames: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And its table is written before another run may begin."""
    out = tmp_path / "out"

    def write(out: Path, rows: list[dict[str, Any]]) -> None:
        with pytest.raises(UserError, match="another run is writing"), ledger_of(out):
            pass
        write_table(out, rows)

    monkeypatch.setattr(fit_verb, "write_table", write)
    assert run_vig("fit", frames, "--track", "--out", out, "--K", "200,200,75,75") == 0
    output = capsys.readouterr()
    assert output.out.splitlines()[-1] == str(out)
    assert output.err.splitlines()[-1] == (
        f"vig: tracked: 0 of 3 frames are lost, the path is {out / 'track.csv'};"
        f" of the frames open {out / 'report.html'}"
    )
    with open(out / "track.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == tuple(TRACK_COLUMNS) and [row["frame"] for row in rows] == ["0", "1", "2"]
    table = parquet.read_table(out / "track.parquet")
    assert table.column_names == list(TRACK_COLUMNS) and table.num_rows == 3
    assert str(table.schema.field("lost").type) == "bool"
    for row in rows:
        assert (out / row["folder"] / "explanation.json").exists() and row["lost"] == "False"
        off = float(row["azimuth_deg"]) - float(row["alone_azimuth_deg"])
        assert abs((off + 180) % 360 - 180) < 3
    pose = np.array([float(rows[0][f"camera_from_object_{r}{c}"]) for r in range(3) for c in range(4)])
    turn = pose.reshape(3, 4)[:, :3]
    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-6)
    assert float(rows[0]["focal_px"]) == 200 and float(rows[0]["center_x"]) == 75
    content = json.loads((out / "track.json").read_text())
    assert content["class"] == "teapot" and len(content["albedo"]) == 3
    assert (out / "results.csv").exists() and (out / "report.html").exists()
    State(visible=True).write(out / "1", frames / "1.png", ObjectClass.load("teapot"), corrected=True)
    corrected = (out / "1" / "corrections.json").read_bytes()
    assert run_vig("fit", frames, "--track", "--out", out) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and f"got corrections.json of 1 in '{out}'. Choose another --out." in error
    assert (out / "1" / "corrections.json").read_bytes() == corrected


def test_a_video_is_taken_as_its_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Alone; grey ones show no pot, but each is said."""
    video, out = write_video(tmp_path / "grey.avi", count=2), tmp_path / "out"
    assert run_vig("fit", video, "--out", out) == 0
    assert "grey-000000.png" in capsys.readouterr().out
    assert (out / "frames" / "grey" / "grey-000001.png").exists()
    assert (out / "grey-000001" / "explanation.json").exists()
    assert run_vig("fit", video, "--out", out) == 0
    assert capsys.readouterr().out.count("done before") == 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["pot", "pot"], "expected one folder of frames or one video with --track; got 2 names"),
        (["pot/0.png"], "one folder of frames or one video with --track; got 'pot/0.png'"),
        (["pot", "--cluster", "auto"], "expected --track without --cluster"),
        (["pot", "--boxes", "b.json"], "expected --track without --boxes"),
        (["pot", "--azimuth", "30"], "expected --track without --azimuth"),
        (["pot", "--workers", "2"], "expected --track without --workers"),
        (["empty"], "expected photos in 'empty'; got none"),
        (["pot", "--cameras", "c.json"], "expected one camera for all frames"),
        (["one"], "expected two or more frames of a video; got one"),
        (["no.mp4"], "expected an image file; got"),
    ],
)
def test_what_cannot_be_tracked_is_refused_in_one_line(
    arguments: list[str],
    words: str,
    frames: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(frames.parent)
    Path("empty").mkdir()
    Path("one").mkdir()
    Path("c.json").write_text(json.dumps({f"{n}.png": [200 + n, 200, 75, 75] for n in range(3)}))
    Path("one/0.png").write_bytes((frames / "0.png").read_bytes())
    assert run_vig("fit", *arguments, "--track") == 2
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1
