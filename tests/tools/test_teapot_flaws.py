"""What `flaws` finds, and that no named design has any."""

from dataclasses import replace

import numpy as np
import pytest

from tools.classes.teapot_flaws import flaws, folds, inside
from vig_world.assets.designs.design import TEAPOTS, TeapotDesign

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
CUBE_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    + [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)
CLASSIC = TEAPOTS["train"][0]
BAIL = next(design for design in TEAPOTS["train"] if design.handle == "above")


@pytest.mark.parametrize(
    "design", TEAPOTS["train"] + TEAPOTS["test"] + TEAPOTS["validation"], ids=lambda design: design.name
)
def test_named_designs_have_no_flaws(design: TeapotDesign) -> None:
    assert flaws(design) == []


@pytest.mark.parametrize(
    ("design", "flaw"),
    [
        (replace(CLASSIC, handle_top=0.3), "the handle is detached from the body"),
        (
            replace(CLASSIC, spout_base_height=0.2, spout_tip_height=0.25),
            "the spout is detached from the body",
        ),
        (replace(CLASSIC, spout_reach=-0.05), "the spout's mouth is inside the body"),
        (replace(CLASSIC, handle_reach=-0.06), "the handle runs through the pot"),
        (replace(CLASSIC, handle_thickness=0.06), "the handle folds"),
        (replace(CLASSIC, spout_tip_height=-0.03), "it reaches below the ground"),
        (replace(CLASSIC, spout_reach=0.3), "it is 547 mm long, not 180 to 420"),
        (replace(BAIL, bail_height=0.01), "the lid and its knob reach the handle above"),
    ],
)
def test_a_broken_design_has_the_flaw(design: TeapotDesign, flaw: str) -> None:
    assert flaw in flaws(design)


def test_inside_of_a_cube() -> None:
    points = np.array([[0.5, 0.5, 0.5], [0.99, 0.01, 0.5], [1.01, 0.5, 0.5], [-2.0, 0.5, 0.5]])
    np.testing.assert_array_equal(inside(points, CUBE, CUBE_FACES), [True, True, False, False])


def test_a_tube_folds_where_a_ring_passes_the_one_before() -> None:
    angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(8)], axis=1)
    tilted = (
        ring + [0, 0, 1] + np.outer(ring[:, 0], [0, 0, 1.5])
    )  # at x = -1 it is half a unit below the first
    assert not folds(np.stack([ring, ring + [0, 0, 1]]))
    assert folds(np.stack([ring, tilted]))
