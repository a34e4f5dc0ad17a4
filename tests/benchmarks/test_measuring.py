"""What the benchmarks share."""

import json
import time

import pytest

from benchmarks import measuring
from benchmarks.measuring import interleaved, metric, report, write


def test_a_metric_is_median_and_interquartile_range() -> None:
    found = metric("fit_ms", [5.0, 1.0, 4.0, 2.0, 3.0], "ms")
    assert found == {"name": "fit_ms", "value": 3.0, "unit": "ms", "better": "lower", "iqr": 2.0}
    assert metric("ratio", [1 / 3], "x", "higher") == {
        "name": "ratio",
        "value": 0.3333,
        "unit": "x",
        "better": "higher",
        "iqr": 0.0,
    }


def test_a_report_names_machine_and_versions_and_survives_json(tmp_path) -> None:
    found = report([metric("a", [1.0], "ms")], threads=1, packages=["pytest"])
    write(found, tmp_path / "new" / "out.json")
    assert json.loads((tmp_path / "new" / "out.json").read_text()) == found
    assert list(found) == ["machine", "versions", "metrics"]
    assert found["machine"]["threads"] == 1 and found["machine"]["processor"]
    assert found["versions"]["pytest"] == pytest.__version__


def test_interleaved_times_are_per_call_and_the_order_turns(monkeypatch) -> None:
    monkeypatch.setattr(measuring, "MIN_SECONDS", 0.0)  # one call of each in a round
    order: list[str] = []

    def sleeper(name: str, seconds: float):
        def call(index: int) -> None:
            assert index in range(measuring.WARM_UP)
            order.append(name)
            time.sleep(seconds)

        return call

    found = interleaved({"short": sleeper("short", 0.002), "long": sleeper("long", 0.01)}, rounds=4)
    assert order[-8:] == ["short", "long", "long", "short"] * 2
    assert found["short"].shape == found["long"].shape == (4,)
    assert found["short"].min() >= 2 and found["long"].min() >= 10


def test_a_fast_function_is_called_many_times_in_a_round(monkeypatch) -> None:
    monkeypatch.setattr(measuring, "MIN_SECONDS", 0.02)
    seen: list[int] = []
    found = interleaved({"fast": seen.append}, rounds=1)
    assert len(seen) > 1000
    assert found["fast"][0] < 0.02  # milliseconds per call, not per round
