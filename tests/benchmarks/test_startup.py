"""Times of single commands: their arguments and what becomes of the measurements."""

import os
from pathlib import Path

import pytest

from benchmarks.startup import COLD_RUNS, WARM_RUNS, arguments_of, metrics_of, processor_seconds


def test_runs_and_file_can_be_chosen() -> None:
    assert vars(arguments_of([])) == {"json": None, "warm": WARM_RUNS, "cold": COLD_RUNS}
    found = arguments_of(["--warm", "3", "--cold", "1", "--json", "x.json"])
    assert vars(found) == {"json": Path("x.json"), "warm": 3, "cold": 1}


@pytest.mark.parametrize("option", ["--warm", "--cold"])
def test_no_runs_are_refused(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        arguments_of([option, "0"])
    assert "at least one run of each; got" in capsys.readouterr().err


def test_the_value_is_the_minimum() -> None:
    warm, cold = metrics_of({"fit_warm_s": [3.0, 1.23456, 2.0], "fit_cold_s": [9.0]})
    assert warm == {"name": "fit_warm_s", "value": 1.235, "unit": "s", "better": "lower", "iqr": 0.8827}
    assert cold["value"] == 9.0


def test_a_command_that_fails_is_not_measured() -> None:
    with pytest.raises(RuntimeError, match="vig paint ended with 2: "):
        processor_seconds(["paint"], os.environ)
