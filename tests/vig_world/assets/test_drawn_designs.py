"""Random designs are pots: of a pot's size, closed, mirror symmetric, their parts held together."""

from __future__ import annotations

import numpy as np
import pytest

from vig_world.assets.designs import MIRROR, PART_NAMES, TEAPOT_FACES, TEAPOT_PARTS, teapot_vertices
from vig_world.assets.designs.drawn import drawn_design, drawn_designs
from vig_world.mesh import vertex_normals

DESIGNS = drawn_designs(40)


def part(vertices: np.ndarray, name: str) -> np.ndarray:
    return vertices[TEAPOT_PARTS == PART_NAMES.index(name)]


def test_a_design_is_a_pure_function_of_its_generator() -> None:
    first, again = (drawn_design(np.random.default_rng(4), "a") for _ in range(2))
    assert first == again != drawn_design(np.random.default_rng(5), "a")
    assert drawn_designs(10) == DESIGNS[:10]


@pytest.mark.parametrize("design", DESIGNS, ids=lambda design: design.name)
def test_a_design_is_a_pot(design) -> None:  # type: ignore[no-untyped-def]
    vertices = teapot_vertices(design)
    assert np.isfinite(vertices).all()
    np.testing.assert_array_equal(vertices[MIRROR] * [1, -1, 1], vertices)
    corners = vertices[TEAPOT_FACES].astype(np.float64)
    volume = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert 2e-4 < volume < 8e-3, "litres from .2 to 8, faces turned outwards"
    body, spout = part(vertices, "body"), part(vertices, "spout")
    assert spout[:, 0].max() > body[:, 0].max(), "the spout points to +X"
    assert np.isfinite(vertex_normals(vertices, TEAPOT_FACES)).all()


def test_a_bail_goes_over_the_lid_and_both_its_ends_are_in_the_body() -> None:
    bails = [design for design in DESIGNS if design.bail_height]
    assert 3 < len(bails) < 20
    for design in bails:
        vertices = teapot_vertices(design)
        handle, body = part(vertices, "handle"), part(vertices, "body")
        assert handle[:, 2].max() > vertices[TEAPOT_PARTS != PART_NAMES.index("handle"), 2].max() - 0.05
        assert handle[:, 2].max() > 1.3 * design.shoulder_height
        for side in (-1, 1):
            end = handle[np.argsort(side * handle[:, 0])[-20:]]
            assert np.abs(handle[:, 0]).max() <= np.abs(body[:, 0]).max() + 0.02
            assert end[:, 2].min() < design.shoulder_height, "it reaches down to the shoulder"
