"""The golden results, see `results.py`."""

import json
from typing import Any

import pytest

from tests.golden import results


@pytest.fixture(scope="module")
def worlds() -> dict[str, Any]:
    return results.worlds()


def test_explanations_are_the_golden_ones() -> None:
    """To the second digit where sums are rounded alike; elsewhere views and shares alone."""
    expected, actual = json.loads(results.EXPLANATIONS.read_text()), results.explanations()
    assert list(results.view_differences(expected, actual)) == []
    if expected["machine"] == actual["machine"]:
        assert list(results.differences(expected, actual, tolerance=1e-2)) == []


def test_a_wrong_view_is_reported_on_any_processor() -> None:
    right = {"azimuth_deg": 358.0, "elevation_deg": 20.0, "hidden_fraction": 0.2, "confidence": 0.9}
    right |= {"verdict": "trusted", "deviation": {"azimuth_deg": 2.0, "elevation_deg": 1.0}}
    near = right | {"azimuth_deg": 5.5, "elevation_deg": 24.5, "confidence": 0.85}  # 7.5 degrees: under 4 x 2
    assert list(results.view_differences({"pot": right}, {"pot": near})) == []
    wrong = right | {"azimuth_deg": 7.0, "elevation_deg": 25.5, "hidden_fraction": 0.35}
    assert list(results.view_differences({"pot": right}, {"pot": wrong})) == [
        "pot/azimuth_deg: expected 358.0; got 7.0", "pot/elevation_deg: expected 20.0; got 25.5",
        "pot/hidden_fraction: expected 0.2; got 0.35",
    ]  # fmt: skip
    unsure = right | {"verdict": "ambiguous", "alternatives": [{"azimuth_deg": 180.0}]}
    assert list(results.view_differences({"pot": unsure}, {"pot": unsure | {"azimuth_deg": 187.0}})) == []
    assert list(results.view_differences({"pot": right}, {})) == ["expected the photos ['pot']; got []"]


def test_samples_of_the_worlds_are_the_golden_ones(worlds: dict[str, Any]) -> None:
    """Pixels of pictures, masks and depth, labels, scenes and latents."""
    expected = json.loads(results.WORLDS.read_text())
    tolerance = 0.0
    if worlds["machine"] != expected["machine"]:  # another processor or numpy rounds some pixels otherwise
        tolerance = 2e-4  # of a mean image: two in the last digit that it is rounded to
        for world in (*worlds.values(), *expected.values()):
            if isinstance(world, dict):
                del world["shown_sha256"]
        worlds["machine"] = expected["machine"]
    assert list(results.differences(expected, worlds, tolerance)) == []


def test_a_difference_is_reported() -> None:
    expected = {"a": [1.0, {"b": 2}], "c": 3.0}
    assert list(results.differences(expected, {"a": [1.0, {"b": 2}], "c": 3.0001}, 1e-3)) == []
    assert list(results.differences(expected, {"a": [1.5, {"b": 3}], "d": 0}, 1e-3)) == [
        "/a/0: expected 1.0; got 1.5", "/a/1/b: expected 2; got 3", "/c is missing", "/d is new",
    ]  # fmt: skip
