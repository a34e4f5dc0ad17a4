from __future__ import annotations

import numpy as np
import pytest

from vig.scene import ObjectClass
from vig.synthesis.designs import HELD_OUT_DESIGNS, TRAINING_DESIGNS, teapot_vertices
from vig.synthesis.layouts import material_under
from vig.synthesis.library import LAYOUTS, PROPS_PER_FAMILY, SLOTS, Library
from vig.synthesis.panoramas import local_light
from vig.synthesis.props import FAMILIES
from vig.synthesis.target import NO_DESIGN, draw_shape, shape_vertices


@pytest.fixture(scope="module")
def splits() -> tuple[Library, Library]:
    return Library("train"), Library("test")


ONE_MOULD = {"egg_box", "figurine", "hairbrush", "mouse", "soap", "teddy"}
"""Families whose members may differ in size and finish only."""


def test_splits_share_no_prop(splits: tuple[Library, Library]) -> None:
    """No shape of one split's members is one of the other's, whatever their sizes; sizes always differ."""
    for family in FAMILIES:
        shapes: list[set[bytes]] = []
        sizes: list[set[float]] = []
        for library in splits:
            clouds = [
                np.concatenate([mesh.vertices for mesh, _ in library.prop(family, number).parts])
                for number in range(PROPS_PER_FAMILY[library.split])
            ]
            sizes.append({float(np.ptp(cloud, axis=0).max()) for cloud in clouds})
            shapes.append({np.round(cloud / np.ptp(cloud, axis=0).max(), 4).tobytes() for cloud in clouds})
        assert not sizes[0] & sizes[1], family
        assert family in ONE_MOULD or not shapes[0] & shapes[1], family


def test_splits_share_no_layout_finish_or_panorama(splits: tuple[Library, Library]) -> None:
    train, test = splits
    outlines = [{lib.layout(n).outline.tobytes() for n in range(12)} for lib in splits]
    assert not outlines[0] & outlines[1] and len(outlines[0]) == 12
    finishes = [{lib.finish("wood", n).tobytes() for n in range(12)} for lib in splits]
    assert not finishes[0] & finishes[1]
    lights = [np.array([lib.light(n, 0.0, 0.3) for n in range(24)]) for lib in (train, test)]
    assert np.abs(lights[0][:, None] - lights[1][None]).max(-1).min() > 1e-3


def test_there_are_enough_rooms() -> None:
    assert LAYOUTS["train"] >= 80 and LAYOUTS["test"] >= 24


def test_shapes_of_the_test_split_are_held_out_designs() -> None:
    """Each is nearer to a held-out design than to any design that the model was made from."""
    teapot = ObjectClass.load("teapot")
    rng = np.random.default_rng(0)
    held = np.stack([teapot_vertices(design) for design in HELD_OUT_DESIGNS])
    model = teapot.shape_model
    used = set()
    for _ in range(40):
        shape, design = draw_shape(rng, teapot, "test")
        vertices = shape_vertices(shape, design, teapot)
        deviation = vertices - shape_vertices(shape, NO_DESIGN, teapot)
        assert 1e-4 < np.linalg.norm(deviation, axis=1).mean() < 5e-3
        # The deviation is the design's own: orthogonal to what the model can do.
        basis = model.basis.reshape(model.modes, -1).astype(float)
        flat = (held[design] - model.mean).ravel()
        residual = flat - basis.T @ np.linalg.lstsq(basis.T, flat, rcond=None)[0]
        np.testing.assert_allclose(deviation.ravel(), residual, atol=2e-3)
        used.add(design)
    assert used == set(range(len(HELD_OUT_DESIGNS)))
    assert draw_shape(rng, teapot, "train")[1] == NO_DESIGN
    assert len(TRAINING_DESIGNS) == 23


def test_a_brighter_support_sends_more_light_up(splits: tuple[Library, Library]) -> None:
    """Y10 grows with height, so light from below lowers its coefficient at the same exposure."""
    radiance = splits[0].radiance(0)
    dark, bright = local_light(radiance, 0.05), local_light(radiance, 0.8)
    assert bright[2] < dark[2]


def test_every_slot_has_finishes(splits: tuple[Library, Library]) -> None:
    rng = np.random.default_rng(1)
    for slot in SLOTS:
        finish = splits[0].draw_finish(slot, rng)
        assert splits[0].finish(finish.kind, finish.asset).shape == (128, 128, 3)
        assert 0 < splits[0].albedo(finish.kind, finish.asset) < 0.9


def test_light_from_below_is_that_of_the_support(splits: tuple[Library, Library]) -> None:
    """The material found under a support is what a ray from above meets; most have a slot's finish."""
    library, found, missing = splits[0], [], 0
    for number in range(6):
        layout = library.layout(number)
        for index, support in enumerate(layout.supports):
            material = material_under(layout, support)
            missing += material is None
            slot, _ = library.ground(number, index)
            found.append(slot)
            if support.zone == "floor":
                assert slot == "floor"
    assert missing <= 0.05 * len(found)
    assert {"top", "wood", "fabric", "floor"} <= set(found)
