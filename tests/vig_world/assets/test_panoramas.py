"""Panoramas: layout, determinism, and light statistics that span what real indoor panoramas show."""

import math

import numpy as np
import pytest

from vig.scene import EXPOSURE_L00, irradiance, rotate_z
from vig_world.assets.panoramas.light import expose_light, grey, light_parts, local_light, project_panorama
from vig_world.assets.panoramas.painting import directions, first_met, paint, panorama, visible_points
from vig_world.assets.panoramas.rooms import Box, PanoramaRoom, Source


def grey_light(image: np.ndarray) -> np.ndarray:
    """Exposed grey SH light (9,) of a panorama (H, W, 3)."""
    return expose_light(grey(project_panorama(image)))


@pytest.fixture(scope="module")
def lights() -> np.ndarray:
    return np.stack([grey_light(panorama(np.random.default_rng(seed), 32)) for seed in range(200)])


def test_is_finite_hdr_of_the_asked_size():
    for seed in range(10):
        image = panorama(np.random.default_rng(seed), 32)
        assert image.shape == (32, 64, 3) and image.dtype == np.float32
        assert np.isfinite(image).all() and image.min() >= 0
        assert image.max() > 2 * image.mean()


def test_same_seed_same_bytes_other_seed_other_room():
    a, b, c = (panorama(np.random.default_rng(seed)) for seed in (4, 4, 5))
    assert a.tobytes() == b.tobytes()
    assert a.tobytes() != c.tobytes()


def test_directions_run_down_from_up_and_counter_clockwise_from_x():
    way = directions(64, 128)
    assert np.allclose(np.linalg.norm(way, axis=-1), 1, atol=1e-6)
    assert (way[0, :, 2] > 0.99).all() and (way[-1, :, 2] < -0.99).all()
    middle = way[32]
    assert middle[0, 0] > 0.99 and middle[32, 1] > 0.99 and middle[64, 0] < -0.99


def test_grey_light_is_exposed(lights):
    assert lights.shape == (200, 9)
    assert np.allclose(lights[:, 0], EXPOSURE_L00)


def test_light_statistics_span_real_indoor_ones(lights):
    """Of 26 real ones, over L0 (min, median, max): |L1| .24 .82 1.46, |L2| .18 .62 1.78, up -.11 .44 1.16."""
    ratio = lights / lights[:, :1]
    first, second = np.linalg.norm(ratio[:, 1:4], axis=1), np.linalg.norm(ratio[:, 4:], axis=1)
    for value, low, middle, high in (
        (first, 0.4, 0.82, 1.15),
        (second, 0.35, 0.65, 1.2),
        (ratio[:, 2], 0.0, 0.44, 0.85),
    ):
        assert np.quantile(value, 0.03) < low
        assert abs(np.median(value) - middle) < 0.2
        assert np.quantile(value, 0.97) > high


def test_light_comes_from_all_sides(lights):
    azimuth = np.arctan2(lights[:, 1], lights[:, 3])
    counts, _ = np.histogram(azimuth, bins=4, range=(-np.pi, np.pi))
    assert counts.min() > 25


def test_statistics_do_not_depend_on_the_resolution():
    for seed in range(5):
        coarse, fine = (grey_light(panorama(np.random.default_rng(seed), h)) for h in (64, 128))
        assert np.abs(coarse - fine).max() < 0.35


def test_the_same_room_is_seen_at_any_resolution():
    for seed in range(5):
        coarse, fine = (panorama(np.random.default_rng(seed), h) for h in (32, 128))
        small = fine.reshape(32, 4, 64, 4, 3).mean((1, 3))
        logs = [np.log(image.mean(-1) + 1e-3).ravel() for image in (coarse, small)]
        assert np.corrcoef(*logs)[0, 1] > 0.9


def test_refuses_too_few_rows():
    with pytest.raises(ValueError, match="at least 16 rows; got 8"):
        panorama(np.random.default_rng(0), 8)


def box(low: list[float], high: list[float]) -> Box:
    return Box(np.array(low, np.float32), np.array(high, np.float32), np.full(3, 0.5, np.float32))


def bulb(centre: list[float], radius: float, radiance: float) -> Source:
    return Source(np.array(centre), np.array([radius, 0.0, 0.0]), None, np.full(3, radiance))


def bare_room(**things) -> PanoramaRoom:
    return PanoramaRoom(np.full(6, 2.0, np.float32), [box([0] * 3, [0] * 3)] * 6, **things)


BLOCK = box([1.0, -0.5, -0.5], [1.5, 0.5, 0.5])


def test_rays_meet_the_nearest_side_of_boxes_and_of_the_room():
    way = np.array([[1, 0, 0], [-1, 0, 0], [0, 0, 1], [0.6, 0.8, 0]], np.float32)
    distance, owner, side = first_met(way, bare_room(boxes=[BLOCK]))
    np.testing.assert_allclose(distance, [1.0, 2.0, 2.0, 2.5], atol=1e-6)
    assert owner.tolist() == [0, -1, -1, -1]
    assert side.tolist() == [1, 1, 4, 2]  # of the box the side that looks to -x


def test_a_box_hides_what_is_behind_it_only():
    points = np.array([[2, 0, 0], [2, 1.9, 0], [0.5, 0, 0]], np.float32)
    assert visible_points(points, np.zeros(3, np.float32), [BLOCK]).tolist() == [False, True, True]


@pytest.mark.parametrize("radius", [0.02, 0.3])
def test_a_lamp_has_its_flux_however_small_it_is(radius):
    edges = np.cos(np.linspace(0, np.pi, 65))
    solid_angle = ((edges[:-1] - edges[1:]) * np.pi / 64)[:, None]
    lamp = bulb([1.2, 0.9, 0.0], radius, 7.0)
    image = paint(bare_room(sources=[lamp]), 64)[..., 0]
    close = directions(64, 128) @ (lamp.centre / 1.5) > np.cos(max(radius / 1.5, np.pi / 64) + 0.02)
    bright = close & (image > 0.5 * image.max())
    assert abs((image * solid_angle)[bright].sum() / (7.0 * np.pi * (radius / 1.5) ** 2) - 1) < 0.02


def test_walls_are_lit_as_a_lamp_in_the_wall_lights_them():
    """Of A = 0.04 m^2 straight ahead: E / pi = L A / (pi r^2), times albedo, without bounces."""
    across, over = np.array([0, -0.1, 0]), np.array([0, 0, 0.1])
    pane = Source(np.array([1.99, 0, 0]), across, over, np.full(3, 50.0))
    assert pane.normal[0] == -1 and pane.area == pytest.approx(0.04)
    image = paint(bare_room(sources=[pane], ambient=0.0), 64)
    opposite = image[31:33, 63:65].mean()
    assert abs(opposite / (0.5 * 50 * 0.04 / (np.pi * 16)) - 1) < 0.1
    assert image[31:33, [0, -1]].max() > 40  # and itself it is as bright as it is


def test_furniture_throws_shadows():
    """Of a lamp at z = -1 over a box's top at z = -0.5: up to z = -0.24 on the wall behind."""
    boxes = [box([0.8, -0.5, -2.0], [1.2, 0.5, -0.5])]
    lamps = [bulb([-1.5, 0, -1.0], 0.1, 10.0)]
    bare, shaded = (paint(bare_room(sources=lamps, boxes=each, ambient=0), 64) for each in ([], boxes))
    x, y, z = np.moveaxis(directions(64, 128), -1, 0)
    behind = (x > 0.95) & (np.abs(y) < 0.1) & (z > -0.3) & (z < -0.16)
    above = (x > 0.95) & (np.abs(y) < 0.1) & (z > 0.05)
    assert behind.sum() > 10 and shaded[behind].mean() < 0.5 * bare[behind].mean()
    assert shaded[above].mean() > 0.7 * bare[above].mean()


def test_the_sun_shines_in_through_a_window_only():
    """From +x, 45 degrees up, through a pane in the wall at x = 2: on the floor below the pane."""
    pane = Source(np.array([1.99, 0, 1]), np.array([0, -0.5, 0]), np.array([0, 0, 0.5]), np.zeros(3), (1, 1))
    sun = np.array([1, 0, 1], np.float32) / np.float32(np.sqrt(2)), np.full(3, 8.0)
    image = paint(bare_room(sources=[pane], sun=sun, ambient=0.0), 64)
    lit = directions(64, 128)[image[..., 0] > 1]
    place = lit / -lit[:, 2:] * 2  # on the floor, where rays look down
    assert len(lit) and (lit[:, 2] < 0).all()
    assert (np.abs(place[:, 0] + 1) < 0.6).all() and (np.abs(place[:, 1]) < 0.6).all()


def uniform(above: float, below: float, height: int = 64) -> np.ndarray:
    image = np.full((height, 2 * height, 3), below)
    image[: height // 2] = above
    return image


def test_a_white_support_under_an_even_sky_makes_even_light():
    light = local_light(uniform(1.0, 0.0), 1.0)
    np.testing.assert_allclose(light, [EXPOSURE_L00, *[0] * 8], atol=2e-3)


def test_what_is_below_the_support_does_not_matter_and_darker_ones_send_back_less():
    image = panorama(np.random.default_rng(3), 32)
    hidden = image.copy()
    hidden[16:] *= 7
    np.testing.assert_allclose(local_light(image, 0.3), local_light(hidden, 0.3))
    dark, bright = (local_light(image, albedo) for albedo in (0.1, 0.8))
    assert dark[0] == pytest.approx(EXPOSURE_L00) and bright[0] == pytest.approx(EXPOSURE_L00)
    assert dark[2] > bright[2]  # of equal means, the one of the dark support comes from above


def test_a_support_sends_back_albedo_times_irradiance_over_pi():
    """Of an even sky E = pi: what looks down sees radiance albedo everywhere, an even lower half of it."""
    upper, white = light_parts(uniform(1.0, 5.0))
    down = np.array([[0.0, 0.0, -1.0]], np.float64)
    seen_of_upper, seen_of_both = (irradiance(light, down) for light in (upper, upper + 0.4 * white))
    rest = project_panorama(uniform(0.0, 0.4))
    np.testing.assert_allclose(0.4 * white, grey(rest), atol=2e-3)
    assert (seen_of_both - seen_of_upper).item() == pytest.approx(0.4, abs=0.01)


def test_local_light_turns_with_the_panorama():
    image = panorama(np.random.default_rng(5), 64)
    turned = np.roll(image, 16, axis=1)  # an eighth, counter-clockwise
    expected = rotate_z(local_light(image, 0.4), 2 * np.pi * 16 / 128)
    np.testing.assert_allclose(local_light(turned, 0.4), expected, atol=1e-6)
    np.testing.assert_array_equal(local_light(light_parts(image), 0.4), local_light(image, 0.4))


def test_light_from_below_only_and_odd_rows_are_refused():
    with pytest.raises(ValueError, match="positive mean radiance"):
        local_light(uniform(0.0, 1.0), 0.5)
    with pytest.raises(ValueError, match="even number of rows"):
        light_parts(np.ones((31, 62, 3)))


def test_exposure_scales_a_light_to_the_papers() -> None:
    light = np.random.default_rng(6).normal(size=9)
    light[0] = 11.0
    assert pytest.approx(0.75 * math.pi) == EXPOSURE_L00
    assert expose_light(light)[0] == pytest.approx(EXPOSURE_L00)
    np.testing.assert_allclose(expose_light(light) / EXPOSURE_L00, light / 11.0)
    with pytest.raises(ValueError, match="positive mean radiance"):
        expose_light(np.zeros(9))


def test_grey_is_rec_709_luminance() -> None:
    np.testing.assert_allclose(grey(np.eye(3)), [0.2126, 0.7152, 0.0722])
    np.testing.assert_allclose(grey(np.ones((9, 3))), np.ones(9))


@pytest.mark.parametrize("shape", [(4, 8), (4, 8, 4), (9,)])
def test_a_panorama_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="panorama must be"):
        project_panorama(np.zeros(shape))
