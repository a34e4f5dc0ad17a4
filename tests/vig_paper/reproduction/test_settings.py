"""The three scales, numbers that make no run, and `vig reproduce` as its user types it."""

import json
from pathlib import Path

import pytest

from tests.support import run_vig
from vig.io.errors import UserError
from vig_paper.cli.reproduce import SAME_NUMBERS
from vig_paper.settings import Reproduce, ReproductionSettings
from vig_train.cli.common import command_line


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


def test_the_command_tells_all_that_changes_numbers() -> None:
    chosen = Reproduce(
        "tiny", epochs=3, methods=("rm", "robust"), out=Path("my run"), no_cycles=True, workers=2
    )
    expected = "vig reproduce --scale tiny --epochs 3 --methods rm robust --out 'my run' --no-cycles"
    assert command_line("vig reproduce", chosen, skipped=SAME_NUMBERS) == expected


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--scale", "huge"], "tiny"),
        (["--scale", "tiny", "--stages", "paint"], "figures"),
        (["--scale", "tiny", "--workers", "0"], "--workers of at least 1; got 0"),
    ],
)
def test_mistakes_are_told_before_anything_is_written(capsys, tmp_path: Path, more, said: str) -> None:
    assert run_vig("reproduce", "--out", tmp_path / "r", *more) == 2 and said in capsys.readouterr().err
    assert not (tmp_path / "r").exists()
