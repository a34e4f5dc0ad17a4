"""The three scales, and numbers that make no run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from vig.io.errors import UserError
from vig_paper.reproduction import SCALES, ReproductionSettings
from vig_train import METHODS


def test_the_papers_counts() -> None:
    """PAPER: 10,000 for training, 1,000 for test, in both tiers the same scenes."""
    paper = SCALES["paper"]
    assert (paper.train_images, paper.test_images, paper.cycles_images) == (10000, 1000, 1000)
    assert paper.methods == METHODS and paper.net == "vig"


def test_what_is_not_chosen_is_the_scales() -> None:
    settings = ReproductionSettings.of("small", epochs=3, seed=None)
    assert settings.epochs == 3 and settings.seed == 0
    assert settings.train_images == SCALES["small"].train_images and settings.scale == "small"


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
