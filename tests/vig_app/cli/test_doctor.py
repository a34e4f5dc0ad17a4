import json
import platform
import re
import shutil
from pathlib import Path

import pytest

import vig
from vig.scene.object_class import PACKAGED
from vig_app.cli import doctor as module
from vig_app.cli import speed
from vig_app.cli.common import Doctor
from vig_app.cli.doctor import doctor, report_lines, run_doctor


def test_the_report_is_ready_for_json_and_the_renderer_draws_the_triangle() -> None:
    report = doctor()
    assert json.loads(json.dumps(report)) == report
    assert report["vig"] == vig.__version__ and report["packages"]["torch"] and report["cpus"] >= 1
    assert report["renderer"]["detail"].startswith("171 of 171 pixels")
    assert report["ok"] is True


def test_text_and_json_say_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_doctor(Doctor(json=True)) == 0
    report = json.loads(capsys.readouterr().out)
    assert run_doctor(Doctor()) == 0
    text = capsys.readouterr().out
    assert report["architecture"] == platform.machine()
    assert re.search(rf"^architecture +{report['architecture']}$", text, re.MULTILINE)
    assert re.search(rf"^processor +{report['cpus']} x ", text, re.MULTILINE)
    for value in (report["python"], report["packages"]["numpy"], "renderer", "ok: 171 of 171"):
        assert value in text


def test_a_renderer_that_fails_is_a_line_and_an_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*arguments):
        raise RuntimeError("no kernel\nfor this machine")

    monkeypatch.setattr("vig.renderer.drawing.draw_mesh", broken)
    assert run_doctor(Doctor()) == 1
    assert "NOT OK: failed: RuntimeError: no kernel for this machine" in capsys.readouterr().out


def test_a_missing_package_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vig.io.machine.PACKAGES", ("torch", "no-such-package"))
    report = doctor()
    assert report["instruction_set"] in ("avx512", "avx2", "plain")
    assert report["packages"]["no-such-package"] is None
    assert "not installed" in report_lines(report)


def test_missing_weights_are_a_line_and_an_exit_code(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert module.check_classes() == {"car": "ok", "mug": "ok", "teapot": "ok"}
    shutil.copytree(PACKAGED / "teapot", tmp_path / "teapot")
    (tmp_path / "teapot" / "recognition.safetensors").unlink()
    monkeypatch.setattr("vig.scene.object_class.PACKAGED", tmp_path)
    assert run_doctor(Doctor()) == 1
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("class teapot")]
    assert "failed: UserError" in line and "recognition.safetensors" in line


def test_the_cache_is_measured_and_removed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kept = tmp_path / "other"
    kept.mkdir()
    (tmp_path / "vig" / "world-1").mkdir(parents=True)
    (tmp_path / "vig" / "world-1" / "mesh").write_bytes(bytes(60_000_000))
    monkeypatch.setattr(speed, "LARGE_CACHE", 50_000_000)
    assert speed.cache_state().state.startswith("60 MB") and "--clean" in speed.cache_state().do
    assert run_doctor(Doctor(clean=True)) == 0
    assert "removing the cache: 60 MB" in capsys.readouterr().err
    assert kept.exists() and not (tmp_path / "vig").exists()
