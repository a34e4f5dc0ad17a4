"""The whole of it, from an empty folder to the page, on a handful of photos."""

import contextlib
import io
import json
import shutil
from pathlib import Path

import pytest

from tests.support import contents, differing
from vig_app.cli.main import main
from vig_paper import ablation
from vig_paper.reproduction import work
from vig_paper.settings import ReproductionSettings
from vig_train.evaluation import fits

SETTINGS = (
    *("--scale", "tiny", "--train-images", "24", "--epochs", "1", "--validation-images", "4"),
    *("--test-images", "4", "--ablation-images", "1", "--methods", "baseline", "rm", "robust"),
    *("--seed", "999", "--workers", "1", "--no-cycles"),
)


def reproduce(out: Path, *more: str) -> tuple[int, str, str]:
    """`vig reproduce` with the settings above: exit code, what it printed, what it said of errors."""
    printed, errors = io.StringIO(), io.StringIO()
    with (
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(errors),
        pytest.raises(SystemExit) as ended,
    ):
        main(["reproduce", *SETTINGS, "--out", str(out), *more])
    return int(ended.value.code or 0), printed.getvalue(), errors.getvalue()


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder of a run with a single ablation, and what it printed."""
    out = tmp_path_factory.mktemp("reproduced") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ablation, "ABLATIONS", {"annealing": ablation.ABLATIONS["annealing"]})
        code, printed, errors = reproduce(out)
    assert code == 0, errors
    return out, printed


@pytest.fixture
def copied(finished: tuple[Path, str], tmp_path: Path) -> Path:
    """A copy of the finished run, to be spoiled."""
    return Path(shutil.copytree(finished[0], tmp_path / "run"))


@pytest.mark.slow
def test_a_run_leaves_data_weights_tables_figures_and_a_page(finished: tuple[Path, str]) -> None:
    out, printed = finished
    assert printed.splitlines()[-1] == str(out)
    assert "path-traced photos are left out, as --no-cycles asks" in printed
    held = set(contents(out))
    assert held >= {
        "index.html",
        "run.json",
        "data/train/train/latents.parquet",
        "data/validation/validation/latents.parquet",
        "data/test_raster/test/latents.parquet",
        "recognition/recognition.safetensors",
        "recognition/losses.png",
        "tables/raster/errors.csv",
        "tables/raster/table.json",
        "tables/raster/table.md",
        "tables/ablations.json",
        "tables/ablations.md",
        *(f"figures/raster/{name}.png" for name in ("photos", "figure3", "figure3_bins", "reliability")),
        *(f"figures/raster/{name}" for name in ("figure4.png", "figure5.png", "figure4_worst.png")),
    }
    record = json.loads((out / "run.json").read_text())
    assert all(step["complete"] for step in record["steps"].values())
    assert record["command"].startswith("vig reproduce --scale tiny --train-images 24 ")
    assert record["machine"]["packages"]["torch"] and record["settings"]["seed"] == 999


@pytest.mark.slow
def test_a_second_run_passes_over_everything(finished: tuple[Path, str]) -> None:
    out, first = finished
    before = contents(out)
    code, printed, _ = reproduce(out)
    steps = [line.split(":")[0] for line in first.splitlines() if line.endswith(": begun")]
    assert code == 0 and len(steps) == 9
    assert [line.split(":")[0] for line in printed.splitlines() if ": already done, in " in line] == steps
    assert ": begun" not in printed and not differing(contents(out), before)


@pytest.mark.slow
def test_json_tells_tables_and_the_comparison(finished: tuple[Path, str]) -> None:
    code, printed, _ = reproduce(finished[0], "--json")
    told = json.loads(printed)
    assert code == 0 and told["folder"] == str(finished[0]) and set(told["tables"]) == {"raster"}
    cells = {(cell["metric"], cell["method"]) for cell in told["comparison"]["raster"]}
    assert ("azimuth_deg", "robust") in cells and ("segmentation_iou", "rm") in cells


@pytest.mark.slow
def test_other_settings_are_refused_in_a_line(finished: tuple[Path, str]) -> None:
    before = contents(finished[0])
    code, printed, errors = reproduce(finished[0], "--epochs", "2")
    assert code == 2 and printed == "" and errors.count("\n") == 1
    assert "holds a run with epochs 1; 2 was asked for" in errors
    assert not differing(contents(finished[0]), before)


@pytest.mark.slow
def test_a_stopped_evaluation_goes_on_with_the_fits_it_has(
    copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped when its fits are made and its tables are not; nothing may then be fitted again."""
    shutil.rmtree(copied / "tables" / "raster")
    fewer = ("--stages", "data", "train", "calibrate", "evaluate", "page")

    def stopped(*arguments) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(work, "write_csv", stopped)
        code, _, errors = reproduce(copied, *fewer)
    assert code == 130 and errors.splitlines()[-1] == "vig: interrupted; what is finished stays"

    monkeypatch.setattr(fits, "explain_one", stopped)
    code, printed, _ = reproduce(copied, *fewer)
    assert code == 0
    begun = [line.split(":")[0] for line in printed.splitlines() if line.endswith(": begun")]
    assert begun == ["evaluate raster", "page"]
    record = json.loads((copied / "run.json").read_text())
    assert record["steps"]["evaluate raster"]["sittings"] == 3


@pytest.mark.slow
def test_given_weights_and_photos_are_used(finished: tuple[Path, str], tmp_path: Path) -> None:
    folder, out = finished[0], tmp_path / "other"
    given = ("--weights", folder / "recognition" / "recognition.safetensors")
    given += ("--test-raster", folder / "data" / "test_raster")
    code, printed, errors = reproduce(out, *map(str, given), "--stages", "data", "train", "evaluate")
    assert code == 0, errors
    assert not (out / "data").exists() and "data train" not in printed
    one, other = (json.loads((each / "tables/raster/table.json").read_text()) for each in (folder, out))
    assert one == other


def test_photos_of_the_wrong_renderer_are_refused(finished: tuple[Path, str], tmp_path: Path) -> None:
    run = work.Run(
        work.RunFolder(tmp_path),
        ReproductionSettings.of("tiny", test_cycles=finished[0] / "data/test_raster"),
    )
    with pytest.raises(Exception, match="expected cycles photos in .*; got raster"):
        work.make_data(run, "test_cycles")


def test_without_blender_path_traced_photos_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VIG_BLENDER_PYTHON", str(tmp_path / "nothing"))
    said: list[str] = []
    run = work.Run(work.RunFolder(tmp_path / "r"), ReproductionSettings.of("tiny"), report=said.append)
    assert run.renderers() == ("raster",)
    assert len(said) == 1 and "left out" in said[0] and "VIG_BLENDER_PYTHON" in said[0]
