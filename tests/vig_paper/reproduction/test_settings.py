"""The three scales, and numbers that make no run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from vig.io.errors import UserError
from vig_paper.settings import ReproductionSettings


def test_what_is_not_chosen_is_the_scales() -> None:
    """PAPER: 10,000 for training, 1,000 for test, by both renderers the same scenes."""
    paper = ReproductionSettings.of("paper", epochs=3)
    counts = paper.train_images, paper.test_images, paper.cycles_images, paper.epochs, paper.seed
    assert counts == (10000, 1000, 1000, 3, 0)
    assert ReproductionSettings.of("small").epochs == 12


def test_settings_are_json() -> None:
    told = ReproductionSettings.of("tiny", weights=Path("w") / "x").to_json()
    assert json.loads(json.dumps(told)) == told and told["weights"] == str(Path("w") / "x")


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"train_images": 15}, "--train-images of at least 16; got 15"),
        ({"test_images": 0}, "--test-images of at least 1; got 0"),
        ({"epochs": 0}, "--epochs of at least 1; got 0"),
        ({"seed": -1}, "--seed of at least 0; got -1"),
        ({"methods": ()}, "got none"),
        ({"methods": ("rm", "magic")}, "got magic"),
    ],
)
def test_numbers_out_of_range_are_refused(wrong, said: str) -> None:
    with pytest.raises(UserError, match=said):
        ReproductionSettings.of("tiny", **wrong)
