"""Both of a photo and its mirror image are asked."""

from __future__ import annotations

import copy
import inspect
import math
import pickle
from dataclasses import replace

import pytest
import torch

from vig.parallel.internals import has_bfloat16
from vig.recognition import NetworkSettings, RecognitionNetwork, Recognizer
from vig.recognition.layers import MOST_SIZES, PackedConvolution, pack_convolutions
from vig.recognition.network import fold_normalisation, mirrored
from vig.recognition.prediction import BOTH_SIDES
from vig.scene import ObjectClass, Symmetry
from vig.scene.object_class import PACKAGED


def test_a_photo_and_its_mirror_image_get_the_same_answer_mirrored() -> None:
    recognizer = Recognizer(PACKAGED / "teapot" / "recognition.safetensors")
    photo = torch.rand(2, 150, 150, 3, generator=torch.Generator().manual_seed(1))
    here, there = recognizer(photo), recognizer(photo.flip(2))
    angles, numbers = mirrored(torch.zeros(2), here.numbers)
    assert torch.allclose(there.numbers, numbers, atol=2e-2)
    assert torch.allclose(there.deviation, here.deviation, rtol=2e-2)
    assert torch.allclose(there.roll, -here.roll, atol=1e-3)
    assert torch.allclose(there.presence, here.presence, atol=1e-2)
    assert torch.allclose(there.mask, here.mask.flip(2), atol=2e-2)
    bins = here.azimuth.shape[1]
    centres = (torch.arange(bins) + 0.5) * (2 * math.pi / bins)
    for bin_, angle in enumerate(mirrored(centres, numbers[:1])[0]):
        same = int(angle / (2 * math.pi) * bins)
        assert torch.allclose(there.azimuth[:, same], here.azimuth[:, bin_], atol=5e-3)


def test_once_is_the_network_as_it_is() -> None:
    """And not what both together say."""
    recognizer = Recognizer(PACKAGED / "teapot" / "recognition.safetensors")
    photo = torch.rand(1, 150, 150, 3, generator=torch.Generator().manual_seed(2))
    once, turned = recognizer(photo, sides=(False,)), recognizer(photo.flip(2), sides=(False,))
    both = recognizer(photo)
    assert torch.allclose(both.roll, (once.roll - turned.roll) / 2, atol=1e-3)
    assert not torch.allclose(once.numbers, both.numbers, atol=1e-3)
    assert torch.allclose(recognizer(photo, sides=(True,)).roll, -turned.roll, atol=1e-6)


def test_the_same_photo_is_computed_once_and_another_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    recognizer = Recognizer(PACKAGED / "teapot" / "recognition.safetensors")
    computed = []
    plain = recognizer._predict
    monkeypatch.setattr(
        recognizer, "_predict", lambda photos, sides: (computed.append(sides), plain(photos, sides))[1]
    )
    photo = torch.rand(1, 150, 150, 3, generator=torch.Generator().manual_seed(2))
    first, again = recognizer(photo), recognizer(photo.clone())
    assert computed == [BOTH_SIDES] and torch.equal(first.mask, again.mask)
    again.mask.zero_()
    assert torch.equal(recognizer(photo).mask, first.mask), "a copy is given away"
    recognizer.calibration = replace(recognizer.calibration, mask_temperature=torch.tensor(2.0))
    assert not torch.equal(recognizer(photo).mask, first.mask), "another calibration is another answer"
    computed.remove(BOTH_SIDES)
    recognizer(photo, sides=(False,))
    photo[0, 75, 75, 0] = 1 - photo[0, 75, 75, 0]
    recognizer(photo, sides=(False,))
    recognizer(photo.double(), sides=(False,))
    recognizer(torch.cat([photo, photo]), sides=(False,))
    assert computed == [BOTH_SIDES, (False,), (False,), (False,)]


def test_folded_normalisation_predicts_the_same() -> None:
    network = RecognitionNetwork(NetworkSettings()).eval()
    generator = torch.Generator().manual_seed(3)
    for layer in network.modules():
        if isinstance(layer, torch.nn.BatchNorm2d):
            layer.running_mean = torch.randn(layer.num_features, generator=generator) / 10
            layer.running_var = torch.rand(layer.num_features, generator=generator) + 0.5
    photo = torch.rand(1, 3, 150, 150, generator=generator)
    with torch.inference_mode():
        before = network(photo)
        fold_normalisation(network)
        after = network(photo)
    assert not any(isinstance(layer, torch.nn.BatchNorm2d) for layer in network.modules())
    for name, value in vars(before).items():
        torch.testing.assert_close(getattr(after, name), value, rtol=1e-3, atol=1e-4)


def test_a_class_that_is_not_its_mirror_image_is_asked_once() -> None:
    recognizer = Recognizer(PACKAGED / "teapot" / "recognition.safetensors")
    photo = torch.rand(1, 150, 150, 3, generator=torch.Generator().manual_seed(2))
    once = recognizer(photo, sides=(False,))
    recognizer.mirror = False
    assert torch.equal(recognizer(photo).numbers, once.numbers)


def test_a_class_gives_its_recognizer_its_symmetries() -> None:
    teapot = ObjectClass.load("teapot")
    one = replace(teapot, symmetry=Symmetry.HALF_TURN, mirror=False)
    photo = torch.rand(1, 150, 150, 3, generator=torch.Generator().manual_seed(2))
    whole = Recognizer.of_class(teapot)(photo, sides=(False,)).azimuth
    folded = Recognizer.of_class(one)(photo)
    torch.testing.assert_close(folded.azimuth, whole[:, :36] + whole[:, 36:])
    assert folded.symmetry is Symmetry.HALF_TURN


def test_weights_in_bfloat16_that_are_laid_out_ahead_predict_the_same() -> None:
    photo = torch.rand(1, 150, 150, 3, generator=torch.Generator().manual_seed(0))
    recognizer = Recognizer.of_class(ObjectClass.load("teapot"))
    expected = torch.bfloat16 if has_bfloat16() else torch.float32
    assert recognizer.network.azimuth.weight.dtype == expected
    as_stored = Recognizer(PACKAGED / "teapot" / "recognition.safetensors")(photo)
    recognizer(1 - photo)
    kept = recognizer(photo)
    for name in ("azimuth", "numbers", "deviation", "mask", "presence"):
        assert torch.equal(getattr(as_stored, name), getattr(kept, name))
    packed = [layer for layer in recognizer.network.modules() if isinstance(layer, PackedConvolution)]
    runs = [run for layer in packed for run in layer.runs.values()]
    assert len(runs) == (50 if has_bfloat16() else 0), "all of the trunk and of the decoder"
    assert not any(inspect.ismethod(run) for run in runs), "torch's own layers were left"


def packed() -> tuple[torch.nn.Sequential, torch.nn.Sequential]:
    """A convolution with ReLU6, and the same, packed."""
    layers = torch.nn.Sequential(torch.nn.Conv2d(3, 8, 3), torch.nn.ReLU6(inplace=True)).requires_grad_(False)
    parent = torch.nn.Sequential(layers)
    pack_convolutions(parent)
    assert isinstance(parent[0], PackedConvolution)
    return layers, parent


def test_a_convolution_that_torch_cannot_pack_is_computed_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.backends.mkldnn, "is_available", lambda: False)
    layers, parent = packed()
    image = 9 * torch.rand(2, 3, 20, 20)
    for _ in range(3):
        assert torch.equal(parent(image), layers(image))
    assert [inspect.ismethod(run) for run in parent[0].runs.values()] == [True]


def test_weights_are_laid_out_for_few_sizes_that_come_again() -> None:
    layers, parent = packed()
    for side in (10, 11, 12, 13, 14, 10):  # too long ago
        parent(torch.rand(1, 3, side, side))
    assert not parent[0].runs
    for side in range(20, 40):
        image = torch.rand(1, 3, side, side)
        for _ in range(3):
            torch.testing.assert_close(parent(image), layers(image))
    assert [tuple(size) for size in parent[0].runs] == [(side, side) for side in range(20, 20 + MOST_SIZES)]


def test_what_is_laid_out_stays_out_of_copies() -> None:
    _, parent = packed()
    image = torch.rand(1, 3, 20, 20)
    expected = [parent(image) for _ in range(2)][1]
    for copied in (copy.deepcopy(parent), pickle.loads(pickle.dumps(parent))):
        assert not copied[0].runs and torch.equal(copied(image), expected)
    changed = copy.deepcopy(parent)
    changed[0].layers[0].weight.zero_()
    assert not torch.equal(changed(image), expected)
    assert len(parent[0].runs) == 1
