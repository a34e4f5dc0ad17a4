"""The comparison's pure parts, and our side of it, without any peer."""

import json
import sys

import numpy as np
import pytest

from benchmarks import renderer
from benchmarks.case import make_case
from benchmarks.measuring import interleaved
from benchmarks.peers import INSTALL, Peer


def test_a_ratio_is_the_median_of_the_rounds_ratios() -> None:
    times = {"full_evaluation": np.array([1.0, 1.5, 4.0]), "deodr_gradient": np.array([10.0, 4.5, 20.0])}
    found = {row["name"]: row for row in renderer.metrics_of(times, "_x")}
    assert set(found) == {"full_evaluation_ms_x", "deodr_gradient_ms_x", "full_evaluation_vs_deodr_x"}
    # Rounds of 10, 3 and 5 x: median 5, where the medians' ratio would be 10 / 1.5 = 6.7.
    assert found["full_evaluation_vs_deodr_x"]["value"] == 5.0
    assert found["full_evaluation_vs_deodr_x"]["iqr"] == 3.5
    assert found["full_evaluation_vs_deodr_x"]["better"] == "higher"


def test_where_we_lose_is_listed() -> None:
    def ratio(name: str, value: float) -> dict:
        return {"name": name, "value": value, "unit": "x", "better": "higher", "iqr": 0.0}

    times = {"": 0.5, "_2_threads": 0.7, "_5252_faces_75_px": 0.4, "_5252_faces_75_px_2_threads": 0.3}
    rows = [
        ratio("full_evaluation_vs_deodr", 4.0),
        ratio("full_evaluation_vs_deodr_5252_faces_300_px", 4.0),
        ratio("forward_vs_mitsuba", 0.5),
        ratio("full_evaluation_vs_mitsuba", 120.0),
        *(renderer.measuring.metric(f"full_evaluation_ms{end}", [ms], "ms") for end, ms in times.items()),
    ]
    assert renderer.losses(rows) == [
        "slower than the peer: forward_vs_mitsuba = 0.5",
        "below the bar of 12 x: full_evaluation_vs_deodr = 4.0",
        "below the bar of 150 x: full_evaluation_vs_mitsuba = 120.0",
        "slower on 2 threads than on one: full_evaluation_ms_2_threads = 0.7 against 0.5",
    ]


def test_names_of_the_standard_case_are_plain() -> None:
    standard, other = make_case(150), make_case(75)
    assert renderer.suffix(standard, 1) == ""
    assert renderer.suffix(standard, 2) == "_2_threads"
    assert renderer.suffix(other, 1) == "_5252_faces_75_px"


def test_an_unfair_comparison_is_refused() -> None:
    good = {"ours": np.ones(3), "peer": {"vertices": np.ones(3), "light": np.ones(1)}}
    renderer.check(8000, {"ours": 8000, "peer": 8050}, good)
    with pytest.raises(RuntimeError, match="peer covers 7000 pixels where 8000 are expected"):
        renderer.check(8000, {"ours": 8000, "peer": 7000}, good)
    for bad in (np.zeros(1), np.array([np.nan])):
        with pytest.raises(RuntimeError, match="peer: the gradient of light is zero or not finite"):
            renderer.check(8000, {}, {"peer": {"vertices": np.ones(3), "light": bad}})


def test_a_missing_peer_is_a_line_that_says_how_to_install_it() -> None:
    missing = Peer("Nothing", "no_such_package_of_anyone", "benchmarks.peers.nothing")
    assert missing.available() == f"Nothing is not installed; to compare with it: {INSTALL}"


def test_a_peer_that_does_not_run_is_a_line_with_a_hint() -> None:
    broken = Peer("Broken", "json", "benchmarks.peers.no_such_module", hint="install LLVM")
    line = broken.available()
    assert line.startswith("Broken is installed but does not run here (")
    assert "no_such_module" in line and line.endswith("; try: install LLVM")


def test_without_peers_our_own_times_are_measured() -> None:
    case = make_case(75)
    metrics = renderer.metrics_of(interleaved(renderer.contenders(case, (), 1), 1), "")
    assert [row["name"] for row in metrics] == [
        *("render_forward_ms", "render_gradient_ms"),
        *("forward_ms", "gradient_ms", "full_evaluation_ms"),
    ]
    assert all(row["value"] > 0 for row in metrics)
    printed = renderer.table(case, 1, metrics, "")
    assert printed.splitlines()[0] == f"5252 faces, 75 x 75, {case.covered()} object pixels, 1 thread"
    assert len(printed.splitlines()) == 6


def test_the_command_runs_without_peers(tmp_path, monkeypatch, capsys) -> None:
    missing = Peer("DEODR", "no_such_package_of_anyone", "benchmarks.peers.nothing")
    monkeypatch.setattr(renderer, "DEODR", missing)
    monkeypatch.setattr(renderer, "MITSUBA", missing)
    monkeypatch.setattr(renderer, "SIZES", (75,))
    monkeypatch.setattr(renderer, "SUBDIVISIONS", (0,))
    monkeypatch.setattr(sys, "argv", ["renderer", "--repeats", "1", "--json", str(tmp_path / "out.json")])
    renderer.main()
    output = capsys.readouterr().out
    assert INSTALL in output and "no peer to compare with" in output
    names = [row["name"] for row in json.loads((tmp_path / "out.json").read_text())["metrics"]]
    assert "full_evaluation_ms_5252_faces_75_px" in names
