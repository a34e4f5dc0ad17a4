"""The packaged mug class: found by name, made of the code's designs, near designs it has not seen."""

import numpy as np
import pytest

from tools.classes.mug import DRAWN_DESIGNS, MODES, TRAINING_SCENE_DESIGNS
from tools.classes.mug import mug as coded_mug
from tools.classes.shapes import CodedClass, relative_distance
from tools.classes.soundness import crossings
from vig.scene import ObjectClass
from vig.scene.symmetry import Symmetry
from vig_world.assets.held_out import held_out_designs_of
from vig_world.assets.mugs.design import MUGS
from vig_world.assets.mugs.mug import MUG_FACES, MUG_PARTS, PART_NAMES, mug_vertices
from vig_world.assets.target import draw_shape, shape_vertices
from vig_world.composition.place import zone_weights

FEW = 40
"""Random designs of the builder that are compared: a longer list begins with the shorter one."""


@pytest.fixture(scope="module")
def mug() -> ObjectClass:
    return ObjectClass.load("mug")


@pytest.fixture(scope="module")
def coded() -> CodedClass:
    """The class by its code, with few of the random designs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tools.classes.mug.DRAWN_DESIGNS", 1)  # of which only its shape model is learned
        patch.setattr("tools.classes.mug.TRAINING_SCENE_DESIGNS", FEW)
        return coded_mug.__wrapped__()


def test_the_pack_is_found_by_its_name(mug: ObjectClass) -> None:
    assert (mug.name, mug.front, mug.symmetry, mug.mirror) == ("mug", "the handle", Symmetry.NONE, True)
    assert mug.shape_model.modes == MODES <= 16 and mug.shape_model.part_names == PART_NAMES
    np.testing.assert_array_equal(mug.shape_model.faces, MUG_FACES)
    np.testing.assert_array_equal(mug.shape_model.parts, MUG_PARTS)
    assert mug.transfer is not None and mug.transfer.shape == (MODES + 1, len(MUG_PARTS), 9)
    assert set(mug.points) == {"handle", "rim", "base"} and zone_weights(mug)
    assert np.ptp(mug.shape_model.mean[:, 2]) == pytest.approx(2 * mug.target_height, rel=0.15)
    longest = np.ptp(mug.shape_model.mean, axis=0).max()
    assert mug.viewing_distance == pytest.approx(1.5 * longest, rel=0.1)


def test_the_pack_holds_the_designs_of_the_code(mug: ObjectClass) -> None:
    held = held_out_designs_of(mug)
    assert held is not None and TRAINING_SCENE_DESIGNS <= DRAWN_DESIGNS
    assert held.splits == ("test",) * 10 + ("validation",) * 10 + ("train",) * (112 + TRAINING_SCENE_DESIGNS)
    named = np.stack([mug_vertices(design) for design in MUGS["test"] + MUGS["validation"]])
    np.testing.assert_allclose(held.vertices[: len(named)], named, atol=1e-6)
    assert (
        held.names[:2] == ("harvest", "cottage") and held.names[-1] == f"drawn 0.{TRAINING_SCENE_DESIGNS - 1}"
    )
    # Those that scenes were made of when their vertices lay in the pack.
    mean = 1000 * np.abs(held.vertices).mean((0, 1), dtype=np.float64)
    np.testing.assert_allclose(mean, [29.439405, 19.664970, 44.120673], atol=1e-5)


@pytest.mark.slow
def test_the_designs_are_those_that_the_builder_draws(mug: ObjectClass, coded: CodedClass) -> None:
    held, drawn = held_out_designs_of(mug), coded.scenes
    assert held is not None
    designs = [(design.name, split) for split, of_split in drawn.items() for design in of_split]
    assert list(zip(held.names, held.splits, strict=True))[: len(designs)] == designs
    found = held.vertices[: len(designs)][-FEW:]
    np.testing.assert_allclose(found, coded.vertices_of(drawn["train"][-FEW:]), atol=1e-6)


@pytest.mark.parametrize("designs", [MUGS["test"], MUGS["validation"]], ids=["test", "validation"])
def test_designs_beyond_training_are_within_a_hundredth_of_their_size(mug: ObjectClass, designs) -> None:
    vertices = np.stack([mug_vertices(design) for design in designs])
    errors = [relative_distance(mug.shape_model, vertices, count) for count in (4, 8, MODES)]
    assert errors[0] > errors[1] > errors[2] and errors[2] < 0.01


def test_shapes_of_scenes_stand_and_rarely_cut_into_themselves(mug: ObjectClass) -> None:
    rng = np.random.default_rng(0)
    shapes = [shape_vertices(*draw_shape(rng, mug, "train"), mug) for _ in range(12)]
    assert all(shape[:, 2].min() == pytest.approx(0.0, abs=1e-6) for shape in shapes)
    assert sum(crossings(shape, MUG_FACES) > 0 for shape in shapes) <= 2


def test_extremes_of_every_component_keep_a_wall(mug: ObjectClass) -> None:
    """Two deviations each way the volume of the walls stays positive, and below that of a filled mug."""
    model = mug.shape_model
    ends = 2.0 * np.concatenate([np.eye(model.modes), -np.eye(model.modes)])
    for shape in model.vertices(ends).astype(np.float64):
        a, b, c = (shape[MUG_FACES[:, k]] for k in range(3))
        filled = np.pi / 4.0 * np.ptp(shape[:, 1]) ** 2 * shape[:, 2].max()
        assert 0.03 < np.sum(a * np.cross(b, c)) / 6.0 / filled < 0.6
