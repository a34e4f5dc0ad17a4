"""Both of a photo and its mirror image are asked; weights of another network are refused."""

import copy
import math
import pickle
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save_file

from tests.support import assert_close
from vig.io.errors import UserError
from vig.recognition import Recognizer
from vig.recognition.network import mirror_prediction
from vig.recognition.recognizer import AT_ONCE, BOTH_SIDES, WEIGHTS_FILE
from vig.scene import ObjectClass, Symmetry
from vig.scene.object_class import PACKAGED

WEIGHTS = PACKAGED / "teapot" / "recognition.safetensors"


def random_photos(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).random((count, 150, 150, 3), np.float32)


PHOTO = random_photos(2, 1)


def test_a_photo_and_its_mirror_image_get_the_same_answer_mirrored() -> None:
    recognizer = Recognizer(WEIGHTS)
    photo = random_photos(1, 2)
    here, there = recognizer(photo), recognizer(photo[:, :, ::-1])
    numbers = mirror_prediction(np.zeros(2), here.numbers)[1]
    assert np.allclose(there.numbers, numbers, atol=1e-5)
    assert np.allclose(there.deviation, here.deviation, rtol=1e-5)
    assert np.allclose(there.roll, -here.roll, atol=1e-6)
    assert np.allclose(there.presence, here.presence, atol=1e-5)
    assert np.allclose(there.mask, here.mask[:, :, ::-1], atol=1e-5)
    bins = here.azimuth.shape[1]
    centres = (np.arange(bins) + 0.5) * (2 * math.pi / bins)
    for bin_, angle in enumerate(mirror_prediction(centres, numbers[:1])[0]):
        same = int(angle / (2 * math.pi) * bins)
        assert np.allclose(there.azimuth[:, same], here.azimuth[:, bin_], atol=1e-5)


def test_once_is_the_network_as_it_is() -> None:
    """And not what both together say."""
    recognizer = Recognizer(WEIGHTS)
    once, turned = recognizer(PHOTO, sides=(False,)), recognizer(PHOTO[:, :, ::-1], sides=(False,))
    both = recognizer(PHOTO)
    assert np.allclose(both.roll, (once.roll - turned.roll) / 2, atol=1e-5)
    assert not np.allclose(once.numbers, both.numbers, atol=1e-3)
    assert np.allclose(recognizer(PHOTO, sides=(True,)).roll, -turned.roll, atol=1e-6)


def test_the_same_photo_is_computed_once_and_another_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    recognizer = Recognizer(WEIGHTS)
    computed = []
    plain = recognizer._predict
    monkeypatch.setattr(
        recognizer, "_predict", lambda photos, sides: (computed.append(sides), plain(photos, sides))[1]
    )
    photo = PHOTO.copy()
    first, again = recognizer(photo), recognizer(photo.copy())
    assert computed == [BOTH_SIDES] and np.array_equal(first.mask, again.mask)
    again.mask[:] = 0
    assert np.array_equal(recognizer(photo).mask, first.mask), "a copy is given away"
    recognizer.calibration = replace(recognizer.calibration, mask_temperature=np.float32(2))
    assert not np.array_equal(recognizer(photo).mask, first.mask), "another calibration is another answer"
    computed.remove(BOTH_SIDES)
    recognizer(photo, sides=(False,))
    photo[0, 75, 75, 0] = 1 - photo[0, 75, 75, 0]
    recognizer(photo, sides=(False,))
    recognizer(photo.astype(np.float64), sides=(False,))
    recognizer(np.concatenate([photo, photo]), sides=(False,))
    assert computed == [BOTH_SIDES, (False,), (False,), (False,)]


def test_a_class_gives_its_recognizer_its_symmetries() -> None:
    teapot = ObjectClass.load("teapot")
    one = replace(teapot, symmetry=Symmetry.HALF_TURN, mirror=False)
    whole = Recognizer.of_class(teapot)(PHOTO, sides=(False,)).azimuth
    folded = Recognizer.of_class(one)(PHOTO)
    assert_close(folded.azimuth, whole[:, :36] + whole[:, 36:])
    assert folded.symmetry is Symmetry.HALF_TURN


def test_an_answer_does_not_depend_on_how_many_are_asked() -> None:
    recognizer = Recognizer(WEIGHTS)
    photos = random_photos(3, AT_ONCE + 2)
    together = recognizer(photos)
    for number in (0, AT_ONCE + 1):
        alone = recognizer(photos[number : number + 1])
        assert_close(together.mask[number : number + 1], alone.mask, rtol=0, atol=1e-5)
        assert_close(together.numbers[number : number + 1], alone.numbers, rtol=0, atol=1e-5)


def test_recognizers_of_a_class_share_a_session_and_copies_make_their_own() -> None:
    recognizer, second = Recognizer(WEIGHTS), Recognizer(WEIGHTS)
    assert recognizer._session_of("window") is second._session_of("window")
    sent = pickle.loads(pickle.dumps(recognizer))
    assert np.array_equal(sent(PHOTO).mask, recognizer(PHOTO).mask)
    name = "mask.bias"
    bias = recognizer.weights[name] + np.float32(1)
    changed = recognizer.with_weights({name: bias})
    assert len(changed(PHOTO)) == 1 and changed.weights[name] is bias
    shifted = recognizer.with_weights({"others.bias": recognizer.weights["others.bias"] + np.float32(1)})
    assert np.allclose(shifted(PHOTO, sides=(False,)).roll, recognizer(PHOTO, sides=(False,)).roll + 1)
    copied = copy.deepcopy(recognizer)
    assert np.array_equal(copied(PHOTO).mask, recognizer(PHOTO).mask)


@pytest.fixture
def pack(tmp_path: Path) -> Path:
    """A copy of the mug's pack."""
    return Path(shutil.copytree(PACKAGED / "mug", tmp_path / "mug"))


@pytest.mark.parametrize(
    ("name", "change", "why"),
    [
        ("mask.bias", lambda value: None, "missing or unknown: mask.bias"),
        ("mask.more", lambda value: np.zeros(3, np.float32), "missing or unknown: mask.more"),
        ("mask.weight", lambda value: value[:2], r"'mask.weight' must be \(3, \d+, 1, 1\); it is \(2, "),
    ],
)
def test_weights_of_another_network_are_refused(
    pack: Path, name: str, change: Callable[[np.ndarray], np.ndarray | None], why: str
) -> None:
    path = pack / WEIGHTS_FILE
    with safe_open(path, framework="np") as file:
        metadata, arrays = file.metadata(), {key: file.get_tensor(key) for key in file.keys()}
    changed = change(arrays.pop(f"network.{name}", None))
    save_file(arrays | ({} if changed is None else {f"network.{name}": changed}), path, metadata)
    with pytest.raises(UserError, match=f"expected recognition weights .*{why}"):
        Recognizer(path)


def test_no_photos_give_no_predictions_and_pixels_that_are_no_numbers_are_named() -> None:
    recognizer = Recognizer(WEIGHTS)
    assert len(recognizer(np.zeros((0, 150, 150, 3), np.float32)).numbers) == 0
    with pytest.raises(UserError, match="expected a photo of finite numbers"):
        recognizer(np.full((1, 150, 150, 3), np.nan, np.float32))
