"""`vig demo` as its user meets it."""

import json
import re
import shlex
import sys
from pathlib import Path
from shutil import which

import pytest
from PIL import Image

from tests.support import run_vig
from vig_app.cli.results import has_screen
from vig_app.demo import demo_photos

pytestmark = pytest.mark.slow
FILES = {"explanation.json", "overlay.png", "mask.png", "render.png", "object.glb", "report.html"}
FILES |= {"thumbnail.jpg"}


def run(capsys, *arguments: object) -> str:
    assert run_vig("demo", *arguments) == 0
    return capsys.readouterr().out


def test_every_photo_is_explained_and_the_folder_printed_last(capsys, tmp_path: Path) -> None:
    out = tmp_path / "demo"
    lines = run(capsys, "--out", out).splitlines()
    photos = demo_photos()
    names = [photo.name for photo in photos]
    assert lines[-1] == str(out)
    assert {path.name for path in out.iterdir()} == {*names, "sheet.jpg", "report.html"}
    for photo in photos:
        assert {path.name for path in (out / photo.name).iterdir()} == FILES
        with Image.open(out / photo.name / "overlay.png") as overlay, Image.open(photo.photo) as image:
            assert overlay.size == image.size
    table = [line.split()[1] for line in lines if line.startswith("│")]
    assert table == names  # one line a photo, nothing cut off
    assert "…" not in "".join(lines)
    called = "vig" if which("vig") else shlex.join([sys.executable, "-m", "vig"])
    commands = [line.split(called)[1].split()[0] for line in lines[lines.index("Try next:") + 1 : -1]]
    assert commands == ["fit", "fit", "class"]
    page = (out / "report.html").read_text()
    links = [(f"{photo.name}/report.html", photo.title) for photo in photos]
    assert re.findall('<strong><a href="([^"]+)">([^<]+)</a></strong>', page) == links

    first = (out / names[0] / "explanation.json").read_bytes()
    report = json.loads(run(capsys, "--out", out, "--json"))  # again into the same folder
    assert report["folder"] == str(out) and [row["photo"] for row in report["photos"]] == names
    assert (out / names[0] / "explanation.json").read_bytes() == first
    verdicts = {row["photo"]: row["verdict"] for row in report["photos"]}
    assert verdicts.pop("07_tomato") == "ambiguous" and verdicts.pop("08_no_pot") == "absent"
    assert list(verdicts.values()).count("trusted") >= 5, verdicts
    shown = [row for row in report["photos"] if row["shows"] == row["class"]]
    for row in shown:
        assert row["segmentation_iou"] > 0.85 and row["shape_error_mm"] < 25
        assert row["azimuth_error_deg"] < 15 or row["verdict"] == "ambiguous"
    vain = report["photos"][-1]
    assert vain["azimuth_error_deg"] is None and vain["azimuth_deg"][0] is None


def test_a_file_in_the_way_is_told(capsys, tmp_path: Path) -> None:
    (tmp_path / "demo").write_text("mine")
    assert run_vig("demo", "--out", tmp_path / "demo") == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "is a file" in error


@pytest.mark.parametrize(
    ("terminal", "display", "opens"), [(True, ":0", True), (True, "", False), (False, ":0", False)]
)
def test_the_page_opens_where_somebody_sits(
    monkeypatch: pytest.MonkeyPatch, terminal: bool, display: str, opens: bool
) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("sys.stdout.isatty", lambda: terminal, raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", display)
    assert has_screen() is opens
