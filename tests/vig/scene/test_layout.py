import math

import numpy as np

from vig.scene import Block, LatentLayout, latent_layout, point_layout
from vig.scene.latents import FRAMING

ROLL = Block("roll", 1, -0.5, 0.5)


def test_blocks_stand_one_after_another_in_their_order() -> None:
    layout = LatentLayout((Block("a", 2), Block("b", 0), Block("c", 3)))
    assert (layout["a"], layout["b"], layout["c"]) == (slice(0, 2), slice(2, 2), slice(2, 5))
    assert layout.size == 5 and layout.at("c") == 2 and layout.count("b") == 0
    assert layout.indices("c", "a") == [2, 3, 4, 0, 1]
    assert layout.labels == ("a_0", "a_1", "c_0", "c_1", "c_2")


def test_a_fit_moves_the_latents_and_then_the_framing() -> None:
    latents, point = latent_layout(10), point_layout(10)
    assert point.labels[: latents.size] == latents.labels
    assert point.labels[point["framing"]] == ("shift_x", "shift_y", "log_scale", "roll")
    assert latents.size == 24 and point.at("framing") == 24
    assert point.indices("azimuth", "elevation") == [10, 11]


def test_split_and_join_are_inverse() -> None:
    layout = point_layout(3)
    vector = np.arange(2.0 * layout.size).reshape(2, -1)
    parts = layout.split(vector)
    assert parts["light"].tolist() == vector[:, 8:17].tolist()
    assert np.array_equal(layout.join(parts), vector)
    assert np.array_equal(layout.join(dict(reversed(parts.items()))), vector)


def test_blocks_are_added_replaced_held_and_left_out() -> None:
    layout = point_layout(2).with_blocks(ROLL)
    last = point_layout(2).size
    assert layout["roll"] == slice(last, last + 1)
    assert layout.with_blocks(ROLL.hold()).size == layout.size
    lower, upper = layout.with_blocks(ROLL.hold(0.1)).bounds()
    assert lower[last] == upper[last] == 0.1
    assert "roll" not in layout.without("roll") and layout.without("roll") == point_layout(2)
    assert layout.without("azimuth").at("elevation") == layout.at("azimuth")
    assert layout.block("roll") == ROLL and layout.count("perspective") == 0


def test_bounds_are_those_of_the_blocks() -> None:
    lower, upper = latent_layout(1).with_blocks(FRAMING).bounds()
    assert lower == (-3.0, -math.inf, 0.0, *[0.0] * 3, *[-math.inf] * 9, -0.4, -0.4, -1.0, -0.4)
    assert upper == (3.0, math.inf, math.pi / 2, *[1.0] * 3, *[math.inf] * 9, 0.4, 0.4, 1.0, 0.4)
