"""Mug designs: one closed surface with one hole, outward, symmetric, hollow, well proportioned."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from tools.classes import drawn_mugs as drawn_module
from tools.classes.drawn_mugs import MIXING, draw_mug, drawn_mugs
from tools.classes.mug_flaws import flaws
from tools.classes.soundness import crossings
from vig_world.assets.mugs.design import MUGS, MugDesign
from vig_world.assets.mugs.mug import MUG_FACES, MUG_MIRROR, MUG_PARTS, PART_NAMES, POINTS, mug_vertices
from vig_world.mesh import face_edges, face_normals

ALL_MUGS = MUGS["train"] + MUGS["test"] + MUGS["validation"]
FEW_MUGS = ALL_MUGS[::12]
OTHER_MUGS = tuple(design for design in ALL_MUGS if design not in FEW_MUGS)
CLASSIC = MUGS["train"][0]


@pytest.fixture(scope="module")
def shapes() -> np.ndarray:
    """All named designs, (N, V, 3)."""
    return np.stack([mug_vertices(design) for design in ALL_MUGS])


def of_part(vertices: np.ndarray, part: str) -> np.ndarray:
    return vertices[..., MUG_PARTS == PART_NAMES.index(part), :]


def test_counts_names_and_types(shapes: np.ndarray) -> None:
    assert len(MUGS["train"]) == 112 and len(MUGS["test"]) == len(MUGS["validation"]) == 10
    assert len({design.name for design in ALL_MUGS}) == len(ALL_MUGS)
    assert 2000 <= len(MUG_PARTS) <= 2600 and MUG_FACES.dtype == np.int32
    assert set(MUG_PARTS) == set(range(len(PART_NAMES)))
    assert shapes.dtype == np.float32 and shapes.shape[1] == len(MUG_PARTS)


def test_one_closed_surface_with_the_hole_of_the_handle() -> None:
    edges = face_edges(MUG_FACES)
    directed = {(int(a), int(b)) for a, b in edges}
    assert len(directed) == len(edges), "an edge is used twice in the same direction"
    assert all((b, a) in directed for a, b in directed), "an edge lacks its second face"
    assert np.array_equal(np.unique(MUG_FACES), np.arange(len(MUG_PARTS))), "stray vertices"
    assert len(MUG_PARTS) - len(edges) // 2 + len(MUG_FACES) == 0, "Euler's number of a torus"
    assert trimesh.Trimesh(mug_vertices(CLASSIC), MUG_FACES, process=False).body_count == 1


def test_all_face_outward(shapes: np.ndarray) -> None:
    """The volume is that of the walls; the floor inside looks up, the underside down, the wall away."""
    for design, shape in zip(ALL_MUGS, shapes.astype(np.float64), strict=True):
        a, b, c = (shape[MUG_FACES[:, k]] for k in range(3))
        volume = np.sum(a * np.cross(b, c)) / 6.0
        outer = np.pi * np.ptp(shape[:, 1]) ** 2 / 4.0 * design.height
        assert 0.0 < volume < 0.62 * outer, design.name
    classic = shapes[0].astype(np.float64)
    normals, middles = face_normals(classic, MUG_FACES), classic[MUG_FACES].mean(1)
    part, away = MUG_PARTS[MUG_FACES[:, 0]], np.sum(normals[:, :2] * middles[:, :2], axis=1)
    side = (middles[:, 2] > 0.02) & (middles[:, 2] < 0.085)
    assert (away[side & (part == PART_NAMES.index("body"))] > 0.0).all()
    assert (away[side & (part == PART_NAMES.index("inside"))] < 0.0).all()
    assert normals[np.argmin(np.linalg.norm(middles, axis=1)), 2] < 0.0


def test_it_is_hollow(shapes: np.ndarray) -> None:
    """A line from above down the axis meets the floor, below a fifth of the height."""
    inside = of_part(shapes, "inside")
    assert (inside[..., 2].min(1) < 0.2 * shapes[..., 2].max(1)).all()
    assert (of_part(shapes, "rim")[..., 2].max(1) == shapes[..., 2].max(1)).mean() > 0.9


def test_mirror_symmetry_is_exact(shapes: np.ndarray) -> None:
    np.testing.assert_array_equal(shapes[:, MUG_MIRROR] * np.array([1, -1, 1], np.float32), shapes)
    np.testing.assert_array_equal(MUG_PARTS[MUG_MIRROR], MUG_PARTS)
    as_sets = [{frozenset(face.tolist()) for face in faces} for faces in (MUG_FACES, MUG_MIRROR[MUG_FACES])]
    assert as_sets[0] == as_sets[1]


def test_stance_and_front(shapes: np.ndarray) -> None:
    standing = np.flatnonzero(shapes[0][:, 2] == 0.0)
    assert len(standing) >= 44
    np.testing.assert_array_equal(shapes[:, standing, 2], 0.0)
    assert (shapes[..., 2].min(1) == 0.0).all()
    assert all(MUG_PARTS[shape[:, 0].argmax()] == PART_NAMES.index("handle") for shape in shapes)
    assert {name: PART_NAMES[MUG_PARTS[place]] for name, place in POINTS.items()} == {
        "handle": "handle", "rim": "rim", "base": "body"
    }  # fmt: skip
    assert (shapes[:, POINTS["handle"], 0] > 0.85 * shapes[..., 0].max(1)).all()


def test_heights_and_radii_are_those_of_the_design() -> None:
    mug = mug_vertices(MugDesign("plain", height=0.1, radius=0.04, wall=0.004))
    assert mug[:, 2].max() == pytest.approx(0.1, abs=1e-6)
    body, inside = of_part(mug, "body"), of_part(mug, "inside")
    middle = (np.abs(body[:, 2] - 0.05) < 0.02) & (body[:, 0] < 0.0)
    np.testing.assert_allclose(np.linalg.norm(body[middle, :2], axis=1), 0.04, atol=1e-6)
    middle = np.abs(inside[:, 2] - 0.05) < 0.02
    np.testing.assert_allclose(np.linalg.norm(inside[middle, :2], axis=1), 0.036, atol=1e-6)


def test_no_two_designs_are_alike(shapes: np.ndarray) -> None:
    for number, shape in enumerate(shapes):
        apart = np.linalg.norm(np.delete(shapes, number, axis=0) - shape, axis=-1).mean(axis=1)
        assert apart.min() > 0.0012, ALL_MUGS[number].name


@pytest.mark.parametrize("designs", [FEW_MUGS, pytest.param(OTHER_MUGS, marks=pytest.mark.slow)], ids=len)
def test_named_designs_have_no_flaws(designs: tuple[MugDesign, ...]) -> None:
    assert {design.name: found for design in designs if (found := flaws(design))} == {}


@pytest.mark.parametrize(
    ("design", "flaw"),
    [
        (replace(CLASSIC, handle_top=0.095), "the handle's places on the wall leave no room"),
        (replace(CLASSIC, wall=0.036), "it is not hollow"),
        (replace(CLASSIC, wall=0.0005), "the wall is too thin"),
        (replace(CLASSIC, handle_reach=0.006), "no finger fits the handle"),
        (replace(CLASSIC, handle_rise=85.0, handle_upper_roundness=3.5), "the handle rises above the rim"),
        (replace(CLASSIC, height=0.3), "it is 300 mm high, not 45 to 180"),
        (replace(CLASSIC, handle_reach=0.06), "the handle's reach over its width is 0.78, not 0.18 to 0.5"),
    ],
)
def test_a_broken_design_has_the_flaw(design: MugDesign, flaw: str) -> None:
    assert flaw in flaws(design)


def test_a_small_change_of_a_parameter_moves_vertices_a_little() -> None:
    before = mug_vertices(CLASSIC)
    for field in dataclasses.fields(CLASSIC)[1:]:
        value = getattr(CLASSIC, field.name)
        step = 1e-3 * max(abs(value), 0.01)
        after = mug_vertices(replace(CLASSIC, **{field.name: value + step}))
        assert np.abs(after - before).max() < 5e-4, field.name


def test_drawn_mugs_are_sound_and_a_function_of_the_seed() -> None:
    drawn = drawn_mugs(4)
    assert drawn_mugs(2) == drawn[:2] and drawn_mugs(2, seed=1) != drawn[:2]
    assert not any(flaws(design) for design in drawn)


def test_mixtures_take_every_parameter_and_ratios_are_undone() -> None:
    mixed = MIXING.mixture(np.random.default_rng(0), lambda group: MUGS["train"])
    assert mixed.keys() | {"name"} == {field.name for field in dataclasses.fields(MugDesign)}
    again = MugDesign(**MIXING.absolute(MIXING.relative(MUGS["train"][40])))
    np.testing.assert_allclose(mug_vertices(again), mug_vertices(MUGS["train"][40]), atol=5e-5)


def test_giving_up_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawn_module, "flaws", lambda design: ["bad"])
    monkeypatch.setattr(drawn_module, "MAX_TRIES", 2)
    with pytest.raises(RuntimeError, match="2 drawn mugs had flaws"):
        draw_mug(np.random.default_rng(0))


def test_crossings_of_two_boxes() -> None:
    """With a corner of one within the other, three edges of each cross the other's faces."""
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    vertices, faces = np.asarray(box.vertices), np.asarray(box.faces)

    def pair(shift: float) -> int:
        moved = vertices + shift * np.array([1.0, 0.93, 0.87])
        return crossings(np.concatenate([vertices, moved]), np.concatenate([faces, faces + len(vertices)]))

    assert pair(3.0) == 0
    assert pair(0.6) >= 6
    assert crossings(vertices, faces) == 0
