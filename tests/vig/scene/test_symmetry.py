"""Views that look the same are one view."""

import math

import numpy as np
import pytest

from tests.support import assert_close
from tests.toys import toy
from vig.renderer import render_latents
from vig.scene import Latents, Symmetry, angle_difference

LIGHT = np.float32([2.4, 0.5, 0.9, -0.7, 0.2, 0.1, 0.3, -0.2, 0.4])


def latents(*azimuths_deg: float) -> Latents:
    count = len(azimuths_deg)
    azimuth, elevation = np.radians(np.float32(azimuths_deg)), np.full(count, 0.4, np.float32)
    shape, albedo = np.zeros((count, 3), np.float32), np.full((count, 3), 0.6, np.float32)
    return Latents(shape, azimuth, elevation, albedo, np.tile(LIGHT, (count, 1)))


@pytest.mark.parametrize(
    ("symmetry", "a", "b", "difference"),
    [
        ("none", 350, 10, -20),
        ("none", 190, 0, -170),
        ("half-turn", 190, 0, 10),
        ("half-turn", 5, 178, 7),
        ("half-turn", 80, 0, 80),
        ("any-turn", 190, 0, 0),
    ],
)
def test_the_difference_is_to_the_nearest_view_that_looks_the_same(symmetry, a, b, difference) -> None:
    found = Symmetry(symmetry).difference(math.radians(a), math.radians(b))
    assert math.degrees(found) == pytest.approx(difference, abs=1e-9)


def test_without_symmetry_nothing_changes_at_all() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.uniform(-9, 9, (2, 1000))
    np.testing.assert_array_equal(Symmetry.NONE.difference(a, b), angle_difference(a, b))
    given = latents(-20.0, 400.0)
    assert Symmetry.NONE.canonical(given) is given
    assert Symmetry.NONE.nearest(given, np.zeros(2)) is given


def test_canonical_and_nearest_views_are_where_they_should_be() -> None:
    given = latents(-20.0, 10.0, 190.0)
    degrees = np.degrees(Symmetry.HALF_TURN.canonical(given).azimuth)
    assert_close(degrees, np.float32([160.0, 10.0, 10.0]), atol=1e-3, rtol=0)
    assert not Symmetry.ANY_TURN.canonical(given).azimuth.any()
    near = Symmetry.HALF_TURN.nearest(given, np.full(3, math.pi, np.float32)).azimuth
    assert_close(np.degrees(near), np.float32([160.0, 190.0, 190.0]), atol=1e-3, rtol=0)
    at = np.float32([1.0, 2.0, 3.0])
    assert_close(Symmetry.ANY_TURN.nearest(given, at).azimuth, at)


@pytest.mark.parametrize(("kind", "symmetry"), [("fins", "half-turn"), ("post", "any-turn")])
def test_a_canonical_view_gives_the_same_picture(kind: str, symmetry: str) -> None:
    """The light turns along with the camera; a post of 24 sides is only nearly round."""
    one = toy(kind)
    given = latents(195.0)  # 13 sides of a post
    views = given, Symmetry(symmetry).canonical(given)
    drawn = [render_latents(each, one, one.camera(60)).rgb.numpy() for each in views]
    assert_close(*drawn, atol=2e-3, rtol=0)
    assert drawn[0].max() > 0.1
