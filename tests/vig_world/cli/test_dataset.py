"""`vig dataset VERB` as its user meets it."""

import json
import shutil
from pathlib import Path

import pytest
from PIL import Image

from tests.support import run_vig


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of `vig dataset ...`."""
    code = run_vig("dataset", *arguments)
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    return code, out, err


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("cli") / "d"
    arguments = ["--out", out, "--count", 6, "--split", "test", "--workers", 1, "--json"]
    assert run_vig("dataset", "make", *arguments) == 0
    return out


def test_make_ends_with_deciles_rejections_and_the_folder(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, "make", "--count", 3, "--workers", 1)
    hidden, rejected, folder = out.splitlines()
    assert code == 0 and folder == "vig-dataset" and (tmp_path / folder / "info.json").is_file()
    assert hidden.startswith("hidden    0-10%: ") and "90-100%: 0" in hidden
    assert rejected.startswith("redrawn  ") and "placements a sample, before one suited" in rejected
    progress, made = err.splitlines()[-2:]
    assert progress.startswith("3 of 3 samples")
    assert made.startswith("vig: made a dataset: vig dataset show vig-dataset")


def test_pictures_have_the_size_that_was_asked_for(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "d"
    code, *_ = run(capsys, "make", "--out", out, "--count", 1, "--workers", 1, "--size", "96x64", "--normals")
    assert code == 0
    for kind in ("rgb/000000", "depth/000000", "normal/000000", "mask/000000_000000"):
        assert Image.open(out / "train/000000" / f"{kind}.png").size == (96, 64)


@pytest.mark.parametrize("size", ["640", "abc", "0x0", "10x10", "99999x1", "-5x3", "640x480x3", ""])
def test_a_size_that_is_none_is_told_in_one_line(
    size: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, out, err = run(capsys, "make", "--out", tmp_path / "d", "--count", 1, f"--size={size}")
    assert (code, out, err.count("\n")) == (2, "", 1) and f"got {size}" in err.replace("'", "")
    assert "640x480" in err and not (tmp_path / "d").exists()


def test_json_is_one_object_and_nothing_else(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, out, err = run(capsys, "make", "--out", tmp_path / "d", "--count", 3, "--workers", 1, "--json")
    told = json.loads(out)
    assert code == 0 and err == ""
    assert sum(told["occlusion_deciles"]) == 3
    assert told["folder"] == str(tmp_path / "d")


def test_check_is_0_when_clean_and_1_when_not(
    capsys: pytest.CaptureFixture[str], made: Path, tmp_path: Path
) -> None:
    code, out, err = run(capsys, "check", made, "--render", 1)
    assert code == 0 and err == "vig: checked: it is as it was made\n"
    assert out.splitlines() == ["test: 6 samples, 29 files, 1 rendered again: clean", str(made)]
    copy = shutil.copytree(made, tmp_path / "copy")
    for picture in (copy / "test" / "000000").rglob("*.png"):
        picture.unlink()
    code, out, err = run(capsys, "check", copy)
    assert err.startswith("vig: checked: it is not as it was made")
    lines = out.splitlines()
    assert code == 1 and lines[-2:] == ["test: 6 samples, 29 files: 12 problems", str(copy)]
    assert all("No such file" in line or "unreadable picture" in line for line in lines[:-2])
    code, out, _ = run(capsys, "check", copy, "--json")
    assert code == 1 and not json.loads(out)["clean"]


def test_show_takes_the_split_that_is_there(
    capsys: pytest.CaptureFixture[str], made: Path, tmp_path: Path
) -> None:
    code, out, err = run(capsys, "show", made, "--count", 4, "--out", tmp_path)
    names = ["contact-sheet-test.png", "histograms-test.png"]
    assert code == 0 and err == f"vig: drawn: open {tmp_path / names[0]}, and {names[1]} beside it\n"
    assert out.splitlines() == [str(tmp_path / name) for name in names] + [str(tmp_path)]
    assert all((tmp_path / name).stat().st_size > 10_000 for name in names)


@pytest.mark.parametrize(
    ("to", "written"),
    [
        ("coco", "annotations/amodal_test.json"),
        ("coco-keypoints", "annotations/keypoints_test.json"),
        ("yolo-pose", "labels/test/000005.txt"),
        ("webdataset", "test-000000.tar"),
    ],
)
def test_export_writes_and_prints_its_folder(
    to: str,
    written: str,
    capsys: pytest.CaptureFixture[str],
    made: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, "export", made, "--to", to)
    assert (code, out) == (0, f"d-{to}\n") and err.startswith("vig: exported: ") and err.count("\n") == 1
    assert (tmp_path / f"d-{to}" / written).is_file()


@pytest.mark.parametrize("verb", ["check", "show"])
def test_what_is_no_dataset_is_told_in_one_line(
    verb: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, out, err = run(capsys, verb, tmp_path)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1 and str(tmp_path) in err
