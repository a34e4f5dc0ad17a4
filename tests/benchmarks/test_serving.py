"""The load test of the server, in short."""

import json
from pathlib import Path

import pytest

pytest.importorskip("fastapi")

from benchmarks.serving import main


@pytest.mark.slow
def test_a_short_load_loses_nothing_and_no_nonsense_is_a_fault(tmp_path: Path) -> None:
    found = main(
        ["--seconds", "2", "--clients", "3", "--nonsense", "40", "--json", str(tmp_path / "load.json")]
    )
    metrics = {each["name"]: each["value"] for each in found["metrics"]}
    assert metrics["requests_per_s"] > 0 and metrics["lost"] == metrics["nonsense_unanswered_or_5xx"] == 0
    assert json.loads((tmp_path / "load.json").read_text()) == found
