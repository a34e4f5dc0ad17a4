"""The model that is put together does what the network in torch does, whatever its sizes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.support import SMALL
from vig.recognition import NetworkSettings, Recognizer
from vig.recognition.graph import weight_shapes
from vig.recognition.network import mask_at_pixels
from vig.recognition.weights import COUNTER
from vig.scene.object_class import PACKAGED
from vig_train.network.network import RecognitionNetwork
from vig_train.network.weights import read_network
from vig_train.training.checkpoint import save_weights

SIZES = {
    "plain": SMALL,
    "members": replace(SMALL, squeezed=8, features=16, members=4),
    "context": replace(SMALL, context=(8, 6, 6, 4), object_map=8),
}


def written(path: Path, settings: NetworkSettings) -> RecognitionNetwork:
    """A network with numbers of its own, also in its normalisation, written to a file."""
    torch.manual_seed(0)
    network = RecognitionNetwork(settings).eval()
    for layer in network.modules():
        if isinstance(layer, torch.nn.BatchNorm2d):
            layer.running_mean.normal_(0, 0.1)
            layer.running_var.uniform_(0.5, 1.5)
            layer.weight.data.uniform_(0.5, 1.5)
            layer.bias.data.normal_(0, 0.1)
    count = network.numbers.out_features // 2
    save_weights(network, {"mean": torch.zeros(count), "deviation": torch.ones(count)}, path)
    return network


def agrees(network: RecognitionNetwork, recognizer: Recognizer) -> None:
    """That both say the same of images of noise, and of a photo of any size."""
    images = torch.rand(3, 3, 150, 150, generator=torch.Generator().manual_seed(1))
    heads = recognizer._heads(images.numpy())
    with torch.inference_mode():
        expected = network(images)
    for name, value in vars(expected).items():
        np.testing.assert_allclose(getattr(heads, name), value, rtol=1e-4, atol=1e-4, err_msg=name)
    if recognizer.has_map:
        photo = torch.rand(1, 3, 97, 130, generator=torch.Generator().manual_seed(2))
        with torch.inference_mode():
            numbers = network.object_map(network.coarse_maps(photo))
        np.testing.assert_allclose(recognizer.object_map(photo.numpy()), numbers, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", SIZES)
def test_a_model_is_the_network(name: str, tmp_path: Path) -> None:
    path = tmp_path / "recognition.safetensors"
    written(path, SIZES[name])
    agrees(read_network(path), Recognizer(path))


@pytest.mark.parametrize("name", ["teapot", "mug", "car"])
def test_models_of_packaged_classes_are_their_networks(name: str) -> None:
    path = PACKAGED / name / "recognition.safetensors"
    agrees(read_network(path), Recognizer(path))


@pytest.mark.parametrize("name", SIZES)
def test_the_weights_of_a_model_are_the_networks(name: str) -> None:
    held = RecognitionNetwork(SIZES[name]).state_dict()
    shapes = {key: tuple(value.shape) for key, value in held.items() if not key.endswith(COUNTER)}
    assert weight_shapes(SIZES[name]) == shapes


def test_a_mask_at_pixels_is_interpolated_as_by_torch() -> None:
    logits = torch.randn(2, 3, 75, 75, generator=torch.Generator().manual_seed(0))
    full = torch.nn.functional.interpolate(logits, scale_factor=2, mode="bilinear", align_corners=False)
    expected = full[:, :, :149, :].softmax(1).permute(0, 2, 3, 1)
    np.testing.assert_allclose(mask_at_pixels(logits.numpy(), 149, 150), expected, atol=1e-6)
