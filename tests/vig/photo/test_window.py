"""The object's window in a photo, there and back."""

import numpy as np
import pytest

from vig.errors import UserError
from vig.photo.window import BOX_BELOW_CENTRE, WINDOW_OVER_BOX, Window


def test_whole_square_photo_of_the_right_size_is_not_resampled():
    photo = np.random.default_rng(0).random((150, 150, 3)).astype(np.float32)
    cut, known = Window.of(150, 150).cut(photo)
    assert cut is photo
    assert known.all()


def test_window_of_a_box_is_larger_with_the_box_a_little_below_its_centre():
    window = Window.of(400, 300, (100, 80, 120, 60))
    assert window.side == pytest.approx(WINDOW_OVER_BOX * 120)
    assert window.left + window.side / 2 == pytest.approx(160)
    assert window.top + window.side / 2 == pytest.approx(110 - BOX_BELOW_CENTRE * window.side)


def test_wide_photo_is_padded_above_and_below_and_padding_is_marked_unknown():
    photo = np.full((100, 200, 3), 0.25, np.float32)
    cut, known = Window.of(200, 100).cut(photo, 100)
    assert cut.shape == (100, 100, 3)
    assert np.allclose(cut, 0.25)
    assert known[25:75].mean() > 0.97
    assert not known[:24].any()
    assert not known[76:].any()


def test_box_at_the_corner_reaches_beyond_the_photo_and_is_filled_with_its_border():
    photo = np.zeros((60, 60, 3), np.float32)
    photo[:20, :20] = 0.5
    cut, known = Window.of(60, 60, (0, 0, 20, 20)).cut(photo, 54)
    assert np.allclose(cut[2, 2], 0.5)  # beyond the photo, continued from its corner
    assert not known[2, 2]
    assert known[20, 20]


@pytest.mark.parametrize("size", [(150, 150), (640, 480), (90, 200)])
def test_a_disc_drawn_in_the_photo_comes_back_where_it_was(size):
    width, height = size
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    centre, radius = (0.45 * width, 0.55 * height), 0.2 * min(size)
    disc = (x - centre[0]) ** 2 + (y - centre[1]) ** 2 < radius**2
    photo = np.repeat(disc[:, :, None], 3, axis=2).astype(np.float32)
    box = (centre[0] - radius, centre[1] - radius, 2 * radius, 2 * radius)
    window = Window.of(width, height, box)
    cut, _ = window.cut(photo)
    back = window.back((cut[:, :, 0] > 0.5).astype(np.float32), width, height) > 0.5
    union = (back | disc).sum()
    assert (back & disc).sum() / union > 0.93


@pytest.mark.parametrize("box", [(-1, 0, 20, 20), (90, 0, 20, 20), (0, 0, 4, 4), (0, 90, 20, 20)])
def test_box_outside_the_photo_or_tiny_is_refused_in_one_line(box):
    with pytest.raises(UserError) as caught:
        Window.of(100, 100, box)
    assert "100 x 100" in str(caught.value)
    assert "\n" not in str(caught.value)
