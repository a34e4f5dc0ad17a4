"""`vig reproduce` as its user types it."""

from __future__ import annotations

from pathlib import Path

import pytest

from vig_app.cli.main import main
from vig_paper.cli.reproduce import SAME_NUMBERS
from vig_paper.settings import Reproduce
from vig_train.cli.common import command_line


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
        (["--scale", "tiny", "--test-images", "0"], "--test-images of at least 1; got 0"),
        (["--scale", "tiny", "--stages", "paint"], "figures"),
        (["--scale", "tiny", "--workers", "0"], "--workers of at least 1; got 0"),
    ],
)
def test_mistakes_are_told_before_anything_is_written(capsys, tmp_path: Path, more, said: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["reproduce", "--out", str(tmp_path / "r"), *more])
    assert ended.value.code == 2 and said in capsys.readouterr().err
    assert not (tmp_path / "r").exists()
