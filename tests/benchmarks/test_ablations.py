"""The first photos of a dataset."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import ablations
from vig.dataset import read_dataset
from vig.scene import ObjectClass
from vig_lab.ablation import DEFAULT
from vig_world.generation.write import make_dataset


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, teapot: ObjectClass) -> Path:
    out = tmp_path_factory.mktemp("ablations") / "d"
    return make_dataset(out, 3, 3, split="test", workers=1, progress=False, object_class=teapot)


def test_the_first_samples_keep_their_pictures(made: Path) -> None:
    whole = read_dataset(made, "test")
    part = ablations.first(whole, 2)
    assert len(part) == 2
    np.testing.assert_array_equal(part.images, whole.images[:2])
    np.testing.assert_array_equal(part.visible, whole.visible[:2])
    assert len(ablations.first(whole, 99)) == 3


def test_the_command_writes_what_it_prints(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    def run(
        dataset: Any, object_class: ObjectClass, recognizer: Any, cache: Path, names: Any, *rest: Any
    ) -> Any:
        assert (len(dataset), cache, names) == (2, tmp_path / "r" / "fits", ["cg"])
        return {"variants": {DEFAULT: {}}}

    monkeypatch.setattr(ablations.Recognizer, "of_class", staticmethod(lambda *given: None))
    monkeypatch.setattr(ablations, "run_ablations", run)
    monkeypatch.setattr(ablations, "ablation_markdown", lambda table: f"{len(table['variants'])} row\n")
    out = tmp_path / "r"
    ablations.main(["--dataset", str(made), "--out", str(out), "--count", "2", "--names", "cg"])
    assert (out / "ablations.md").read_text() == "1 row\n" and "1 row" in capsys.readouterr().out
    written = json.loads((out / "ablations.json").read_text())
    assert written["variants"] == {DEFAULT: {}} and "processor" in written["machine"]


def test_a_mistake_is_told_in_a_line(tmp_path: Path) -> None:
    for given in (["--count", "0"], []):
        with pytest.raises(SystemExit, match="benchmarks.ablations: .*expected|no dataset"):
            ablations.main(["--dataset", str(tmp_path), "--out", str(tmp_path / "r"), *given])
