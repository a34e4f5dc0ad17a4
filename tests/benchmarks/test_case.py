"""The problem that all renderers are given."""

import numpy as np
import pytest

from benchmarks.case import GUESSES, Ours, make_case, subdivided
from vig.scene import ObjectClass
from vig_world.mesh import face_normals


@pytest.fixture(scope="module")
def standard():
    return make_case(150)


def test_a_subdivided_model_has_the_same_surface_in_every_shape(teapot: ObjectClass) -> None:
    model = teapot.shape_model
    fine = subdivided(model)
    assert len(fine.faces) == 4 * len(model.faces)
    # V - E + F stays: E edges give E vertices, 2 E + 3 F edges and 4 F faces.
    edges = 3 * len(model.faces) // 2
    assert len(fine.mean) == len(model.mean) + edges and len(fine.parts) == len(fine.mean)
    coefficients = np.random.default_rng(0).normal(size=(1, model.modes))
    whole, parts = (face_normals(m.vertices(coefficients)[0], m.faces) for m in (model, fine))
    # A face's normal, as long as twice its area, is four times that of each of its quarters.
    quarters = parts.reshape(4, -1, 3)
    np.testing.assert_allclose(quarters, np.broadcast_to(whole / 4, quarters.shape), atol=1e-9)


def test_the_standard_case_is_designs_and_lies_in_the_frame(standard) -> None:
    assert abs(standard.covered() - 7100) < 200
    assert len(standard.model.faces) == 5252 and len(standard.model.mean) == 2636
    assert len(standard.guesses) == GUESSES
    camera = standard.camera
    for points in standard.points():
        pixels = camera.focal * points[:, :2] / points[:, 2:] + [camera.cx, camera.cy]
        assert pixels.min() > 1 and pixels.max() < 149


def test_the_photo_is_seeded_and_shows_the_object_only_in_part(standard) -> None:
    np.testing.assert_array_equal(standard.photo, make_case(150).photo)
    assert standard.photo.min() >= 0 and standard.photo.max() <= 1
    ours = Ours(standard)
    found = ours.images()
    covered = found.coverage[0] > 0.5
    explained = float((found.posterior[0][covered] > 0.5).mean())
    assert 0.5 < explained < 0.95  # the rest is the occluder's


@pytest.mark.parametrize(("size", "subdivisions"), [(75, 0), (75, 1), (150, 0)])
def test_peers_are_given_the_pixels_that_we_see(size: int, subdivisions: int) -> None:
    case = make_case(size, subdivisions)
    assert Ours(case).covered() == pytest.approx(case.covered(), rel=0.01)
