"""What a script is answered: one JSON object on standard output, and the exit codes of docs/api.md."""

import ast
import json
import re
import shutil
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from tests.support import TEAPOT, run_vig
from vig.scene.object_class import PACKAGED
from vig_app.cli import main as module
from vig_app.cli.common import ExitCode, verbs_of_packages
from vig_app.cli.main import VERBS
from vig_app.cli.options import FitCommand, RunOptions
from vig_app.examples import example_photos

EVERY = (*VERBS, *verbs_of_packages())
PAGE = (Path(__file__).parents[3] / "docs" / "api.md").read_text()
VIG = (sys.executable, "-c", "from vig_app.cli.main import main; main()")


@pytest.fixture
def told(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, dict[str, Any], str]]:
    """Exit code, the one object on standard output, and standard error of a command with --json."""

    def run(*arguments: object) -> tuple[int, dict[str, Any], str]:
        code = run_vig(*arguments, "--json")
        out, err = capsys.readouterr()
        return code, json.loads(out), err

    return run


def keys_of(verb: str) -> set[str]:
    """Keys that the page has of a verb's object, other than those within its words."""
    (row,) = re.findall(rf"^\| `{verb}` \| (.*) \|$", PAGE, re.MULTILINE)
    return set(re.findall(r"`(\w+)`", row.partition(". With")[0]))


def test_only_verbs_print_to_standard_output() -> None:
    """What a verb calls reports through what it is given, or on standard error."""
    source = Path(__file__).parents[3] / "src"
    printing = set()
    for path in sorted(source.rglob("*.py")):
        tree = ast.parse(path.read_text())
        verbs_alone = "cli" in path.parts or path.relative_to(source).as_posix() == "vig/io/printing.py"
        ends_command = re.search(r"from vig\.io\.printing import .*\bend\b", path.read_text())
        assert verbs_alone or not ends_command, f"{path} is no verb"
        if "cli" in path.parts or "__main__" in path.name:
            continue
        scripts = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "main"]
        of_scripts = {id(node) for script in scripts for node in ast.walk(script)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
                named = {keyword.arg for keyword in node.keywords}
                if id(node) not in of_scripts and "file" not in named:
                    printing.add(path.relative_to(source).as_posix())
    # What verbs alone import; the default of `say`, in place of which verbs give their own; a program.
    expected = {"vig/io/printing.py", "vig_train/class_training/steps.py", "vig_native/processor.py"}
    assert printing == expected


@pytest.mark.parametrize("verb", EVERY, ids=lambda verb: verb.name)
def test_every_verb_has_json_and_a_row_of_the_page(verb: Any) -> None:
    group = RunOptions if verb.settings is FitCommand else verb.settings
    assert group.__dataclass_fields__["json"].default is False
    assert f"| `{verb.name}` |" in PAGE


def test_the_page_has_the_exit_codes() -> None:
    codes = re.findall(r"^\| (\d+) \|", PAGE, re.MULTILINE)
    assert [int(code) for code in codes] == list(ExitCode)


def test_photos_explained_and_not(told: Callable[..., Any], tmp_path: Path) -> None:
    photo, bad, out = tmp_path / "photo.png", tmp_path / "bad.png", tmp_path / "out"
    shutil.copy(example_photos()[0].photo, photo)
    bad.write_bytes(b"no picture")
    code, result, _ = told("fit", photo, bad, "--out", out)
    assert code == ExitCode.INCOMPLETE and set(result) <= keys_of("fit")
    assert list(result["results"]) == [str(photo)] and "expected a photo" in result["errors"][str(bad)]
    code, result, _ = told("fit", photo, "--out", out, "--files", "mask.png")
    assert code == ExitCode.DONE and result["errors"] == {} and result["folder"] == str(out)
    code, result, _ = told("fit", bad, "--out", out)
    assert code == ExitCode.MISTAKE and result["results"] == {} and list(result["errors"]) == [str(bad)]


def test_mistakes_are_an_object(told: Callable[..., Any], tmp_path: Path) -> None:
    missing = tmp_path / "missing"
    for arguments in (
        ("fit", "--out", tmp_path / "o"),
        ("fit", "photo.png", "--no-such-option"),
        ("export", missing, "--to", "bop"),
        ("view", missing),
        ("schema", "photo"),
        ("class", "build", missing, "--out", tmp_path / "pack"),
        ("class", "train", missing),
        ("class", "check", TEAPOT, missing),
        ("dataset", "make", "--out", tmp_path / "d", "--count", 0),
        ("dataset", "check", missing),
        ("dataset", "show", missing),
        ("dataset", "export", missing, "--to", "coco", "--out", tmp_path / "c"),
        ("train", "--dataset", missing, "--out", tmp_path / "t"),
        ("calibrate", missing, "--weights", missing),
        ("evaluate", "--dataset", missing, "--out", tmp_path / "e"),
        ("reproduce", "--scale", "tiny", "--out", tmp_path / "r", "--workers", 0),
    ):
        code, result, err = told(*arguments)
        assert (code, list(result)) == (ExitCode.MISTAKE, ["error"]), (arguments, err)
        assert "Traceback" not in err and len(result["error"].splitlines()) == 1
    assert not (tmp_path / "pack").exists() and not (tmp_path / "t").exists()


def test_verbs_of_datasets(told: Callable[..., Any], tmp_path: Path) -> None:
    made = tmp_path / "d"
    code, result, err = told("dataset", "make", "--out", made, "--count", 2, "--workers", 1)
    assert code == ExitCode.DONE and result["folder"] == str(made) and err == ""
    for name, more in (
        ("check", (made,)),
        ("show", (made,)),
        ("export", (made, "--to", "coco", "--out", tmp_path / "coco")),
    ):
        code, result, _ = told("dataset", name, *more)
        assert code == ExitCode.DONE and keys_of(f"dataset {name}") - {"json"} <= {*result, "info"}, name
    next(made.rglob("rgb/*.png")).unlink()
    code, result, _ = told("dataset", "check", made)
    assert code == ExitCode.INCOMPLETE and not result["clean"]


def test_the_report_of_doctor(told: Callable[..., Any]) -> None:
    code, result, _ = told("doctor")
    parts = {*result["speed"][0], *result["extras"]["video"]}
    assert code == ExitCode.DONE and {*result, *parts} == keys_of("doctor")


def test_a_class_that_does_not_work_is_doctors_exit_code(
    told: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    shutil.copytree(PACKAGED / "car", tmp_path / "car")
    (tmp_path / "car" / "recognition.safetensors").unlink()
    monkeypatch.setattr("vig.scene.object_class.PACKAGED", tmp_path)
    assert told("doctor")[0] == ExitCode.INCOMPLETE


def test_the_schema(told: Callable[..., Any]) -> None:
    code, result, _ = told("schema", "explanation")
    assert code == ExitCode.DONE and "Explanation" in result["$defs"]


def test_faults_and_interruptions_have_exit_codes(told: Callable[..., Any], monkeypatch) -> None:
    """And a fault a traceback."""
    raised: list[BaseException] = [KeyboardInterrupt(), RuntimeError("no such\nkernel")]

    def broken(self: object, settings: object) -> int:
        raise raised.pop()

    monkeypatch.setattr(module.Verb, "run", broken)
    code, result, err = told("doctor")
    assert code == ExitCode.FAULT and "Traceback" in err and "RuntimeError: no such kernel" in result["error"]
    code, result, _ = told("doctor")
    assert code == ExitCode.INTERRUPTED and result["error"].startswith("interrupted")


def test_the_address_of_a_page_in_a_container(tmp_path: Path) -> None:
    photo = tmp_path / "photo.png"
    Image.open(example_photos()[0].photo).save(photo)
    command = [*VIG, "view", str(photo), "--no-open", "--port", "8533", "--host", "0.0.0.0", "--json"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        served = json.loads(process.stdout.readline())
        assert set(served) == keys_of("view") and served["folder"] == "vig-fit/photo"
        # Another address of this machine, which Linux has without a network.
        other = served["address"].replace(
            "127.0.0.1", "127.0.0.2" if sys.platform == "linux" else "127.0.0.1"
        )
        for address in (served["address"], other):
            with urllib.request.urlopen(address, timeout=20) as answer:
                assert answer.status == 200
        process.send_signal(signal.SIGINT)
        assert process.stdout.read() == "" and process.wait(20) == ExitCode.DONE
