"""Training of what finds objects in whole photos: their map, and the presence head."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from vig.recognition import NetworkSettings
from vig.recognition.object_map import MAP_STRIDE
from vig.scene import regressed_layout
from vig_train.network.network import RecognitionNetwork
from vig_train.training.collages import SIDE, Box, draw_pictures
from vig_train.training.examples import Examples
from vig_train.training.object_map import CELLS, MapTraining, map_loss, targets_of
from vig_train.training.presence import PRESENCE, PRIOR_LOG_ODDS, dense_features, fit_presence, refit_logistic

SMALL = NetworkSettings(
    modes=2, channels=(8, 8, 12, 16, 16, 16), blocks=(1, 1, 1, 1, 1), squeezed=4, features=8, object_map=32
)


def discs(count: int) -> Examples:
    """Bright discs on dark noise; every fourth image has none."""
    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[:150, :150] + 0.5
    images = rng.integers(0, 60, (count, 150, 150, 3)).astype(np.uint8)
    visible = np.zeros((count, 150, 150), np.uint8)
    for number in range(count):
        x, y, radius = rng.uniform((60, 60, 40), (90, 90, 55))
        if number % 4:
            visible[number][(columns - x) ** 2 + (rows - y) ** 2 < radius**2] = 255
    images[visible > 0] = 230
    zeros, numbers = torch.zeros(count), torch.zeros(count, regressed_layout(2).size)
    masks = torch.from_numpy(visible), torch.zeros(count, 150, 150, dtype=torch.uint8)
    return Examples(torch.from_numpy(images), zeros, numbers, zeros, *masks)


def perfect(boxes: list[Box]) -> torch.Tensor:
    """What a map would say that knows all."""
    targets = targets_of(boxes)
    logit = torch.where(targets.centre == 1, 20.0, -20.0)
    return torch.cat([logit[None], targets.box])[None]


def test_boxes_of_pictures_are_round_the_objects() -> None:
    """Within each box of a picture of discs alone, three quarters are bright, as of a disc's."""
    pictures, boxes = draw_pictures(discs(64), np.random.default_rng(0))
    assert pictures.shape == (16, 3, SIDE, SIDE) and sum(map(len, boxes)) > 30
    inside = []
    for picture, placed in zip(pictures, boxes, strict=True):
        for x0, y0, x1, y1, seen in placed:
            if seen > 0.9 and min(x0, y0) >= 0 and max(x1, y1) <= SIDE:
                part = picture[:, math.ceil(y0) : int(y1), math.ceil(x0) : int(x1)].mean(0)
                inside.append(float((part > 0.45).float().mean()))
    assert np.median(inside) == pytest.approx(math.pi / 4, abs=0.08)


def test_targets_tell_centre_and_box() -> None:
    targets = targets_of([(40.0, 50.0, 120.0, 90.0, 1.0)])
    row, column = 4, 5  # of the centre, 80, 70
    assert (targets.centre == 1).nonzero().tolist() == [[row, column]]
    right, down, log_width, log_height = targets.box[:, row, column].tolist()
    assert ((column + 0.5 + right) * MAP_STRIDE, (row + 0.5 + down) * MAP_STRIDE) == pytest.approx((80, 70))
    assert np.exp([log_width, log_height]) * MAP_STRIDE == pytest.approx([80, 40])
    assert targets.counts.all() and targets.near[row, column]


@pytest.mark.parametrize(
    "box",
    [(40.0, 50.0, 60.0, 60.0, 1.0), (0.0, 0.0, 200.0, 180.0, 1.0), (40.0, 50.0, 120.0, 90.0, 0.05)],
    ids=["too small", "too large", "hidden"],
)
def test_what_the_map_cannot_tell_counts_neither_as_there_nor_as_absent(box: Box) -> None:
    targets = targets_of([box])
    row, column = int((box[1] + box[3]) / 2 / MAP_STRIDE), int((box[0] + box[2]) / 2 / MAP_STRIDE)
    assert not targets.counts[row, column] and not targets.near.any() and not targets.centre.any()
    assert targets.counts[CELLS - 1, CELLS - 1]


def test_a_mirrored_picture_has_mirrored_targets() -> None:
    box: Box = (43.0, 50.0, 125.0, 90.0, 1.0)
    mirrored = targets_of([box]).mirror()
    expected = targets_of([(SIDE - box[2], box[1], SIDE - box[0], box[3], 1.0)])
    for name, value in vars(expected).items():
        torch.testing.assert_close(getattr(mirrored, name).float(), value.float(), atol=1e-5, rtol=0)


def test_the_loss_is_least_where_all_is_right() -> None:
    box: Box = (40.0, 50.0, 120.0, 90.0, 1.0)
    targets = targets_of([box])
    batch = type(targets).stack([targets])
    right = perfect([box])
    assert map_loss(right, batch) == pytest.approx(0.0, abs=1e-4)
    missed, moved, imagined = right.clone(), right.clone(), right.clone()
    missed[:, 0], moved[:, 1:], imagined[:, 0, 15, 15] = -20.0, right[:, 1:] + 0.5, 20.0
    for wrong in (missed, moved, imagined):
        assert map_loss(wrong, batch) > 0.5


def test_a_map_learns_where_things_are_and_all_else_stays() -> None:
    torch.manual_seed(0)
    network, examples = RecognitionNetwork(SMALL), discs(64)
    before = {k: v.clone() for k, v in network.state_dict().items() if not k.startswith("object_map")}
    pictures, boxes = draw_pictures(examples, np.random.default_rng(1))
    targets = [targets_of(each) for each in boxes]
    batch = type(targets[0]).stack(targets)

    def held_out() -> float:
        with torch.inference_mode():
            return float(map_loss(network.eval().object_map(network.coarse_maps(pictures)), batch))

    at_first, made = held_out(), []
    MapTraining(examples, 256, 0, advance=made.append).run(network)
    assert sum(made) == 256 and held_out() < 0.5 * at_first
    assert all(torch.equal(network.state_dict()[name], value) for name, value in before.items())


def test_log_odds_are_found_up_to_the_prior() -> None:
    rng = np.random.default_rng(0)
    features = rng.normal(size=(20000, 3)) * [1, 10, 0.1]
    true, bias = np.array([1.0, -0.05, 5.0]), -0.7
    present = rng.random(20000) < 1 / (1 + np.exp(-features @ true - bias))
    weight, found = refit_logistic(np.zeros(3), 0.0, features, present.astype(float))
    assert weight * [1, 10, 0.1] == pytest.approx(true * [1, 10, 0.1], abs=0.06)
    assert found == pytest.approx(bias + PRIOR_LOG_ODDS, abs=0.06)


def test_the_head_learns_to_tell_discs_from_noise_and_nothing_else_changes() -> None:
    torch.manual_seed(0)
    network = RecognitionNetwork(replace(SMALL, squeezed=16, features=64))
    examples = discs(120)
    for _ in range(3):  # the running statistics of the normalisation
        network(examples.pixels()[:60])
    network.eval()
    before = {name: value.clone() for name, value in network.state_dict().items()}
    fit_presence(network, examples, 1)
    changed = [name for name, value in network.state_dict().items() if not torch.equal(value, before[name])]
    assert changed == ["others.weight", "others.bias"]
    kept = 1 - PRESENCE
    assert torch.equal(network.others.weight[kept], before["others.weight"][kept])
    seen = dense_features(network, examples, 2)
    with torch.inference_mode():
        log_odds = network.others(torch.from_numpy(seen))[:, PRESENCE]
    present = examples.present() > 0
    in_order = (log_odds[present][:, None] > log_odds[~present]).float().mean()
    assert in_order > 0.9


def test_without_images_of_other_things_the_head_stays() -> None:
    torch.manual_seed(0)
    network = RecognitionNetwork(SMALL).eval()
    before = network.others.weight.clone()
    fit_presence(network, discs(64)[torch.arange(64) % 4 > 0], 1)
    assert torch.equal(network.others.weight, before)
