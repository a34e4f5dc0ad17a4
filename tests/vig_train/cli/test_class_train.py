"""`vig class train` from a pack to its card, at a tiny scale."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from tests.toys import toy
from vig import Explainer
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_train.cli import class_train
from vig_train.cli.class_train import STEP_SETTINGS, ClassTraining, train_class
from vig_train.cli.settings import TrainClass
from vig_world.dataset import read_dataset
from vig_world.dataset.format import read_info


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


@pytest.mark.slow
def test_other_settings_do_only_what_depends_on_them_anew(
    pack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With fewer photos, too few of them to calibrate on, neither training photos nor training."""
    other = shutil.copytree(pack, tmp_path / "fin")
    monkeypatch.setattr(ClassTraining, "_train", None)
    train_class(settings(other, photos=3))
    said = capsys.readouterr().out
    anew = "validation photos, test photos, calibration, test"
    assert said.splitlines()[0] == f"other photos than before; done anew: {anew}"
    assert "1/6 training photos: done in" in said and "4/6 training: done in" in said
    assert said.count("done in") == 2
    photos = Path("training/photos/train/files.sha256")
    assert (other / photos).read_bytes() == (pack / photos).read_bytes()
    assert [len(read_dataset(other / "training/photos", split)) for split in ("validation", "test")] == [3, 3]
    assert json.loads((other / "training/test.json").read_text())["photos"] == 3
    assert (other / "calibration.json").read_bytes() != (pack / "calibration.json").read_bytes()


@pytest.mark.parametrize(
    ("changed", "kept"),
    [
        ({"epochs": 2}, {"training photos", "validation photos", "test photos"}),
        ({"images": 90}, {"validation photos", "test photos"}),
        ({"photos": 31, "level": 0.5}, {"training photos"}),
        ({"seed": 1}, set()),
    ],
)
def test_a_change_keeps_the_steps_that_do_not_depend_on_it(
    changed: dict[str, int], kept: set[str], pack: Path, tmp_path: Path
) -> None:
    other = shutil.copytree(pack, tmp_path / "fin")
    record = ClassTraining(settings(other, **changed), ObjectClass.load(other)).record
    assert {step for step in STEP_SETTINGS if record.complete(step)} == kept
    splits = {"training photos": "train", "validation photos": "validation", "test photos": "test"}
    assert read_info(other / "training/photos")["splits"].keys() == {splits[step] for step in kept}
    assert not (other / "training/run").exists()


def test_weights_to_begin_with_are_checked_before_the_work(pack: Path, tmp_path: Path) -> None:
    (tmp_path / "no_weights").write_text("none")
    with pytest.raises(UserError, match="expected recognition weights at '.*no_weights'"):
        train_class(replace(settings(pack), start=tmp_path / "no_weights"))


def test_a_pack_without_weights_names_what_trains_it(tmp_path: Path) -> None:
    toy("fin").save(tmp_path)
    with pytest.raises(UserError, match=f"Train them with `vig class train {tmp_path}`"):
        Explainer(tmp_path)


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
