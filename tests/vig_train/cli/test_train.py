"""`vig train`: which network is trained, for how long."""

from pathlib import Path
from typing import Any

import pytest
import torch

from tests.support import TEAPOT, in_this_process, run_vig
from vig.io.checks import read_tensors
from vig.recognition import NetworkSettings, Recognizer
from vig.scene.object_class import PACKAGED
from vig_train.cli import train as verb
from vig_train.cli.train import CONTEXT
from vig_train.training import drawing
from vig_train.training.drawing import Drawing
from vig_train.training.training import TrainingSettings
from vig_world.studio.studio import StudioSettings

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
            "--studio 8 --distinct 16 --batch 9 --occluded 0.75 --absent 0.25 --frozen 5 --rate 5e-4".split(),
            TrainingSettings(
                batch=9,
                drawing=Drawing(TEAPOT, 8, 16, studio=StudioSettings(occluded=0.75, absent=0.25)),
                start=TRUNK,
                trunk_only=True,
                frozen=5,
                learning_rate=5e-4,
            ),
        ),
        (
            ["--studio", "0", "--mask-alone", "--start", "other.safetensors"],
            TrainingSettings(
                start=Path("other.safetensors"), mask_alone=True, network=NetworkSettings(context=CONTEXT)
            ),
        ),
        (
            ["--studio", "8", "--workers", "2"],
            TrainingSettings(drawing=Drawing(TEAPOT, 8, workers=2), start=TRUNK, trunk_only=True),
        ),
    ],
)
def test_the_network_is_trained_as_asked(
    given: list[str], expected: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    seen: list[tuple[list[str], object]] = []

    def trained(
        datasets: list[str], out: Path, settings: object, report: Any, record: Any, progress: bool
    ) -> Path:
        assert progress and record.__self__.folder == out, "its losses are logged beside the weights"
        seen.append((datasets, settings))
        report("epoch 1")
        return out / "recognition.safetensors"

    monkeypatch.setattr(verb, "read_dataset", lambda folder, split: f"{folder.name} {split}")
    monkeypatch.setattr(verb, "train_network", trained)
    assert run_vig("train", "--class", TEAPOT, "--dataset", "D", "--out", tmp_path / "w", *given) == 0
    assert seen == [(["D train"], expected)]
    output, weights = capsys.readouterr(), tmp_path / "w/recognition.safetensors"
    assert output.out.splitlines() == ["epoch 1", str(weights), str(tmp_path / "w")]
    assert output.err.startswith("vig: trained: next, vig calibrate ") and str(weights) in output.err


def test_no_dataset_is_refused(tmp_path: Path, capsys: Any) -> None:
    assert run_vig("train", "--dataset", "--out", tmp_path / "w") == 2
    assert "expected at least one dataset" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (["--level", "1.5"], "expected --level from 0 to 1; got 1.5"),
        (["--occluded", "-0.1"], "expected --occluded from 0 to 1; got -0.1"),
        (["--absent", "nan"], "expected --absent from 0 to 1; got nan"),
        (["--distinct", "-1"], "expected --distinct of at least 0; got -1"),
        (["--distinct", "8"], "expected --distinct of as many images as a step takes, 24, or more; got 8"),
        (["--batch", "0"], "expected --batch of at least 1; got 0"),
        (["--mask-alone"], "expected --start with --mask-alone"),
        (["--map-alone"], "expected --start with --map-alone"),
        (["--others", "mug"], "expected --map-alone and --distinct with --others"),
        (
            "--map-alone --start S --distinct 60 --studio 0".split(),
            "expected --studio above 0 with --map-alone and --distinct",
        ),
        (
            "--map-alone --start S --distinct 60 --others mug teapot".split(),
            "expected --others that are not 'teapot' itself",
        ),
        ("--map-alone --start S --epochs 5".split(), "expected --map-alone without --epochs"),
        ("--map-alone --start S --rate 0.01".split(), "expected --map-alone without --rate"),
        ("--map-alone --start S --frozen 5".split(), "expected --map-alone without --frozen"),
        (["--mask-alone", "--map-alone", "--start", "S"], "expected --mask-alone or --map-alone; got both"),
        (["--frozen", "6"], "expected --frozen from 0 to 5; got 6"),
        (["--workers", "0"], "expected --workers of at least 1; got 0"),
        (["--studio", "0", "--props", "P"], "expected --studio above 0 with --props"),
        (["--rate", "0"], "expected --rate from 1e-06 to 0.1; got 0"),
    ],
)
def test_numbers_out_of_range_are_told(
    given: list[str], expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setattr(verb, "read_dataset", lambda folder, split: f"{folder.name} {split}")
    assert run_vig("train", "--dataset", "D", "--out", tmp_path / "w", *given) == 2
    assert expected in capsys.readouterr().err
    assert not (tmp_path / "w").exists()


def test_a_map_is_added_to_weights_of_which_the_rest_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of images of the studio alone, which the folder keeps; the map of before goes."""
    start, out = TRUNK, tmp_path / "w"
    monkeypatch.setattr(verb, "MAP_PICTURES", 16)
    monkeypatch.setattr(drawing, "map_in_processes", in_this_process)
    given = ["--studio", "8", "--distinct", "24", "--map-alone", "--start", str(start), "--out", str(out)]
    given += ["--others", "mug"]
    assert run_vig("train", "--class", TEAPOT, "--dataset", "--json", *given) == 0
    (before, _), (after, metadata) = (read_tensors(path, "pt") for path in (start, out / start.name))
    assert "object_map" in metadata["settings"] and before.keys() == after.keys()
    changed = {name for name in before if not torch.equal(before[name], after[name])}
    head = {"network.others.weight", "network.others.bias"}
    assert head < changed and all(name.startswith("network.object_map.") for name in changed - head)
    assert torch.equal(*(each["network.others.weight"][0] for each in (before, after)))  # the roll's
    Recognizer(out / start.name)


def test_several_datasets_are_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[list[str]] = []
    monkeypatch.setattr(verb, "read_dataset", lambda folder, split: f"{folder.name} {split}")
    monkeypatch.setattr(verb, "train_network", lambda datasets, out, *rest: seen.append(datasets) or out)
    assert run_vig("train", "--dataset", "D", "E", "--out", tmp_path / "w") == 0
    assert seen == [["D train", "E train"]]
