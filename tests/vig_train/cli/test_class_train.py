"""`vig class train` from a pack to its card, at a tiny scale."""

import json
import re
import shutil
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from tests.source_meshes import two_boxes
from tests.support import in_this_process
from tests.toys import toy
from vig import Explainer
from vig.io.checks import read_tensors
from vig.io.errors import UserError
from vig.parallel import map_in_processes
from vig.recognition import WEIGHTS_FILE, Recognizer
from vig.recognition.weights import TRUNK_PREFIXES, shared_trunk
from vig.scene import ObjectClass
from vig_train.calibration.samples import StudioPhotos
from vig_train.class_training import ClassTraining, card, steps
from vig_train.class_training import plan as planning
from vig_train.class_training.card import HEADING
from vig_train.class_training.plan import Plan
from vig_train.class_training.steps import STEPS
from vig_train.cli.class_train import train_class
from vig_train.cli.settings import TrainClass
from vig_train.training import class_heads, class_network
from vig_train.training.class_heads import HeadsTraining
from vig_train.training.training import load_start_weights
from vig_world.assets.source_meshes import FILE, save

MAX_BYTES = 2_000_000
"""Of a pack's weights."""


PLAN = ClassTraining.plan
"""As it is, before the tests make it tiny."""


@pytest.fixture(scope="module", autouse=True)
def tiny() -> object:
    """Two files of some images, two passes, two steps, some photos."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (class_network, class_heads, steps):
            patch.setattr(module, "CHUNK", 16)
            patch.setattr(module, "map_in_processes", in_this_process)
        patch.setattr(ClassTraining, "plan", lambda self: Plan(2, 2, 20, 2))
        patch.setattr(steps, "PHOTOS", 36)
        patch.setattr(steps, "TEST_PHOTOS", 20)
        yield


def settings(pack: Path, **chosen: float) -> TrainClass:
    return TrainClass(pack, **{"workers": 1} | chosen)  # type: ignore[arg-type]


def images_of(pack: Path) -> class_network.ClassImages:
    return class_network.ClassImages(ObjectClass.load(pack), pack / "training" / "images", 0, 1)


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pack whose training was interrupted before the calibration, and gone on with."""
    folder = tmp_path_factory.mktemp("packs") / "fin"
    folder.mkdir()
    fin = toy("fin")
    fin.save(folder)
    save(folder / "build" / FILE, [two_boxes(fin.shape_model.mean)] * 3)

    def stop(training: ClassTraining) -> None:
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ClassTraining, "_calibrate", stop)
        with pytest.raises(KeyboardInterrupt):
            train_class(settings(folder))
        assert not (folder / WEIGHTS_FILE).exists(), "no weights that are not calibrated"
        patch.undo()
        patch.setattr(ClassTraining, "_train", stop)  # what is done is not done again
        train_class(settings(folder))
    return folder


def test_the_pack_explains_photos(pack: Path) -> None:
    photos, _ = StudioPhotos.draw(ObjectClass.load(pack), "test", 4, 3)
    explanation = Explainer(pack).explain(photos.images[0], box=(30, 30, 90, 90))
    assert 0 <= explanation.confidence <= 1


def test_the_weights_are_small_and_hold_no_trunk(pack: Path) -> None:
    tensors, metadata = read_tensors(pack / WEIGHTS_FILE, "pt")
    assert (pack / WEIGHTS_FILE).stat().st_size <= MAX_BYTES
    assert not [name for name in tensors if name.removeprefix("network.").startswith(TRUNK_PREFIXES)]
    assert metadata["trunk"] == shared_trunk()[1] and "quick" not in metadata


def test_weights_of_another_trunk_are_refused_in_one_line(
    pack: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trunk, _ = shared_trunk()
    monkeypatch.setattr("vig.recognition.weights.shared_trunk", lambda: (trunk, "0123456789abcdef"))
    with pytest.raises(UserError, match="goes with trunk .*, where this vig has 0123456789abcdef"):
        Explainer(pack)


def test_a_folds_network_has_not_seen_its_mesh_and_takes_the_whole_networks_mask(pack: Path) -> None:
    training = ClassTraining(pack, 15.0, workers=2, say=print)
    parts = training._recognizers()
    assert len(parts) == training.folds == 3
    features = training.images.features(range(2))
    assert set(features.model.tolist()) == {0, 1, 2}
    assert len(features[features.model % 3 != 1].coarse) < len(features.coarse)
    photos = np.random.default_rng(0).random((2, 3, 150, 150), np.float32)
    heads = [part.heads(photos) for part in parts]
    whole = Recognizer.of_class(training.object_class).heads(photos)
    assert np.array_equal(heads[0].mask, whole.mask) and np.array_equal(heads[1].mask, whole.mask)
    assert not np.allclose(heads[0].azimuth, heads[1].azimuth)


def test_the_card_has_the_errors_that_were_measured(pack: Path) -> None:
    errors = json.loads((pack / "training" / "run" / "test.json").read_text())
    text = (pack / "card.md").read_text()
    assert 8 <= errors["photos"] <= 20 and set(errors["methods"]) == {"network", "fit"}
    assert f"{errors['methods']['fit']['azimuth_deg']:.1f} degrees" in text
    assert "by each of the network's 3 members on meshes that it has not seen" in text
    assert "32 rendered images" in text
    trust = r"\d+ fits, .* within 15 degrees of azimuth; trusted from a confidence of .*%.*\."
    assert re.search(r"\(up to four of them: over photos\): " + trust, text)
    assert (pack / "reliability.png").exists() and "reliability.png" in text


def test_what_is_done_is_not_done_again(
    pack: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = (pack / WEIGHTS_FILE).read_bytes()
    monkeypatch.setattr(class_network.ClassImages, "draw", None)
    train_class(settings(pack))
    assert capsys.readouterr().out.count("done in") == len(STEPS)
    assert (pack / WEIGHTS_FILE).read_bytes() == before


@pytest.mark.slow
def test_more_minutes_begin_with_the_images_that_are_there_and_the_card_tells_both(
    pack: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = shutil.copytree(pack, tmp_path / "fin")
    first = (other / "training/images/00000.safetensors").stat().st_mtime_ns
    monkeypatch.setattr(ClassTraining, "plan", lambda self: Plan(3, 2, 20, 2))
    measured = {  # those of the first training
        "_calibrate": (steps.RELIABILITY_FILE, steps.CALIBRATION_FILE),
        "_test": ("test.json",),
    }
    for step, names in measured.items():

        def copy(training: ClassTraining, names: tuple[str, ...] = names) -> None:
            for name in names:
                shutil.copyfile(pack / "training/run" / name, training.run_folder / name)

        monkeypatch.setattr(ClassTraining, step, copy)
    train_class(settings(other, minutes=20.0))
    assert (other / "training/images/00000.safetensors").stat().st_mtime_ns == first
    assert len(list((other / "training/images").glob("*.safetensors"))) == 3
    text = (other / "card.md").read_text()
    assert text.count(HEADING) == 1 and "| 32 |" in text and "| 48 |" in text


@pytest.mark.slow
def test_a_killed_decoder_goes_on_to_the_same_weights(
    pack: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    object_class = ObjectClass.load(pack)
    examples = images_of(pack).examples(range(1))
    monkeypatch.setattr(class_network, "CHECKPOINT_STEPS", 1)

    def trained(checkpoint: Path | None, stops: int | None) -> dict[str, torch.Tensor]:
        torch.manual_seed(0)
        training = class_network.DecoderTraining(class_network.new_network(object_class), examples, True, 0)
        done = 0

        def stop(steps: int) -> None:
            nonlocal done
            done += steps
            if done == stops:
                raise KeyboardInterrupt

        training.run(3, checkpoint, stop)
        return training.network.state_dict()

    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path / "checkpoint.safetensors", 2)
    whole, resumed = trained(None, None), trained(tmp_path / "checkpoint.safetensors", None)
    for name in class_network.DECODER_PARTS:
        for key in (key for key in whole if key.startswith(f"{name}.")):
            assert torch.equal(whole[key], resumed[key]), key


def test_a_member_that_is_missing_is_trained_again_to_the_same_bytes(
    pack: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a process of its own, too."""
    monkeypatch.setattr(class_heads, "map_in_processes", map_in_processes)
    shutil.copytree(pack / "training" / "run", tmp_path / "run")
    path = tmp_path / "run" / "member-1.safetensors"
    heads = HeadsTraining(images_of(pack), 2, 3, tmp_path / "run", 2)
    before, other = path.read_bytes(), heads.path(0).stat().st_mtime_ns
    path.unlink()
    heads.run(class_network.new_network(heads.images.object_class), 1)
    assert path.read_bytes() == before and heads.path(0).stat().st_mtime_ns == other


def test_other_props_make_the_images_anew_and_are_named_on_the_card(
    pack: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And the new ones are made with bfloat16, as on processors that have it."""
    other, props = shutil.copytree(pack, tmp_path / "fin"), tmp_path / "things"
    props.mkdir()
    for number in range(12):
        trimesh.creation.box((1, 1, 1 + number)).export(props / f"box-{number}.ply")
    training = ClassTraining(other, 15.0, workers=1, say=print, props=str(props))
    assert not (other / "training" / "images").exists() and training.record.data["settings"]["props"]
    monkeypatch.setattr("vig_train.network.network.has_bfloat16", lambda: True)
    drawn = replace(training.images, folder=tmp_path / "new")
    drawn.draw(range(1))
    new, old = (images.examples(range(1)) for images in (drawn, images_of(pack)))
    assert not torch.equal(new.images, old.images) and card.origins(str(props)) == ["the folder things"]
    errors = json.loads((pack / "training/run/test.json").read_text())
    errors["cross_validation"] = "52 fits"
    text = card.section(errors, 48, {"images": 1.0}, 1, "", [], ["Scopia.sh3f, CC-BY 3.0: Ada"])
    assert "- Scopia.sh3f, CC-BY 3.0: Ada" in text and "on 1 core:" in text
    with pytest.raises(UserError, match="nothing of that name"):
        ClassTraining(other, 15.0, workers=1, say=print, props=str(tmp_path / "nothing"))


def test_the_plan_is_measured_on_new_images_counts_those_there_and_stays(
    pack: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 0.05 s a file and 0.1 s a step; two files are there."""
    other = shutil.copytree(pack, tmp_path / "fin")
    asked: list[range] = []

    def draw(images: class_network.ClassImages, chunks: range) -> None:
        asked.append(chunks)
        time.sleep(0.05 * len(chunks))

    monkeypatch.setattr(class_network.ClassImages, "draw", draw)
    monkeypatch.setattr(class_network.DecoderTraining, "seconds_per_step", lambda self: 0.1)
    training = ClassTraining(other, 0.05, workers=2, say=print)
    plan = PLAN(training)
    assert asked == [range(4), range(4, 8)]
    assert 2 + 15 <= plan.chunks <= 2 + round(planning.IMAGE_SHARE * 3 / 0.05)
    assert plan.decoder_steps == round(planning.DECODER_SHARE * 3 / 0.1)
    monkeypatch.setattr(class_network.ClassImages, "draw", None)
    assert PLAN(training) == plan


def test_other_meshes_make_the_images_anew(pack: Path, tmp_path: Path) -> None:
    other = shutil.copytree(pack, tmp_path / "fin")
    ClassTraining(other, 15.0, workers=2, say=print)
    assert (other / "training" / "images").exists()
    (other / "build" / FILE).unlink()
    training = ClassTraining(other, 15.0, workers=2, say=print)
    assert not (other / "training" / "images").exists()
    assert not any(training.record.complete(step) for step in STEPS)


def test_a_training_may_begin_with_weights_that_hold_no_trunk(pack: Path) -> None:
    network = class_network.new_network(ObjectClass.load(pack))
    before = network.dense[2].weight.clone()
    load_start_weights(network, pack / WEIGHTS_FILE, trunk_only=False)
    assert not torch.equal(network.dense[2].weight, before)


def test_a_pack_without_weights_names_what_trains_it(tmp_path: Path) -> None:
    toy("fin").save(tmp_path)
    explainer = Explainer(tmp_path)
    with pytest.raises(UserError, match="Give --box .* or --mask FILE; `vig class train`"):
        explainer.explain(np.full((150, 150, 3), 0.5, np.float32))


@pytest.mark.parametrize(
    "chosen, said",
    [
        ({"minutes": 0.0}, "--minutes from 1 to 10000; got 0"),
        ({"minutes": float("nan")}, "--minutes from 1 to 10000; got nan"),
        ({"workers": 0}, "--workers of at least 1; got 0"),
        ({"seed": -1}, "--seed of at least 0"),
    ],
)
def test_wrong_settings_get_one_line(pack: Path, chosen: dict[str, float], said: str) -> None:
    with pytest.raises(UserError, match=said):
        train_class(settings(pack, **chosen))


def test_a_folder_without_a_pack_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for given in (tmp_path, Path("mug")):
        with pytest.raises(UserError, match="expected"):
            train_class(settings(given))
    assert not any(tmp_path.iterdir())
