"""`vig train`: which network is trained, for how long."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.support import TEAPOT
from vig.scene.object_class import PACKAGED
from vig_app.cli.main import main
from vig_paper.cli import train as verb
from vig_paper.network.training import PaperTrainingSettings
from vig_train.training.drawing import Drawing
from vig_train.training.training import TrainingSettings

TRUNK = PACKAGED / "teapot" / "recognition.safetensors"


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ([], TrainingSettings(drawing=Drawing(TEAPOT, 24), start=TRUNK, trunk_only=True)),
        (
            ["--epochs", "3", "--seed", "4", "--studio", "0", "--start", "other.safetensors"],
            TrainingSettings(epochs=3, seed=4, start=Path("other.safetensors")),
        ),
        (
            ["--studio", "8", "--workers", "2"],
            TrainingSettings(drawing=Drawing(TEAPOT, 8, workers=2), start=TRUNK, trunk_only=True),
        ),
        (["--net", "paper"], PaperTrainingSettings()),
        (["--net", "paper", "--epochs", "3", "--seed", "4"], PaperTrainingSettings(epochs=3, seed=4)),
    ],
)
def test_each_net_is_trained_with_its_own_defaults(
    given: list[str], expected: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    seen: list[tuple[str | list[str], object]] = []

    def training(kind: str) -> Any:
        def trained(datasets: str | list[str], out: Path, settings: object, say: Any, *clock: bool) -> Path:
            assert clock == (() if kind == "paper" else (True,))
            seen.append((datasets, settings))
            say(f"{kind}: epoch 1")
            return out / "recognition.safetensors"

        return trained

    monkeypatch.setattr(verb, "read_dataset", lambda folder, split: f"{folder.name} {split}")
    monkeypatch.setattr(verb, "train_network", training("vig"))
    monkeypatch.setattr(verb, "train_paper", training("paper"))
    with pytest.raises(SystemExit) as ended:
        main(["train", "--class", str(TEAPOT), "--dataset", "D", "--out", str(tmp_path / "w"), *given])
    kind = "paper" if "paper" in given else "vig"
    assert ended.value.code == 0 and seen == [("D train" if kind == "paper" else ["D train"], expected)]
    lines = capsys.readouterr().out.splitlines()
    assert lines == [f"{kind}: epoch 1", str(tmp_path / "w/recognition.safetensors"), str(tmp_path / "w")]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--dataset", "D", "E", "--net", "paper"], "--net paper learns from one dataset; got 2. Give one."),
        (["--dataset"], "expected at least one dataset"),
    ],
)
def test_a_number_of_datasets_that_cannot_be_is_told(
    given: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setattr(verb, "read_dataset", lambda folder, split: f"{folder.name} {split}")
    with pytest.raises(SystemExit) as ended:
        main(["train", *given, "--out", str(tmp_path / "w")])
    assert ended.value.code == 2 and said in capsys.readouterr().err


def test_several_datasets_are_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[list[str]] = []
    monkeypatch.setattr(verb, "read_dataset", lambda folder, split: f"{folder.name} {split}")
    monkeypatch.setattr(verb, "train_network", lambda datasets, out, *rest: seen.append(datasets) or out)
    with pytest.raises(SystemExit) as ended:
        main(["train", "--dataset", "D", "E", "--out", str(tmp_path / "w")])
    assert ended.value.code == 0 and seen == [["D train", "E train"]]
