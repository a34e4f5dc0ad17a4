"""The golden results, see `results.py`."""

import json
from typing import Any

import pytest

from tests.golden import results


@pytest.fixture(scope="module")
def worlds() -> dict[str, Any]:
    return results.worlds()


def test_explanations_are_the_golden_ones() -> None:
    """Sums in another order, as other processors form them, change digits beyond the third."""
    expected = json.loads(results.EXPLANATIONS.read_text())
    assert list(results.differences(expected, results.explanations(), tolerance=1e-2)) == []


def test_samples_of_the_worlds_are_the_golden_ones(worlds: dict[str, Any]) -> None:
    """The manifest names the SHA-256 of every file: of pictures, masks, depth, labels, scenes and latents."""
    expected = json.loads(results.WORLDS.read_text())
    if worlds["machine"] != expected["machine"]:  # another processor or numpy rounds some pixels otherwise
        for world in (*worlds.values(), *expected.values()):
            if isinstance(world, dict):
                del world["manifest_sha256"]
        worlds["machine"] = expected["machine"]
    assert list(results.differences(expected, worlds, tolerance=0.0)) == []


def test_a_difference_is_reported() -> None:
    expected = {"a": [1.0, {"b": 2}], "c": 3.0}
    assert list(results.differences(expected, {"a": [1.0, {"b": 2}], "c": 3.0001}, 1e-3)) == []
    assert list(results.differences(expected, {"a": [1.5, {"b": 3}], "d": 0}, 1e-3)) == [
        "/a/0: expected 1.0; got 1.5", "/a/1/b: expected 2; got 3", "/c is missing", "/d is new",
    ]  # fmt: skip
