"""Designs with the handle above or straight, with ribs and flat sides: symmetric, outward, as described."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from vig_world.assets.designs.design import TEAPOTS, TeapotDesign
from vig_world.assets.designs.teapot import MIRROR, PART_NAMES, TEAPOT_FACES, TEAPOT_PARTS, teapot_vertices

NEW = TEAPOTS["train"][23:]
ABOVE = [design for design in NEW if design.handle == "above"]
STRAIGHT = [design for design in NEW if design.handle == "straight"]
each_new = pytest.mark.parametrize("design", NEW, ids=lambda design: design.name)


def part(vertices: np.ndarray, name: str) -> np.ndarray:
    return vertices[TEAPOT_PARTS == PART_NAMES.index(name)]


def test_how_many_of_each() -> None:
    assert Counter(design.handle for design in TEAPOTS["train"]) == {"behind": 75, "above": 18, "straight": 4}
    assert sum(design.lobes > 0 for design in NEW) >= 7


@each_new
def test_symmetric_outward_and_without_slivers(design: TeapotDesign) -> None:
    vertices = teapot_vertices(design)
    np.testing.assert_array_equal(vertices[MIRROR] * np.array([1, -1, 1], np.float32), vertices)
    a, b, c = (vertices[TEAPOT_FACES[:, k]].astype(np.float64) for k in range(3))
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 1e-9  # twice the area, square metres
    volumes = np.sum(a * np.cross(b, c), axis=1) / 6.0
    surface = np.where(
        TEAPOT_PARTS[TEAPOT_FACES[:, 0]] == PART_NAMES.index("foot"), 0, TEAPOT_PARTS[TEAPOT_FACES[:, 0]]
    )
    assert np.bincount(surface, volumes)[[0, 1, 2, 4, 5]].min() > 0.0


@each_new
def test_it_stands_on_its_foot_with_the_spout_in_front(design: TeapotDesign) -> None:
    vertices = teapot_vertices(design)
    assert vertices[:, 2].min() == 0.0 and part(vertices, "foot")[:, 2].min() == 0.0
    assert TEAPOT_PARTS[vertices[:, 0].argmax()] == PART_NAMES.index("spout")


@pytest.mark.parametrize("design", ABOVE, ids=lambda design: design.name)
def test_a_handle_above_spans_the_lid_and_clears_the_knob(design: TeapotDesign) -> None:
    vertices = teapot_vertices(design)
    handle, knob = part(vertices, "handle"), part(vertices, "knob")
    assert handle[:, 2].max() == vertices[:, 2].max()
    assert handle[:, 0].min() < knob[:, 0].min() and handle[:, 0].max() > knob[:, 0].max()
    above_the_knob = handle[np.abs(handle[:, 0]) < 0.01]
    assert above_the_knob[:, 2].min() > knob[:, 2].max() + 0.004


@pytest.mark.parametrize("design", STRAIGHT, ids=lambda design: design.name)
def test_a_straight_handle_has_no_opening(design: TeapotDesign) -> None:
    """Across its direction it is as thick as two limbs that touch, all the way out."""
    handle = part(teapot_vertices(design), "handle").astype(np.float64)
    slope = np.radians(design.handle_rise)
    along = handle @ [-np.cos(slope), 0.0, np.sin(slope)]
    across = handle @ [np.sin(slope), 0.0, np.cos(slope)]
    outer = (along > np.quantile(along, 0.5)) & (along < np.quantile(along, 0.95))
    assert np.ptp(across[outer]) == pytest.approx(2.08 * design.handle_thickness, rel=0.1)


def test_ribs_are_as_deep_as_told_and_leave_rim_and_foot_round() -> None:
    plain = replace(TEAPOTS["train"][0], belly_aspect=1.0)
    ribbed = replace(plain, lobes=4, lobe_depth=0.05)
    ratio = np.hypot(*teapot_vertices(ribbed)[:, :2].T) / np.maximum(
        np.hypot(*teapot_vertices(plain)[:, :2].T), 1e-9
    )
    assert part(ratio, "body").max() == pytest.approx(
        1.05, abs=1e-3
    )  # 44 vertices around: one on every crest
    assert part(ratio, "body").min() >= 0.9499 or part(ratio, "body").min() == 0.0  # a pole has no radius
    np.testing.assert_allclose(part(ratio, "foot")[1:], 1.0, atol=1e-5)


def test_flat_sides_are_flat() -> None:
    """With four flat sides, 1 flat, the belly's ring is a square whose sides lie across x and y."""
    design = replace(TEAPOTS["train"][0], lobes=4, lobe_flatness=1.0)
    body = part(teapot_vertices(design), "body").astype(np.float64)
    belly = body[np.abs(body[:, 2] - body[np.abs(body[:, 0]).argmax(), 2]) < 1e-6]
    front = belly[np.abs(np.arctan2(belly[:, 1], belly[:, 0])) < 0.7]
    assert len(front) >= 9
    np.testing.assert_allclose(front[:, 0], front[0, 0], rtol=1e-6)
