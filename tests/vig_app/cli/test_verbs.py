"""The command line as its user meets it: one clear line and exit code 2 for a mistake."""

import io
import json
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from PIL import Image

import vig
from tests.support import run_vig
from vig.likelihood import LIKELIHOODS
from vig_app.cli.hints import cameras_of
from vig_app.cli.options import CameraOptions, ModelOptions
from vig_app.corrections import State
from vig_app.examples import example_photos
from vig_app.exports import export_run, run_formats


def refused(capsys, *arguments: object, code: int = 2) -> str:
    """What is said of arguments that cannot be used; with a code of 1, of some photos among others."""
    assert run_vig(*arguments) == code
    error = capsys.readouterr().err
    assert "Traceback" not in error
    return error


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    path = tmp_path / "photo.png"
    Image.fromarray(np.full((120, 160, 3), 128, np.uint8)).save(path)
    return path


def test_help_offers_what_there_is():
    assert get_args(get_type_hints(ModelOptions)["likelihood"]) == tuple(LIKELIHOODS)


@pytest.mark.parametrize("verb", ["fit", "view", "export", "class build", "dataset make", "evaluate"])
def test_help_states_no_empty_defaults(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    run_vig(*verb.split(), "--help")
    words = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "default: " in words or verb == "export"
    assert not re.search(r"\{None\}|default: (None|False|True)?\)", words)


def test_a_run_without_workers_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photo, out = str(example_photos()[0].photo), tmp_path / "out"
    assert run_vig("fit", photo, "--workers", "0", "--out", str(out)) == 2
    assert "expected 1 or more --workers; got 0" in capsys.readouterr().err and not out.exists()


def test_help_fills_the_lines_of_the_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The text of an option is broken by the terminal's width, not as in the source."""
    monkeypatch.setenv("COLUMNS", "100")
    run_vig("fit", "--help")
    lines = [line.strip("│ ") for line in capsys.readouterr().out.splitlines()]
    first = next(number for number, line in enumerate(lines) if line.startswith("--boxes"))
    described = lines[first : next(n for n, line in enumerate(lines) if line.startswith("--labels"))]
    assert all(len(line) > 70 for line in described[1:-1]) and len(described) == 3


def test_help_describes_each_format_of_a_run(capsys: pytest.CaptureFixture[str]) -> None:
    run_vig("export", "--help")
    words = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert [name for name in run_formats() if f" {name}: " not in words] == []


def test_results_are_drawn_on_the_whole_photo(capsys, photo, tmp_path):
    assert run_vig("fit", photo, "--box", "40,30,60,50", "--out", tmp_path / "out", "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    folder = Path(printed["results"][str(photo)]["folder"])
    assert Image.open(folder / "overlay.png").size == (160, 120)
    assert Image.open(folder / "mask.png").size == (160, 120)
    stored = json.loads((folder / "explanation.json").read_text())
    assert stored["verdict"] in ("trusted", "reverted", "ambiguous", "failed", "absent")
    assert len(stored["shape"]) == 16
    assert 0 <= stored["azimuth_deg"] < 360


def test_chosen_files_have_the_mask_of_an_export_and_links_that_lead_somewhere(tmp_path: Path) -> None:
    """A large photo beside a small one: its picture is smaller than it, the mask is not."""
    photos = [tmp_path / "a.png", tmp_path / "b.png"]
    with Image.open(example_photos()[0].photo) as example:
        example.save(photos[0])
        example.resize((2100, 2100)).save(photos[1])
    files = ["--files", "thumbnail.jpg", "overlay.png", "--export", "coco"]
    command = ["fit", *map(str, photos), *files, "--out", str(tmp_path / "out")]
    assert run_vig(*command) == 0
    result = tmp_path / "out" / "b"
    sizes = {name: Image.open(result / name).size for name in ("overlay.png", "mask.png")}
    assert sizes == {"overlay.png": (2048, 2048), "mask.png": (2100, 2100)}
    assert (tmp_path / "out" / "coco.json").exists() and not (result / "report.html").exists()
    page = (tmp_path / "out" / "report.html").read_text()
    links = set(re.findall('href="([^"#:]+)"', page))
    assert "a/" in links and all((tmp_path / "out" / link).exists() for link in links)
    run_vig(*command, "--full-size")
    assert Image.open(result / "overlay.png").size == (2100, 2100)


def test_a_fit_ends_with_what_to_do_next(capsys, tmp_path):
    """The folder on standard output, the line after it on standard error."""
    shutil.copy(example_photos()[0].photo, tmp_path / "a b.png")
    Image.new("L", (150, 150), 255).save(tmp_path / "mask.png")
    out = tmp_path / "out"

    def said(*options: str | Path) -> str:
        run_vig("fit", tmp_path / "a b.png", *options, "--out", out)
        output = capsys.readouterr()
        assert output.out.splitlines()[-1] == str(out)
        return output.err.splitlines()[-1]

    page = out / "a b" / "report.html"
    assert said() == f"vig: explained: open {page}; to correct: vig view '{page.parent}'"
    assert said("--mask", tmp_path / "mask.png") == f"vig: explained: open {page}", "vig view has no mask"
    made, order = f"explained 2 of 2 photos: open {out / 'report.html'}", "to correct, the least sure first"
    assert said(tmp_path / "a b.png", "--files", "mask.png") == f"vig: {made}; {order}: vig view {out}"


def test_one_bad_photo_does_not_lose_the_others(capsys, photo, tmp_path):
    bad = tmp_path / "bad.png"
    bad.write_bytes(b"not a picture")
    error = refused(capsys, "fit", bad, photo, "--out", tmp_path / "out", code=1)
    assert "bad.png" in error
    names = {path.name for path in (tmp_path / "out" / "photo").iterdir()}
    pictures = {"overlay.png", "mask.png", "render.png", "thumbnail.jpg"}
    assert names == pictures | {"explanation.json", "corrections.json", "object.glb", "report.html", ".key"}


def test_a_log_has_a_line_for_each_photo_whatever_is_printed(capsys, photo, tmp_path):
    bad, log = tmp_path / "bad\n.png", tmp_path / "log.txt"
    bad.write_bytes(b"not a picture")
    refused(capsys, "fit", bad, photo, "--quiet", "--log", log, "--out", tmp_path / "out", code=1)
    begun, error, verdict = (line.partition(" ")[2] for line in log.read_text().splitlines())
    assert begun.startswith("vig ") and "2 photos" in begun
    assert error.startswith("error: ") and "bad" in error
    assert (
        verdict.split(":")[0] in ("trusted", "reverted", "ambiguous", "failed", "absent")
        and "photo.png" in verdict
    )
    error = refused(capsys, "fit", photo, "--log", tmp_path, "--out", tmp_path / "other")
    assert "--log FILE" in error and not (tmp_path / "other").exists()


def fitted(capsys, out: Path, *options: str) -> tuple[dict[str, Any], np.ndarray]:
    """What `vig fit` says of a photo with a third hidden, under options, and its mask."""
    photo = min(example_photos(), key=lambda example: abs(example.occlusion - 0.3)).photo
    assert run_vig("fit", photo, "--out", out, "--json", *options) == 0
    described = json.loads(capsys.readouterr().out)["results"][str(photo)]
    return described, np.asarray(Image.open(Path(described["folder"]) / "mask.png"))


def test_options_of_a_fit_are_heeded(capsys, tmp_path):
    """Each changes what it should, and nothing that was said before a fit."""
    plain, mask = fitted(capsys, tmp_path / "plain")
    assert plain["framing"]["magnification"] != 1 and (mask == 128).any()
    fixed, _ = fitted(capsys, tmp_path / "fixed", "--framing", "fixed")
    assert fixed["framing"] == {"shift": [0, 0], "magnification": 1, "roll_deg": 0}
    assert fixed["start_evidence_nats"] == plain["start_evidence_nats"]
    unshaded, _ = fitted(capsys, tmp_path / "unshaded", "--no-self-shadow")
    assert unshaded["start_evidence_nats"] != plain["start_evidence_nats"]
    robust, by_pixel = fitted(capsys, tmp_path / "robust", "--likelihood", "robust")
    assert robust["evidence_nats"] == plain["evidence_nats"] and (mask != by_pixel).any()
    gaussian, _ = fitted(capsys, tmp_path / "gaussian", "--likelihood", "gaussian")
    assert gaussian["hidden_fraction"] < 0.01 < plain["hidden_fraction"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("paint", "expected a verb"),
        ("fitt a.png", "got 'fitt'. Did you mean vig fit?"),
        ("class biuld", "got 'class biuld'. Did you mean vig class build?"),
        ("evaluate --dataset nowhere --out r", "nowhere"),
        ("dataset make --out d --count 0", "count"),
        ("fit", "at least one photo"),
        ("fit nothing.png", "nothing.png"),
        ("fit http://a.b/c.jpg?d=1", "got an address. Download it"),
        ("fit photo.png --focal abc", "expected --focal FLOAT; got 'abc'. See vig fit --help."),
        ("fit photo.png --foccal 3", "--foccal, 3. Did you mean --focal?"),
        ("fit photo.png --framing odd", "'odd' for argument '--framing'"),
        ("fit photo.png --box=1,2,3", "box"),
        ("fit photo.png --box=a,b,c,d", "box"),
        ("fit photo.png --box=0,0,1000,1000", "box"),
        ("fit photo.png --box=-45,0,50,50", "box"),
        ("fit photo.png --class spaceship", "teapot"),
        ("fit photo.png --likelihood no-such", "robust"),
        ("fit photo.png --meshes a.glb --mesh b.glb", "expected --meshes without --mesh"),
        ("fit photo.png --meshes a.glb --roll 0", "expected --roll with one object"),
        ("fit photo.png --meshes . --box 1,2,3,4", "expected --meshes without --mesh"),
        ("fit photo.png --meshes none.glb", "got no 'none.glb'"),
        ("fit . --track --meshes a.glb", "expected --track without --meshes"),
        ("fit photo.png --up -z", "expected --up with --mesh"),  # which the parser takes for an option
        ("fit photo.png --files mask.png picture.png", "thumbnail.jpg"),
        ("fit photo.png --files mask.png picture.png", "got 'picture.png'"),
        ("fit photo.png --files", "thumbnail.jpg"),
        ("fit photo.png --files", "got none. Leave it out for all"),
        ("fit photo.png --K 1,2,3", "--K"),
        ("fit photo.png --K a,b,c,d", "--K"),
        ("fit photo.png --K 900,900,75,75 --focal 900", "--K"),
        ('fit photo.png --boxes {"other.png":[1,2,30,40]}', "got one of 'other.png'"),
        ('fit photo.png --boxes {"photo.png":[1,2,30]}', "boxes by the photos' file names"),
        ("fit photo.png --boxes [1,2", "boxes by the photos' file names"),
        ("fit photo.png --boxes {} --box 1,2,30,40", "got both"),
    ],
)
def test_a_mistake_is_named_in_one_line(
    capsys, arguments: str, words: str, photo: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The content of a file of boxes stands in the place of its name."""
    monkeypatch.chdir(photo.parent)
    given = arguments.split()
    if "--boxes" in given:
        place = given.index("--boxes") + 1
        Path("boxes.json").write_text(given[place])
        given[place] = "boxes.json"
    error = refused(capsys, *given)
    assert words in error and error.count("\n") == 1
    assert not list(Path().glob("vig-fit/*/*"))
    if "--K" in given or "--files" in given:
        assert not Path("vig-fit").exists()


def test_help_loads_nothing_heavy():
    """`vig --help` must not import torch or warp: it is to answer at once."""
    code = "import sys; sys.argv = ['vig', '--help']\nfrom vig_app.cli.main import main\ntry:\n main()\n"
    code += "except SystemExit:\n pass\nassert not {'torch', 'warp', 'scipy'} & set(sys.modules)"
    started = time.monotonic()
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
    assert time.monotonic() - started < 20  # a hang, not a speed


def test_boxes_by_name_and_a_folder_of_photos(capsys, tmp_path):
    """Two photos in a folder, one with a box of its own; a file that is no photo fails, the others go on."""
    folder = tmp_path / "photos"
    folder.mkdir()
    example = Image.open(example_photos()[0].photo).convert("RGB")
    example.save(folder / "a.png")
    wide = Image.new("RGB", (300, 200), (90, 90, 90))
    wide.paste(example, (100, 30))
    wide.save(folder / "b.png")
    (folder / "c.png").write_bytes(b"no photo")
    (folder / "notes.txt").write_text("not looked at")
    (tmp_path / "boxes.json").write_text('{"b.png": [110, 50, 130, 110]}')
    assert run_vig("fit", folder, "--boxes", tmp_path / "boxes.json", "--out", tmp_path / "o", "--json") == 1
    output = capsys.readouterr()
    results = json.loads(output.out)["results"]
    assert [Path(name).name for name in results] == ["a.png", "b.png"]
    x, y, w, h = results[str(folder / "b.png")]["box"]
    assert 80 < x < 150 and 20 < y < 90 and w < 170 and h < 160
    passed_over, wrong = output.err.splitlines()
    assert "c.png" in wrong and passed_over.endswith("not taken: notes.txt (no photo)")


def test_the_version_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_vig("--version") == 0 and capsys.readouterr().out == f"vig {vig.__version__}\n"


def cameras_given(photos: list[Path], **options: Any) -> list[Any]:
    return cameras_of(CameraOptions(**options), photos)


def test_cameras_are_those_of_a_file_by_path_by_name_or_by_number(tmp_path: Path) -> None:
    names = ("000003.png", "000012.png")
    photos = [tmp_path / scene / "rgb" / name for scene in ("1", "2") for name in names]
    file = tmp_path / "cameras.json"
    file.write_text(json.dumps({"1/rgb/000003.png": [1], "2/rgb/000003.png": [2], "000012.png": [3]}))
    with pytest.raises(vig.UserError, match="got '000012.png', which is the name of 2.* '1/rgb/000012.png'"):
        cameras_given(photos, cameras=file)
    assert cameras_given(photos[:2], cameras=file) == [[1], [3]]
    file.write_text(json.dumps({"3": {"cam_K": [4]}, "12": {"cam_K": [5]}, "7": {}}))
    assert cameras_given(photos[:2], cameras=file) == [{"cam_K": [4]}, {"cam_K": [5]}]
    with pytest.raises(vig.UserError, match="one scene .* got 2 scenes"):
        cameras_given(photos, cameras=file)
    with pytest.raises(vig.UserError, match="expected a camera of .*000004.png"):
        cameras_given([tmp_path / "000004.png"], cameras=file)
    for camera in ([9.0, 9, 1, 1], {"fx": 9, "fy": 9, "cx": 1, "cy": 1}, {"K": [[9, 0, 1]]}):
        file.write_text(json.dumps(camera))
        assert cameras_given(photos, cameras=file) == [camera] * 4
    assert cameras_given(photos, intrinsics="9, 8,1,2.5") == [(9.0, 8.0, 1.0, 2.5)] * 4
    assert cameras_given(photos) == [None] * 4


def test_a_photo_fitted_with_its_camera_has_it_in_all_its_files(tmp_path: Path) -> None:
    """K, the pose before it, and what `vig view` resumes from; its BOP file has the same pose."""
    photo = tmp_path / "7.png"
    shutil.copy(example_photos()[1].photo, photo)
    (tmp_path / "cameras.json").write_text(json.dumps({"7": {"cam_K": [300, 0, 90, 0, 310, 70, 0, 0, 1]}}))
    out = tmp_path / "out"
    options = ["--cameras", str(tmp_path / "cameras.json"), "--out", str(out)]
    assert run_vig("fit", photo, photo, *options) == 0
    described = json.loads((out / "7" / "explanation.json").read_text())
    assert (
        described["camera"]["K"] == [[300, 0, 90], [0, 310, 70], [0, 0, 1]]
        and described["camera"]["focal_from"] == "given"
    )
    assert described["pinhole"]["camera_from_object"] == described["camera"]["camera_from_object"]
    _, _, state = State.read(out / "7")
    assert state.camera == (300, 310, 90, 70)
    lines = export_run(out, ["bop"])[0].read_text().splitlines()
    place = [float(number) / 1000 for number in lines[1].split(",")[5].split()]
    assert place == pytest.approx([row[3] for row in described["camera"]["camera_from_object"][:3]], abs=1e-6)


def test_letters_that_a_terminal_has_not_are_escaped(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = io.TextIOWrapper(io.BytesIO(), encoding="latin-1")
    monkeypatch.setattr("sys.stderr", terminal)
    assert run_vig("fit", "Ω.jpg") == 2
    terminal.flush()
    assert b"\\u03a9.jpg" in terminal.buffer.getvalue()  # type: ignore[attr-defined]
