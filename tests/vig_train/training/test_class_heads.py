"""Members of a class's network: side by side they give the mean of what each says; packed matrices."""

from pathlib import Path

import numpy as np
import pytest
import torch

from vig.io.checks import read_tensors
from vig.recognition import NetworkSettings, Recognizer
from vig.recognition.weights import PACKED, STEPS, unpack_matrix, whole_tensors
from vig_train.network.network import RecognitionNetwork
from vig_train.network.weights import pack_matrix
from vig_train.training import class_heads
from vig_train.training.checkpoint import save_weights
from vig_train.training.class_heads import HEADS, PACKED_MATRICES, keep_member
from vig_train.training.class_network import SIZES

MODES = 3


@pytest.fixture(scope="module")
def members() -> list[class_heads._Member]:
    torch.manual_seed(0)
    made = [class_heads._Member(MODES) for _ in range(SIZES.members)]
    with torch.no_grad():
        for member in made:  # statistics as after some training
            member.normalise.running_mean.normal_()
            member.normalise.running_var.uniform_(0.5, 2)
            for head in HEADS:
                getattr(member, head).bias.normal_()
    return [member.eval() for member in made]


@pytest.fixture
def network(members: list[class_heads._Member], monkeypatch: pytest.MonkeyPatch) -> RecognitionNetwork:
    monkeypatch.setattr(class_heads, "unpack_matrix", lambda levels, steps: steps)
    monkeypatch.setattr(class_heads, "pack_matrix", lambda matrix: (None, matrix))
    sizes = NetworkSettings(**{**vars(SIZES), "modes": MODES})
    network = RecognitionNetwork(sizes).eval()
    class_heads._join(network, members)
    return network


def said(network: RecognitionNetwork, coarse: torch.Tensor) -> list[torch.Tensor]:
    features = network.dense(coarse)
    mean, log_variance = network.numbers(features).chunk(2, dim=1)
    roll, presence = network.others(features).unbind(1)
    return [network.azimuth(features), mean, log_variance, roll, presence]


def test_a_network_says_the_mean_of_its_members(
    network: RecognitionNetwork, members: list[class_heads._Member]
) -> None:
    coarse = torch.randn(5, SIZES.channels[-1], 10, 10)
    with torch.inference_mode():
        each = [list(vars(member(coarse)).values()) for member in members]
        for number, whole in enumerate(said(network, coarse)):
            assert torch.allclose(whole, torch.stack([m[number] for m in each]).mean(0), atol=1e-4)


def test_a_member_that_is_kept_says_what_it_says_by_itself_but_for_the_bias(
    network: RecognitionNetwork, members: list[class_heads._Member], tmp_path: Path
) -> None:
    count = network.numbers.out_features // 2
    scale = {"mean": torch.zeros(count), "deviation": torch.ones(count)}
    save_weights(network, scale, tmp_path / "w.safetensors")
    kept = keep_member(Recognizer(tmp_path / "w.safetensors"), 2)
    images = torch.rand(5, 3, 150, 150)
    with torch.inference_mode():
        own = members[2](network.maps(images)[-1]).azimuth.numpy()
    difference = kept.heads(images.numpy(), (False,)).azimuth - own
    np.testing.assert_allclose(difference, np.repeat(difference[:1], 5, 0), atol=5e-3)
    assert np.abs(difference).max() > 1e-2


def test_a_packed_matrix_is_off_by_half_a_step_at_most() -> None:
    scales = np.array([[1.0], [10], [0.1], [1], [1], [0]], np.float32)
    matrix = np.random.default_rng(0).normal(size=(6, 10)).astype(np.float32) * scales
    levels, steps = pack_matrix(matrix)
    assert levels.dtype == np.uint8 and levels.shape == (6, 5)
    off = np.abs(unpack_matrix(levels, steps) - matrix).max(1)
    assert (off <= 0.501 * np.abs(matrix).max(1) / 7 + 1e-6).all()
    again = unpack_matrix(*pack_matrix(unpack_matrix(levels, steps)))
    np.testing.assert_allclose(again, unpack_matrix(levels, steps), rtol=1e-3)


def test_known_levels_are_unpacked() -> None:
    levels = np.array([[0x81, 0xF0]], np.uint8)
    assert unpack_matrix(levels, np.array([0.5], np.float16)).tolist() == [[0.0, -3.5, 3.5, -4.0]]


@pytest.mark.parametrize(
    "levels, steps",
    [
        (np.zeros((2, 3)), np.zeros(2)),
        (np.zeros((2, 3), np.uint8), np.zeros(3)),
        (np.zeros(3, np.uint8), np.zeros(3)),
    ],
)
def test_what_is_no_packed_matrix_is_refused(levels: np.ndarray, steps: np.ndarray) -> None:
    with pytest.raises(ValueError, match="a packed matrix of"):
        unpack_matrix(levels, steps)


def test_a_file_with_packed_matrices_gives_the_network(network: RecognitionNetwork, tmp_path: Path) -> None:
    scale = {"mean": torch.zeros(4), "deviation": torch.ones(4)}
    save_weights(network, scale, tmp_path / "w.safetensors", shared_trunk=True, packed=PACKED_MATRICES)
    tensors, metadata = read_tensors(tmp_path / "w.safetensors")
    names = {f"network.{name}{end}" for name in PACKED_MATRICES for end in (PACKED, STEPS)}
    assert names <= tensors.keys()
    whole = whole_tensors(tensors, metadata)
    assert {name.removeprefix("network.") for name in whole if name.startswith("network.")} == set(
        network.state_dict()
    )
    weight = network.dense[2].weight.detach().numpy()
    off = np.abs(whole["network.dense.2.weight"] - weight)
    assert (off <= np.abs(weight).max(1, keepdims=True) / 13).all()


def test_sizes_that_members_cannot_share_are_refused() -> None:
    with pytest.raises(ValueError, match="multiples of members"):
        NetworkSettings(squeezed=50, features=384, members=4)
    with pytest.raises(ValueError, match="members"):
        NetworkSettings(members=0)
