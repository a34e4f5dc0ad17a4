"""The overlay picture."""

import numpy as np

from vig.report import overlay
from vig.report.files import HIDDEN, OUTLINE


def test_visible_pixels_keep_their_colour_hidden_are_tinted_and_the_rim_is_drawn():
    photo = np.full((40, 40, 3), 100, np.uint8)
    amodal = np.zeros((40, 40), bool)
    amodal[10:30, 10:30] = True
    visible = amodal.copy()
    visible[20:] = False
    picture = overlay(photo, amodal, visible)
    assert (picture[12:20, 10:30] == 100).all()
    assert np.array_equal(picture[25, 15], np.round(0.5 * 100 + 0.5 * HIDDEN).astype(np.uint8))
    assert np.array_equal(picture[9, 15], OUTLINE.astype(np.uint8))
    assert (picture[:8] == 100).all()


def test_nothing_found_leaves_the_photo_as_it_is():
    photo = np.random.default_rng(1).integers(0, 255, (30, 50, 3), np.uint8)
    nothing = np.zeros((30, 50), bool)
    assert np.array_equal(overlay(photo, nothing, nothing), photo)
