import numpy as np
import pytest

from vig_world.assets.footprint import Footprint

UP = np.array([0.0, 0.0, 1.0])


def box(low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray:
    return np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), np.float32).reshape(3, 8).T


def test_footprints_are_apart_by_the_gap_between_boxes() -> None:
    first = Footprint.of(box((0, 0, 0), (1, 1, 1)), UP)
    aside = Footprint.of(box((1.3, 0.2, 0), (2, 0.8, 1)), UP)
    above = Footprint.of(box((0, 0, 1.2), (1, 1, 2)), UP)
    for other, gap in ((aside, 0.3), (above, 0.2)):
        assert first.gap(other) == pytest.approx(gap, abs=1e-6) == other.gap(first)
    assert first.gap(Footprint.of(box((0.9, 0.9, 0.9), (2, 2, 2)), UP)) < 0.0


def test_gaps_of_many_are_those_of_each_pair() -> None:
    rng, axis = np.random.default_rng(0), np.array([0.6, 0.0, 0.8])
    clouds = rng.uniform(-0.1, 0.1, (5, 20, 3)) + rng.uniform(-0.3, 0.3, (5, 1, 3))
    many, single = Footprint.of(clouds, axis), [Footprint.of(cloud, axis) for cloud in clouds]
    each = [[one.gap(other) for other in single] for one in single]
    for every in (many, Footprint.stack(single)):
        np.testing.assert_array_equal(every[:, None].gap(many), each)
    assert many[3].gap(single[0]) == each[3][0]
