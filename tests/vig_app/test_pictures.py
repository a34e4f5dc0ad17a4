"""The pictures of an explanation."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from vig.photo import Window, outline_distance
from vig.photo.outline import FINER, SMOOTH
from vig.scene import Camera
from vig_app.pictures import HIDDEN, LABEL, OUTLINE, CloseUp, draw_outlines, draw_panels, part_colours


def half_hidden(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Distances for an object over the middle square of a window, its lower half hidden."""
    covered = np.zeros((size, size), np.float32)
    covered[size // 4 : 3 * size // 4, size // 4 : 3 * size // 4] = 1
    seen = covered.copy()
    seen[size // 2 :] = 0
    return outline_distance(covered), outline_distance(seen)


@pytest.mark.parametrize("ground", [0, 100, 255])
def test_visible_pixels_keep_their_colour_hidden_are_tinted_and_the_rim_is_drawn(ground: int) -> None:
    photo = np.full((400, 400, 3), ground, np.uint8)
    picture = draw_outlines(photo, Window.of(400, 400), *half_hidden(40))
    assert (picture[110:190, 110:290] == ground).all()
    np.testing.assert_array_equal(picture[250, 150], np.round(0.5 * ground + 0.5 * HIDDEN).astype(np.uint8))
    rim = picture[150, 90:101].astype(int)
    assert (np.abs(rim - OUTLINE).max(1) < 40).any()
    assert (rim.max(1) < 60).any(), "a dark line beside it, on any ground"
    assert (picture[:80] == ground).all()


def test_the_outline_is_as_wide_in_a_large_photo_and_as_smooth() -> None:
    """A disc of the map, enlarged twenty times: its outline is within a pixel or two of the circle."""
    y, x = np.mgrid[:60, :60] + 0.5
    disc = np.clip(20.5 - np.hypot(x - 30, y - 30), 0, 1).astype(np.float32)
    distance = outline_distance(disc)
    window = Window(100, 50, 1200)
    inside = window.paste(distance, slice(0, 1300), slice(0, 1400)) < 0
    rows, columns = np.mgrid[:1300, :1400] + 0.5
    radius = np.hypot(columns - 700, rows - 650)
    assert inside[radius < 397].all() and not inside[(radius > 403) & (radius < 550)].any()


def test_distances_are_exact_as_far_as_they_are_asked_for() -> None:
    """Against the transform of all points, on a blot; nearer bounds change nothing within them."""
    rng = np.random.default_rng(np.random.SeedSequence(3))
    noise = ndimage.gaussian_filter(rng.normal(size=(60, 60)), 3)
    blot = np.zeros((60, 60), np.float32)
    blot[15:45, 15:45] = noise[15:45, 15:45] > 0
    near, far = outline_distance(blot, 3.0, 1.0), outline_distance(blot)
    np.testing.assert_allclose(near, far.clip(-1, 3), atol=1e-6)
    soft = ndimage.gaussian_filter(blot, SMOOTH, mode="nearest")
    fine = np.asarray(Image.fromarray(soft).resize((240, 240), Image.Resampling.BICUBIC)) > 0.5
    beyond, within = ndimage.distance_transform_edt(~fine), ndimage.distance_transform_edt(fine)
    expected = (
        ndimage.gaussian_filter(np.where(fine, 0.5 - within, beyond - 0.5), 1.0, mode="nearest") / FINER
    )
    close = np.abs(expected) < 10
    np.testing.assert_allclose(far[close], expected[close], atol=1e-5)


def test_only_the_windows_part_of_a_photo_and_a_maps_box_of_the_window_are_visited() -> None:
    tiles = list(Window(700, 900, 200, roll=0.5).tiles(2000, 3000))
    rows = tiles[-1][0].stop - tiles[0][0].start
    assert 200 <= rows <= 290 and all(columns.stop - columns.start <= 290 for _, columns in tiles)
    assert not list(Window(-500, 0, 100).tiles(300, 300))
    around = np.zeros((40, 40), bool)
    around[10:20, 5:25] = True
    assert list(Window(100, 200, 80).tiles(500, 500, around)) == [(slice(220, 240), slice(110, 150))]
    assert not list(Window(100, 200, 80).tiles(500, 500, around & False))


def test_nothing_found_leaves_the_photo_as_it_is() -> None:
    photo = np.random.default_rng(1).integers(0, 255, (30, 50, 3), np.uint8)
    nothing = outline_distance(np.zeros((40, 40), np.float32))
    assert np.array_equal(draw_outlines(photo, Window.of(50, 30), nothing, nothing), photo)


def close_up() -> CloseUp:
    """A white rendering of two parts; the photo shows the left one at half, the right one hidden by black."""
    covered = np.zeros((40, 40), bool)
    covered[10:30, 5:35] = True
    part = np.where(covered, np.arange(40) // 20, -1)
    rendering = np.where(covered[..., None], [0.8, 0.8, 0.8], 0.0)
    seen = covered & (part == 0)
    photo = np.where(seen[..., None], [0.4, 0.2, 0.1], 0.0)
    normals = np.where(covered[..., None], [0.0, 0.0, -1.0], 0.0)
    depth = np.where(covered, 0.4, np.inf)
    return CloseUp(
        photo, rendering, covered.astype(np.float32), normals, part, depth, seen, Camera.standard(len(photo))
    )


@pytest.mark.parametrize(
    ("light", "photo", "reflectance", "seen", "hidden"),
    [
        (1.0, 1.0, 1.0, [0.4, 0.2, 0.1], [0.8, 0.8, 0.8]),
        (1.0, 4.0, 1.0, [1.0, 0.5, 0.25], [0.8, 0.8, 0.8]),  # too bright, over 0.8: 2, 1, 0.5
        # Its colour is the photo over the light, whatever share of the albedo the class gives it.
        (0.1, 1.0, np.array([0.1, 0.5]), [0.4, 0.2, 0.1], [0.4, 0.4, 0.4]),
    ],
)
def test_a_part_has_the_colour_of_where_it_is_seen(light, photo, reflectance, seen, hidden) -> None:
    shown = close_up()
    shown = replace(shown, rendering=light * shown.rendering, photo=photo * shown.photo)
    colours = part_colours(shown, np.full(3, 0.8), reflectance * np.ones(2))
    np.testing.assert_allclose(colours, [seen, hidden], rtol=1e-5)


def test_panels_stand_side_by_side() -> None:
    sheet = draw_panels(close_up())
    assert sheet.shape == (40 + LABEL, 200, 3)
    photo, drawn, residual, normals, mask = np.split(sheet[LABEL:], 5, axis=1)
    assert photo[20, 10].argmax() == 0 and drawn[20, 10].min() > 220
    assert residual[20, 10].argmax() == 2, "the photo is darker: blue"
    assert len(np.unique(residual[20, 30])) == 1, "what is hidden has none"
    assert tuple(normals[20, 10]) == (128, 128, 255), "towards the eye"
    np.testing.assert_allclose(mask[20, 30], HIDDEN, atol=1)
    assert tuple(mask[20, 10]) == (255, 255, 255) and mask[2, 2].max() < 60
