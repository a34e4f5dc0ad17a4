"""`vig class train` from a pack to its card, at a tiny scale."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.toys import toy
from vig import Explainer
from vig.errors import UserError
from vig_lab.cli import class_train
from vig_lab.cli.class_train import ClassTraining, train_class
from vig_lab.cli.settings import TrainClass
from vig_world.dataset import read_dataset


def settings(pack: Path, **chosen: int) -> TrainClass:
    small = {"images": 80, "epochs": 1, "studio": 2, "photos": 30, "workers": 1}
    return TrainClass(pack, **small | chosen)


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pack whose training was interrupted before the calibration, and gone on with."""
    folder = tmp_path_factory.mktemp("packs") / "fin"
    folder.mkdir()
    toy("fin").save(folder)

    def stop(training: ClassTraining) -> None:
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ClassTraining, "_calibrate", stop)
        with pytest.raises(KeyboardInterrupt):
            train_class(settings(folder))
        assert not (folder / "recognition.safetensors").exists(), "no weights that are not calibrated"
        patch.undo()
        patch.setattr(ClassTraining, "_train", stop)  # what is done is not done again
        train_class(settings(folder))
    return folder


def test_the_pack_explains_photos(pack: Path) -> None:
    photos = read_dataset(pack / "training" / "photos", "test")
    explanation = Explainer(pack).explain(photos.images[0], box=(30, 30, 90, 90))
    assert 0 <= explanation.confidence <= 1


def test_the_card_has_the_errors_that_were_measured(pack: Path) -> None:
    found = json.loads((pack / "training" / "test.json").read_text())
    text = (pack / "card.md").read_text()
    assert found["photos"] == 30 and set(found["methods"]) == {"network", "fit"}
    assert f"{found['methods']['fit']['azimuth_deg']:.1f} degrees" in text
    assert "rooms, lights and views that the training never saw" in text
    for picture in ("build/8-photos.png", "reliability.png"):
        assert (pack / picture).exists() and picture in text


def test_what_is_done_is_not_done_again(
    pack: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = (pack / "card.md").read_bytes()
    monkeypatch.setattr(class_train, "make_dataset", None)
    train_class(settings(pack))
    assert capsys.readouterr().out.count("done in") == 6
    assert (pack / "card.md").read_bytes() == before


def test_a_training_of_other_settings_is_not_gone_on_with(pack: Path) -> None:
    with pytest.raises(UserError, match="holds a run with images 80; 90 was asked for"):
        train_class(settings(pack, images=90))


@pytest.mark.parametrize(
    "chosen, said",
    [
        ({"images": 79}, "--images of at least 80; got 79"),
        ({"epochs": 0}, "--epochs of at least 1; got 0"),
        ({"photos": 0}, "--photos of at least 1; got 0"),
        ({"workers": 0}, "--workers of at least 1; got 0"),
        ({"studio": -1}, "at least 0"),
        ({"level": 35}, "--level as a share from 0 to 1; got 35"),
    ],
)
def test_wrong_settings_get_one_line(pack: Path, chosen: dict[str, int], said: str) -> None:
    with pytest.raises(UserError, match=said):
        train_class(settings(pack, **chosen))


def test_a_folder_without_a_pack_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for given in (tmp_path, Path("mug")):
        with pytest.raises(UserError, match="expected"):
            train_class(settings(given))
    assert not any(tmp_path.iterdir())
