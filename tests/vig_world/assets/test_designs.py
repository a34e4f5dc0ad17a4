"""Teapot designs: closed, outward, symmetric, well proportioned; linear combinations stay teapots."""

import dataclasses

import numpy as np
import pytest

from tools.classes.teapot_flaws import folds, inside
from vig_world.assets.designs.design import TEAPOTS, TeapotDesign
from vig_world.assets.designs.teapot import MIRROR, PART_NAMES, TEAPOT_FACES, TEAPOT_PARTS, teapot_vertices
from vig_world.mesh import face_edges

ORIGINAL = TEAPOTS["train"][:23]
"""The designs of version 0.1; bounds of size and of principal components below are theirs."""
ALL_DESIGNS = ORIGINAL + TEAPOTS["test"] + TEAPOTS["validation"]
MODES = 10
# Body and foot are one surface; the other parts are closed by themselves.
SURFACES = {"body and foot": (0, 3), "lid": (1,), "knob": (2,), "spout": (4,), "handle": (5,)}
each_design = pytest.mark.parametrize("design", ALL_DESIGNS, ids=lambda design: design.name)


def surface_faces(parts: tuple[int, ...]) -> np.ndarray:
    return TEAPOT_FACES[np.isin(TEAPOT_PARTS[TEAPOT_FACES[:, 0]], parts)]


def signed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6.0)


def principal_components() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (V, 3), components of 1 standard deviation (MODES, V, 3), fractions of variance (N,)."""
    designs = np.stack([teapot_vertices(design) for design in ORIGINAL]).astype(np.float64)
    mean = designs.mean(axis=0)
    _, size, axes = np.linalg.svd((designs - mean).reshape(len(designs), -1), full_matrices=False)
    deviation = size / np.sqrt(len(designs) - 1)
    basis = (deviation[:, None] * axes)[:MODES].reshape(MODES, *mean.shape)
    return mean, basis, size**2 / np.sum(size**2)


def extreme_shapes() -> list[tuple[str, np.ndarray]]:
    """The mean moved 2 standard deviations each way along each component."""
    mean, basis, _ = principal_components()
    return [(f"{sign:+d} sd of {k}", mean + sign * basis[k]) for k in range(MODES) for sign in (-2, 2)]


def test_counts_names_and_types() -> None:
    assert len(TEAPOTS["train"]) == 97 and len(TEAPOTS["test"]) == len(TEAPOTS["validation"]) == 8
    names = [design.name for design in TEAPOTS["train"] + TEAPOTS["test"] + TEAPOTS["validation"]]
    assert len(set(names)) == len(names)
    assert 2400 <= len(TEAPOT_PARTS) <= 2800 and 4800 <= len(TEAPOT_FACES) <= 5400
    assert TEAPOT_FACES.dtype == np.int32 and set(TEAPOT_PARTS) == set(range(len(PART_NAMES)))
    vertices = teapot_vertices(TEAPOTS["train"][0])
    assert vertices.dtype == np.float32 and vertices.shape == (len(TEAPOT_PARTS), 3)


@pytest.mark.parametrize("parts", SURFACES.values(), ids=SURFACES.keys())
def test_every_part_is_a_closed_sphere(parts: tuple[int, ...]) -> None:
    faces = surface_faces(parts)
    edges = face_edges(faces)
    directed = {(int(a), int(b)) for a, b in edges}
    assert len(directed) == len(edges), "an edge is used twice in the same direction"
    assert all((b, a) in directed for a, b in directed), "an edge lacks its second face"
    vertices = np.unique(faces)
    assert np.array_equal(vertices, np.flatnonzero(np.isin(TEAPOT_PARTS, parts))), "stray vertices"
    assert len(vertices) - len(edges) // 2 + len(faces) == 2, "Euler's number of a sphere"


@each_design
def test_parts_face_outward_without_slivers(design: TeapotDesign) -> None:
    vertices = teapot_vertices(design)
    assert np.isfinite(vertices).all()
    for parts in SURFACES.values():
        assert signed_volume(vertices, surface_faces(parts)) > 0.0
    a, b, c = (vertices[TEAPOT_FACES[:, k]].astype(np.float64) for k in range(3))
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 1e-9  # twice the area, square metres


@each_design
def test_mirror_symmetry_is_exact(design: TeapotDesign) -> None:
    vertices = teapot_vertices(design)
    np.testing.assert_array_equal(vertices[MIRROR] * np.array([1, -1, 1], np.float32), vertices)


def test_mirror_maps_faces_to_faces_and_parts_to_parts() -> None:
    def as_set(faces: np.ndarray) -> set[frozenset[int]]:
        return {frozenset(face.tolist()) for face in faces}

    np.testing.assert_array_equal(MIRROR[MIRROR], np.arange(len(MIRROR)))
    np.testing.assert_array_equal(TEAPOT_PARTS[MIRROR], TEAPOT_PARTS)
    assert as_set(MIRROR[TEAPOT_FACES]) == as_set(TEAPOT_FACES)


@each_design
def test_proportions_and_stance(design: TeapotDesign) -> None:
    vertices = teapot_vertices(design)
    length, width, height = np.ptp(vertices, axis=0)
    assert 0.25 <= length <= 0.31
    assert 0.48 <= height / length <= 0.63
    assert 0.62 <= width / length <= 0.85
    x, z = vertices[:, 0], vertices[:, 2]
    assert TEAPOT_PARTS[np.argmax(x)] == PART_NAMES.index("spout")
    assert TEAPOT_PARTS[np.argmin(x)] == PART_NAMES.index("handle")
    assert TEAPOT_PARTS[np.argmax(z)] == PART_NAMES.index("knob")


def test_the_same_vertices_stand_on_z_zero_in_every_shape() -> None:
    standing = np.flatnonzero(teapot_vertices(TEAPOTS["train"][0])[:, 2] == 0.0)
    assert len(standing) >= 40 and set(TEAPOT_PARTS[standing]) == {PART_NAMES.index("foot")}
    shapes = [teapot_vertices(design) for design in ALL_DESIGNS] + [shape for _, shape in extreme_shapes()]
    for shape in shapes:
        np.testing.assert_allclose(shape[standing, 2], 0.0, atol=1e-12)
        assert shape[:, 2].min() >= -1e-12


def test_mean_length() -> None:
    lengths = [np.ptp(teapot_vertices(design)[:, 0]) for design in ORIGINAL]
    assert np.mean(lengths) == pytest.approx(0.28, abs=0.01)


def test_ten_components_hold_most_of_the_variety_but_not_all() -> None:
    _, basis, fraction = principal_components()
    held = float(fraction[:MODES].sum())
    print(f"{MODES} components hold {held:.3f} of the variance of {len(ORIGINAL)} designs")
    assert 0.90 <= held <= 0.995
    assert fraction[0] < 0.6, "one component alone should not be the whole class"
    vertex_motion = np.sqrt(np.mean(np.sum(basis**2, axis=-1), axis=1))
    assert vertex_motion[0] > 0.003 and vertex_motion[-1] > 0.0003  # metres per standard deviation


def test_extremes_of_every_component_keep_their_faces_outward() -> None:
    reference = teapot_vertices(TEAPOTS["train"][0])
    body, lid = surface_faces((0,)), surface_faces((1,))
    for name, shape in [("design 0", reference), *extreme_shapes()]:
        for surface, parts in SURFACES.items():
            assert signed_volume(shape, surface_faces(parts)) > 0.0, (name, surface)
        for faces in (body, lid):
            a, b, c = (shape[faces[:, k]] for k in range(3))
            normal, centre = np.cross(b - a, c - a), (a + b + c) / 3.0
            outward = np.sum(normal[:, :2] * centre[:, :2], axis=1)
            underside = normal[:, 2] < -0.99 * np.linalg.norm(normal, axis=1)  # of the lid, level
            # A wall may overhang or recede, but never faces both inward and down.
            assert np.all((outward > 0.0) | (normal[:, 2] > 0.0) | underside), name


@pytest.mark.parametrize(("part", "around", "rings"), [("spout", 20, 21), ("handle", 12, 38)])
def test_tubes_never_fold_even_at_the_extremes(part: str, around: int, rings: int) -> None:
    own = np.flatnonzero(TEAPOT_PARTS == PART_NAMES.index(part))
    start = 1 + around // 2  # after the hidden cap's pole and half ring
    shapes = [(design.name, teapot_vertices(design).astype(np.float64)) for design in ALL_DESIGNS]
    for name, shape in shapes + extreme_shapes():
        tube = shape[own[start : start + around * rings]].reshape(rings, around, 3)
        assert not folds(tube), name


@pytest.mark.parametrize("part", ["spout", "handle"])
def test_ends_of_spout_and_handle_hide_in_the_body(part: str) -> None:
    own = np.flatnonzero(TEAPOT_PARTS == PART_NAMES.index(part))
    caps = own[:11] if part == "spout" else np.concatenate([own[:7], own[-7:]])
    body = surface_faces((0, 3))
    shapes = [(design.name, teapot_vertices(design).astype(np.float64)) for design in ALL_DESIGNS]
    for name, shape in shapes + extreme_shapes():
        assert inside(shape[caps], shape, body).all(), name


def test_no_two_designs_are_alike() -> None:
    """Their vertices lie 3 mm apart or more in the mean, so a split's designs are its own."""
    designs = TEAPOTS["train"] + TEAPOTS["test"] + TEAPOTS["validation"]
    shapes = np.stack([teapot_vertices(design) for design in designs])
    for number, shape in enumerate(shapes):
        apart = np.linalg.norm(np.delete(shapes, number, axis=0) - shape, axis=-1).mean(axis=1)
        assert apart.min() > 0.003, designs[number].name


def test_a_small_change_of_a_parameter_moves_vertices_a_little() -> None:
    base = TEAPOTS["train"][0]
    before = teapot_vertices(base)
    for field in dataclasses.fields(base):
        value = getattr(base, field.name)
        if field.name in ("name", "handle", "lobes"):
            continue
        step = 1e-3 * max(abs(value), 0.01)
        after = teapot_vertices(dataclasses.replace(base, **{field.name: value + step}))
        assert np.abs(after - before).max() < 5e-4, field.name


def test_designs_are_read_in_the_order_and_with_the_values_of_the_file() -> None:
    utah = TEAPOTS["train"][1]
    assert [design.name for design in TEAPOTS["train"][:3]] == ["classic", "utah", "brown betty"]
    assert TEAPOTS["test"][0].name == "windsor"
    assert (utah.belly_radius, utah.spout_base_angle, utah.handle_thickness) == (0.095, 22.0, 0.012)
    assert utah.spout_tip_radius == TeapotDesign("default").spout_tip_radius  # not in the file
