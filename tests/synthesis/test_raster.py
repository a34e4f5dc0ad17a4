from __future__ import annotations

import numpy as np
import pytest

from vig.scene import Mesh
from vig.synthesis.build import Instance
from vig.synthesis.footprint import Footprint
from vig.synthesis.raster import _cut
from vig.synthesis.shadow import ground_shade
from vig.synthesis.texturing import sample_texture, texels_per_metre

UP = np.array([0.0, 0.0, 1.0])


def box(low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray:
    return np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), np.float32).reshape(3, 8).T


BOX_FACES = np.array(  # outward; corners in the order of `box`: z fastest, x slowest
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]],
    np.int32,
)  # fmt: skip


def test_texture_is_exact_at_texel_centres_and_linear_between() -> None:
    """A 2 x 2 texture: u = 1/4 and 3/4 are the columns' centres, v = 3/4 is row 0's."""
    texture = np.array([[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 1]]], np.float32)
    uv = np.array(
        [[0.25, 0.75], [0.75, 0.75], [0.25, 0.25], [1.75, -0.75], [0.5, 0.75], [0.0, 0.75]], np.float32
    )
    colours = sample_texture(texture, uv, np.ones(6))
    expected = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [0.5, 0.5, 0], [0.5, 0.5, 0]]
    np.testing.assert_allclose(colours, expected, atol=1e-6)


def test_a_pixel_that_covers_the_whole_texture_sees_its_mean() -> None:
    texture = np.random.default_rng(0).uniform(size=(16, 16, 3)).astype(np.float32)
    colour = sample_texture(texture, np.array([[0.3, 0.9]], np.float32), np.array([16.0]))
    np.testing.assert_allclose(colour[0], texture.mean(axis=(0, 1)), atol=1e-6)


def test_texel_density_of_a_square() -> None:
    """Two repeats of 64 texels over 0.5 m are 256 texels a metre."""
    square = np.array([[0, 0, 0], [0.5, 0, 0], [0.5, 0.5, 0], [0, 0.5, 0]], np.float32)
    mesh = Mesh(square, np.array([[0, 1, 2], [0, 2, 3]], np.int32), square[:, :2] * 4)
    assert texels_per_metre(mesh, np.zeros((64, 64, 3))) == pytest.approx(256)


def test_ground_is_darker_under_a_box_and_on_the_side_away_from_the_light() -> None:
    mesh = Mesh(box((-0.1, -0.1, 0), (0.1, 0.1, 0.2)), BOX_FACES, np.zeros((8, 2), np.float32))
    solid = Instance("prop-00/box/0", mesh, np.zeros((8, 3)), np.ones((1, 1, 3)), "wood", 0.5, 1.0)
    light = np.zeros(9)
    light[[0, 2, 3]] = 1.0, 0.7, 0.7  # from above and +X: the shadow falls towards -X
    points = np.array([[0.0, 0.0], [-0.2, 0.0], [0.2, 0.0], [0.7, 0.7]])
    under, away, towards, far = ground_shade([solid], points, light)
    assert under < away < towards - 0.1
    assert towards == pytest.approx(1, abs=0.02) and far == pytest.approx(1, abs=1e-6)


def test_a_polygon_is_cut_where_the_distance_changes_sign() -> None:
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    np.testing.assert_allclose(_cut(square, 1.5 - square[:, 0]), [[0, 0], [1.5, 0], [1.5, 1], [0, 1]])
    assert len(_cut(square, np.full(4, -1.0))) == 0


def test_footprints_are_apart_by_the_gap_between_boxes() -> None:
    first = Footprint.of(box((0, 0, 0), (1, 1, 1)), UP)
    aside = Footprint.of(box((1.3, 0.2, 0), (2, 0.8, 1)), UP)
    above = Footprint.of(box((0, 0, 1.2), (1, 1, 2)), UP)
    for other, gap in ((aside, 0.3), (above, 0.2)):
        assert first.clear_of(other, gap - 0.01) and other.clear_of(first, gap - 0.01)
        assert not first.clear_of(other, gap + 0.01)
    assert not first.clear_of(Footprint.of(box((0.9, 0.9, 0.9), (2, 2, 2)), UP), 0.0)
