"""The paper's networks: what each looks at, and what is made of their numbers."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from vig.inference import ExplainSettings
from vig.inference.posterior import pixel_prior
from vig.inference.settings import PICTURE
from vig.io.errors import UserError
from vig.scene import Latents, ObjectClass, linear_from_srgb
from vig_paper.network.network import FACTORS, PaperNetworks, PaperSettings, targets_of
from vig_paper.network.recognizer import PaperRecognizer, recognizer_of
from vig_paper.network.training import save_paper_weights
from vig_paper.teapot_class import PACK
from vig_train.training.targets import numbers_of

SMALL = PaperSettings(filters=(4, 4, 4), dense=(8, 8))
RANDOM = np.random.default_rng(0).random((2, 150, 150, 3), np.float32)
SPREAD = math.radians(12.0)


def some_latents(azimuth_deg: float) -> Latents:
    """One explanation, its light from +X in the object's frame: (l, m) = (1, 1)."""
    light = torch.tensor([[2.356, 0.0, 0.3, 0.9, 0.0, 0.1, 0.0, 0.2, 0.0]])
    shape = torch.linspace(-1, 1, 10)[None]
    angles = torch.tensor([math.radians(azimuth_deg)]), torch.tensor([0.4])
    return Latents(shape, *angles, torch.tensor([[0.7, 0.4, 0.2]]), light)


def saying(latents: Latents) -> PaperNetworks:
    """Networks that give one answer to every photo: their last layers' outputs are nothing but a centre."""
    networks = PaperNetworks(SMALL)
    for factor, numbers in targets_of(latents).items():
        network = networks.of(factor)
        torch.nn.init.zeros_(network.layers[-1].weight)
        torch.nn.init.zeros_(network.layers[-1].bias)
        network.centre.copy_(numbers[0])
    networks.azimuth_deviation.fill_(SPREAD)
    networks.deviation.copy_(torch.linspace(0.1, 0.5, 23))
    return networks


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    path = tmp_path / "recognition.safetensors"
    save_paper_weights(saying(some_latents(203.0)), path)
    return path


def test_the_papers_layers_are_as_wide_as_it_says() -> None:
    networks = PaperNetworks(PaperSettings())
    shapes = [tuple(p.shape) for name, p in networks.of("pose").named_parameters() if name.endswith("weight")]
    # 150 pixels less 4, halved, three times: 73, 34, 15.
    assert shapes == [
        (64, 1, 5, 5), (64, 64, 5, 5), (64, 64, 5, 5), (256, 64 * 15 * 15), (32, 256), (4, 32),
    ]  # fmt: skip
    counts = {factor: networks.of(factor).layers[-1].out_features for factor in FACTORS}
    assert counts == {"pose": 4, "shape": 10, "appearance": 3, "light": 9}


def test_pose_and_shape_look_at_grey_appearance_and_light_at_red_green_blue() -> None:
    networks = PaperNetworks(SMALL)
    image = torch.zeros(1, 3, 150, 150)
    image[:, 0], image[:, 2] = 1.0, 0.5  # purple
    for factor in ("appearance", "light"):
        assert torch.equal(networks.of(factor).channels(image), image)
        assert networks.of(factor).layers[0].in_channels == 3
    for factor in ("pose", "shape"):
        grey = networks.of(factor).channels(image)
        assert grey.shape == (1, 1, 150, 150)
        assert grey[0, 0, 0, 0] == pytest.approx(0.299 + 0.5 * 0.114)


def test_red_green_and_blue_are_in_their_places(tmp_path: Path) -> None:
    """Weights that hand each channel through, so that what comes out is a plain photo's colour in sRGB."""
    networks = saying(some_latents(0.0))
    network = networks.of("appearance")
    for layer in network.layers:
        if isinstance(layer, torch.nn.Conv2d):
            torch.nn.init.dirac_(layer.weight)
        elif isinstance(layer, torch.nn.Linear):
            torch.nn.init.eye_(layer.weight)
        if isinstance(layer, torch.nn.Conv2d | torch.nn.Linear):
            torch.nn.init.zeros_(layer.bias)
    dense = network.layers[11]
    dense.weight.data = torch.eye(4).repeat_interleave(15 * 15, 1).repeat(2, 1) / 15**2  # a channel's mean
    network.mean_image.zero_()
    network.centre.zero_()
    save_paper_weights(networks, tmp_path / "w.safetensors")
    srgb = np.array([[0.9, 0.3, 0.1], [0.1, 0.2, 0.8]], np.float32)
    photos = np.broadcast_to(linear_from_srgb(srgb)[:, None, None], (2, 150, 150, 3))
    albedo = PaperRecognizer(tmp_path / "w.safetensors")(photos).numbers[:, 11:14]
    np.testing.assert_allclose(albedo, srgb, atol=0.01)


@pytest.mark.parametrize("azimuth_deg", [2.5, 92.5, 202.5, 357.5])
def test_the_best_guess_is_what_the_networks_say(azimuth_deg: float, tmp_path: Path) -> None:
    """Also the light: said in the object's frame, kept in the heading frame, turned back. Bins' centres."""
    said = some_latents(azimuth_deg)
    save_paper_weights(saying(said), tmp_path / "w.safetensors")
    prediction = PaperRecognizer(tmp_path / "w.safetensors")(RANDOM[:2])
    np.testing.assert_allclose(prediction.numbers, numbers_of(said).numpy().repeat(2, 0), atol=1e-4)
    np.testing.assert_allclose(
        prediction.best().to_vector(), said.to_vector().numpy().repeat(2, 0), atol=1e-3, rtol=0
    )


def test_the_azimuth_is_a_gaussian_of_the_stated_width_across_north(tmp_path: Path) -> None:
    save_paper_weights(saying(some_latents(358.0)), tmp_path / "w.safetensors")
    prediction = PaperRecognizer(tmp_path / "w.safetensors")(RANDOM[:1])
    np.testing.assert_allclose(prediction.azimuth.sum(1), 1, rtol=1e-5)
    off = ((np.arange(72) + 0.5) * 5 - 358 + 180) % 360 - 180
    assert (prediction.azimuth[0] * off).sum() == pytest.approx(0, abs=0.05)
    assert np.sqrt((prediction.azimuth[0] * off**2).sum()) == pytest.approx(math.degrees(SPREAD), rel=0.01)


def test_the_deviations_are_the_files_and_the_mask_says_nothing(weights: Path) -> None:
    prediction = recognizer_of(ObjectClass.load(PACK), weights)(RANDOM[:2])
    np.testing.assert_allclose(prediction.deviation, np.linspace(0.1, 0.5, 23)[None].repeat(2, 0), rtol=1e-5)
    settings = ExplainSettings(**PICTURE | {"decoration": 0.0}, surroundings=0.0)
    prior, _ = pixel_prior(RANDOM[0], prediction.mask[0], settings)
    unsaid = dataclasses.replace(settings, mask_weight=0.0)
    without, _ = pixel_prior(RANDOM[1], prediction.mask[0], unsaid)
    np.testing.assert_allclose(prior - without, math.log(1 / 3), rtol=1e-5)


@pytest.mark.parametrize("wrong", ["kind", "settings", "missing", "extra", "nan", "negative", "width"])
def test_wrong_files_are_refused_in_a_line(wrong: str, weights: Path, tmp_path: Path) -> None:
    with safe_open(weights, framework="pt") as file:
        metadata = dict(file.metadata())
    tensors = load_file(weights)
    if wrong == "kind":
        metadata["net"] = "other"
    elif wrong == "settings":
        metadata["settings"] = json.dumps({"widths": [1, 2, 3, 4]})
    elif wrong == "missing":
        del tensors["network.deviation"]
    elif wrong == "extra":
        tensors["network.more"] = torch.zeros(3)
    elif wrong == "nan":
        tensors["network.factors.light.centre"].fill_(math.nan)
    elif wrong == "negative":
        tensors["network.deviation"][3] = -0.1
    else:
        tensors["network.factors.shape.layers.14.weight"] = torch.zeros(7, 8)
    save_file(tensors, tmp_path / "wrong.safetensors", metadata=metadata)
    with pytest.raises(UserError, match="expected recognition weights at") as refused:
        PaperRecognizer(tmp_path / "wrong.safetensors")
    assert "\n" not in str(refused.value)
