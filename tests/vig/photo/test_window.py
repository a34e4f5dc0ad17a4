"""The object's window in a photo, there and back."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from vig.io.errors import UserError
from vig.photo.images import linear_photo
from vig.photo.window import BOX_BELOW_CENTRE, WINDOW_OVER_BOX, ImagePyramid, Window
from vig.scene import Camera


def test_whole_square_photo_of_the_right_size_is_not_resampled():
    photo = np.random.default_rng(0).random((150, 150, 3)).astype(np.float32)
    cut, known = Window.of(150, 150).crop(photo)
    assert cut is photo
    assert known.all()


def test_window_of_a_box_is_larger_with_the_box_a_little_below_its_centre():
    window = Window.of(400, 300, (100, 80, 120, 60))
    assert window.side == pytest.approx(WINDOW_OVER_BOX * 120)
    assert window.left + window.side / 2 == pytest.approx(160)
    assert window.top + window.side / 2 == pytest.approx(110 - BOX_BELOW_CENTRE * window.side)


def test_wide_photo_is_padded_above_and_below_and_padding_is_marked_unknown():
    photo = np.full((100, 200, 3), 0.25, np.float32)
    cut, known = Window.of(200, 100).crop(photo, 100)
    assert cut.shape == (100, 100, 3)
    assert np.allclose(cut, 0.25)
    assert known[25:75].mean() > 0.97
    assert not known[:24].any()
    assert not known[76:].any()


def test_box_at_the_corner_reaches_beyond_the_photo_and_is_filled_with_its_border():
    photo = np.zeros((60, 60, 3), np.float32)
    photo[:20, :20] = 0.5
    cut, known = Window.of(60, 60, (0, 0, 20, 20)).crop(photo, 54)
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
    cut, _ = window.crop(photo)
    back = window.paste((cut[:, :, 0] > 0.5).astype(np.float32), slice(0, height), slice(0, width)) > 0.5
    union = (back | disc).sum()
    assert (back & disc).sum() / union > 0.93


@pytest.mark.parametrize(
    "box", [(-15, 0, 20, 20), (95, 0, 20, 20), (0, 0, 4, 4), (0, 96, 20, 20), (9, 9, 400, 400)]
)
def test_box_outside_the_photo_or_tiny_is_refused_in_one_line(box):
    with pytest.raises(UserError) as caught:
        Window.of(100, 100, box)
    assert "100 x 100" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_box_may_leave_the_photo_by_rounding_or_with_what_is_cut_off():
    """Its window is where it would be in a larger photo."""
    for box in ((80, 10, 20.0000001, 20), (-1e-9, 0, 20, 20), (-10, 30, 40, 30), (70, 70, 50, 45)):
        window, (x, _, w, h) = Window.of(100, 100, box), box
        assert window.side == pytest.approx(1.4 * max(w, h))
        assert window.centre[0] == pytest.approx(x + w / 2)


@pytest.mark.parametrize("roll", [0.0, 0.5, -2.0])
def test_a_turned_window_shows_upright_what_is_turned_and_maps_back(roll: float) -> None:
    """A bar drawn along the window's own x axis lies level in the cut, and returns to where it was."""
    height, width = 240, 320
    window = Window(110.0, 60.0, 120.0, roll)
    y, x = np.mgrid[:height, :width] + 0.5
    along = np.cos(roll) * (x - 170) + np.sin(roll) * (y - 120)
    across = np.cos(roll) * (y - 120) - np.sin(roll) * (x - 170)
    bar = ((along > 0) & (along < 40) & (np.abs(across) < 6)).astype(np.float32)
    cut, known = window.crop(np.repeat(bar[..., None], 3, axis=2), 150)
    seen = cut[..., 0] > 0.5
    rows, columns = np.nonzero(seen)
    assert np.ptp(rows) == pytest.approx(15, abs=2) and abs(rows.mean() - 74.5) < 1
    assert columns.min() == pytest.approx(75, abs=2) and columns.max() == pytest.approx(125, abs=2)
    assert known.all()
    back = window.paste(seen.astype(np.float32), slice(0, height), slice(0, width)) > 0.5
    assert (back & (bar > 0.5)).sum() / (back | (bar > 0.5)).sum() > 0.85


@pytest.mark.parametrize("roll", [0.0, 0.4, -1.2])
def test_the_camera_of_the_photo_sees_points_where_the_turned_window_shows_them(roll: float) -> None:
    window, camera = Window(110.0, 60.0, 120.0, roll), Camera.standard(150, 0.08)
    point = np.array([0.05, -0.02, 0.11, 1.0])

    def project(camera: Camera) -> np.ndarray:
        image = camera.K @ (camera.camera_from_world(0.7, 0.3) @ point)[:3]
        return image[:2] / image[2]

    inside = (project(camera) / 150 - 0.5) * window.side
    turn = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    np.testing.assert_allclose(
        project(window.camera(camera, 320, 240)), np.array(window.centre) + turn @ inside, atol=1e-6
    )


def test_a_turned_box_lies_below_the_middle_of_its_window_along_the_windows_own_vertical() -> None:
    window = Window.round_box((100, 80, 120, 60), np.pi / 2)  # its down is the photo's left
    assert window.centre == pytest.approx((160 + BOX_BELOW_CENTRE * window.side, 110))


def smooth_photo(height: int, width: int) -> np.ndarray:
    """uint8 sRGB with detail some ten pixels wide."""
    noise = np.random.default_rng(4).integers(0, 256, (height // 32, width // 32, 3), np.uint8)
    return np.asarray(Image.fromarray(noise).resize((width, height), Image.Resampling.BICUBIC))


@pytest.mark.parametrize("roll", [0.0, 0.4])
@pytest.mark.parametrize("box", [(100, 80, 150, 120), (0, 300, 200, 199), (10.5, 40.25, 700, 430)])
def test_a_window_of_less_than_eight_times_its_pixels_is_cut_from_the_photo_itself(box, roll: float) -> None:
    coded = smooth_photo(500, 750)
    window = replace(Window.of(750, 500, box), roll=roll)
    for mine, plain in zip(window.crop(ImagePyramid(coded)), window.crop(linear_photo(coded)), strict=True):
        np.testing.assert_array_equal(mine, plain)


@pytest.fixture(scope="module")
def large() -> tuple[np.ndarray, np.ndarray]:
    """A photo, coded and linear."""
    coded = smooth_photo(1601, 2215)
    return coded, linear_photo(coded)


@pytest.mark.parametrize("roll", [0.0, 0.4])
@pytest.mark.parametrize("box", [(300, 200, 1501, 900), (0, 0, 900, 600), (1313, 801, 900, 700)])
def test_a_large_window_is_cut_from_a_half_and_looks_the_same(box, roll: float, large) -> None:
    coded, linear = large
    halved, window = ImagePyramid(coded), replace(Window.of(2215, 1601, box), roll=roll)
    cut, known = window.crop(halved)
    plain, all_known = window.crop(linear)
    assert halved.level(window.side / 150)[1] > 1
    assert np.abs(cut - plain).mean() < 0.01
    assert (known != all_known).mean() < 0.01
    photo, scale = halved.level(33.0)
    assert (scale, photo.shape) == (8, (201, 277, 3))
    np.testing.assert_allclose(photo[3, 5], linear[24:32, 40:48].mean((0, 1)), atol=1e-5)


def test_map_is_carried_to_where_another_window_shows_it():
    map_ = np.zeros((50, 50), np.float32)
    map_[20:30, 10:20] = 1  # the photo's rows 50 to 70 and columns 20 to 40
    here = Window(0.0, 10.0, 100.0)
    assert np.allclose(here.warp_to(map_, here), map_)
    smaller = here.warp_to(map_, Window(20.0, 50.0, 20.0))
    assert smaller[3:-3, 3:-3].min() == 1
    beyond = here.warp_to(map_, Window(500.0, 0.0, 100.0), outside=0.25)
    assert np.allclose(beyond, 0.25)


def test_map_is_carried_between_windows_that_are_turned():
    rows, columns = np.mgrid[:60, :60]
    map_ = np.exp(-((rows - 20) ** 2 + (columns - 35) ** 2) / 60).astype(np.float32)
    here, there = Window(3.0, 5.0, 90.0, roll=0.3), Window(-2.0, 11.0, 84.0, roll=-0.4)
    x, y = here.to_photo(90 * (35.5 / 60 - 0.5), 90 * (20.5 / 60 - 0.5))
    expected = np.array(there.to_window(x, y)) * 60 / 84 + 30 - 0.5
    found = np.unravel_index(here.warp_to(map_, there).argmax(), (60, 60))
    assert np.allclose(found[::-1], expected, atol=1)
    back = there.warp_to(here.warp_to(map_, there), here)
    assert np.abs(back - map_)[10:-10, 10:-10].max() < 0.12
