"""Windows are moved onto what the network sees; tried with a network that sees a bright disc."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from vig.photo import Window
from vig.recognition import Prediction, find, upright
from vig.recognition.find import box_in_window


class SeesDiscs:
    """Predicts that bright pixels are the object, upright; its roll follows a red dot at its rim."""

    informed = True

    def __call__(self, photos: torch.Tensor, twice: bool = True) -> Prediction:
        bright = (photos.mean(-1) > 0.5).float()
        count = len(photos)
        mask = torch.stack([bright, torch.zeros_like(bright), 1 - bright], -1)
        rolls = torch.tensor([self.roll(photo) for photo in photos])
        presence = (bright.mean((1, 2)) > 0.01).float()
        numbers = torch.zeros(count, 23)
        return Prediction(torch.ones(count, 72) / 72, numbers, numbers + 1, mask, rolls, presence)

    @staticmethod
    def roll(photo: torch.Tensor) -> float:
        red = torch.nonzero((photo[..., 0] > 0.5) & (photo[..., 2] < 0.2)).float()
        if not len(red):
            return 0.0
        y, x = (red.mean(0) - 75).tolist()
        return math.atan2(x, -y)  # the dot is at the top of an upright disc


def disc(height: int, width: int, x: float, y: float, radius: float, angle: float = 0.0) -> np.ndarray:
    """A white disc on black with a red dot that a clockwise turn by `angle` has taken from its top."""
    rows, columns = np.mgrid[:height, :width] + 0.5
    photo = np.zeros((height, width, 3), np.float32)
    photo[(columns - x) ** 2 + (rows - y) ** 2 < radius**2] = 1.0
    dot = x + 0.8 * radius * math.sin(angle), y - 0.8 * radius * math.cos(angle)
    photo[(columns - dot[0]) ** 2 + (rows - dot[1]) ** 2 < (0.15 * radius) ** 2] = [1.0, 0.0, 0.0]
    return photo


@pytest.mark.parametrize("place", [(200.0, 150.0, 120.0), (420.0, 90.0, 50.0), (90.0, 240.0, 70.0)])
def test_the_object_is_found_at_its_place_and_size(place: tuple[float, float, float]) -> None:
    x, y, radius = place
    best = find(disc(320, 500, x, y, radius), SeesDiscs())  # type: ignore[arg-type]
    assert best.window.side == pytest.approx(1.4 * 2 * radius, rel=0.12)
    assert best.window.centre == pytest.approx((x, y), abs=0.15 * radius)
    assert best.score > 0.5


def test_small_windows_are_looked_at_only_where_large_ones_do_not_find_the_object() -> None:
    class Counts(SeesDiscs):
        seen = 0

        def __call__(self, photos: torch.Tensor, twice: bool = True) -> Prediction:
            self.seen += len(photos)
            return super().__call__(photos, twice)

    large, none = Counts(), Counts()
    assert find(disc(300, 300, 150, 150, 90), large).score >= 0.85  # type: ignore[arg-type]
    find(np.zeros((300, 300, 3), np.float32), none)  # type: ignore[arg-type]
    assert (large.seen, none.seen) == (17 + 18, 191 + 2 * 18)


def test_nothing_is_found_in_an_empty_photo() -> None:
    found = find(np.zeros((100, 160, 3), np.float32), SeesDiscs())  # type: ignore[arg-type]
    assert found.score == 0


@pytest.mark.parametrize("angle", [0.0, 0.3, -0.5])
def test_a_window_is_turned_upright(angle: float) -> None:
    photo = disc(300, 300, 150, 150, 80, angle)
    turned = upright(photo, Window(38, 38, 224), SeesDiscs())  # type: ignore[arg-type]
    assert turned.roll == pytest.approx(angle, abs=0.1)
    assert turned.side == 224


def test_a_window_is_turned_on_where_only_a_part_of_a_roll_is_seen() -> None:
    class SeesHalf(SeesDiscs):
        looks = 0

        @classmethod
        def roll(cls, photo: torch.Tensor) -> float:
            cls.looks += 1
            return 0.6 * SeesDiscs.roll(photo)

    photo = disc(300, 300, 150, 150, 80, 0.6)
    turned = upright(photo, Window(38, 38, 224), SeesHalf())  # type: ignore[arg-type]
    assert turned.roll == pytest.approx(0.6 * (1 - 0.4**2), abs=0.04)
    assert SeesHalf.looks == 3, "the third sees less than 5 degrees"


def test_the_box_of_what_is_seen_is_in_sides_of_the_window() -> None:
    photo = torch.zeros(1, 150, 150, 3)
    photo[:, 30:90, 15:135] = 1.0
    assert box_in_window(SeesDiscs()(photo)) == pytest.approx((0.1, 0.2, 0.8, 0.4))
    assert box_in_window(SeesDiscs()(torch.zeros(1, 150, 150, 3))) is None
