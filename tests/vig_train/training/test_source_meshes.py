"""Tests of the user's own meshes as the studio draws them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.source_meshes import RED, box, piece, two_boxes
from tests.toys import toy
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.assets.source_meshes import FILE, SourceMesh, corner_normals, save, source_meshes_of
from vig_world.studio.source_objects import DARK, draw_paint
from vig_world.studio.studio import Studio, StudioSettings


def test_normals_are_smooth_on_a_sphere_and_sharp_on_a_box() -> None:
    sphere = trimesh.creation.icosphere(3)
    vertices, faces = np.array(sphere.vertices), np.array(sphere.faces)
    normals = corner_normals(vertices, faces)
    assert np.abs(normals - vertices[faces]).max() < 0.03
    cube = trimesh.creation.box()
    flat = corner_normals(np.array(cube.vertices), np.array(cube.faces))
    np.testing.assert_allclose(np.abs(flat).max(2), 1, atol=1e-9)
    np.testing.assert_allclose(flat, np.repeat(cube.face_normals[:, None], 3, 1), atol=1e-9)


def test_a_face_that_is_wound_the_other_way_does_not_turn_its_neighbours_normals() -> None:
    sphere = trimesh.creation.icosphere(3)
    vertices, faces = np.array(sphere.vertices), np.array(sphere.faces)
    faces[::3] = faces[::3, ::-1]
    normals = corner_normals(vertices, faces)
    cosine = np.abs((normals * vertices[faces]).sum(2))
    assert cosine.min() > 0.99


def test_vertices_move_with_the_template() -> None:
    template = np.array(box((0.4, 0.2, 0.2), (0, 0, 0.1)).vertices, np.float32)
    mesh = two_boxes(template)
    np.testing.assert_allclose(mesh.follow_template(template), mesh.vertices, atol=1e-7)
    np.testing.assert_allclose(
        mesh.follow_template(template + [0.1, 0, 0]), mesh.vertices + [0.1, 0, 0], atol=1e-6
    )
    higher = mesh.follow_template(template * [1, 1, 1.5])
    assert np.ptp(higher[:, 2]) == pytest.approx(0.3, rel=0.02)


def test_dark_materials_mostly_stay_dark_and_others_change() -> None:
    mesh = two_boxes(np.zeros((4, 3), np.float32) + np.eye(4, 3, dtype=np.float32))
    paints = [draw_paint(np.random.default_rng(seed), mesh, own=0.0) for seed in range(200)]
    dark = np.mean([paint.textures[1].max() < 2 * DARK for paint in paints])
    hues = np.array([paint.textures[0].mean((0, 1)) for paint in paints])
    assert 0.8 < dark < 0.99
    assert (hues[:, 1] > hues[:, 0]).mean() > 0.15, "not red in many"
    own = [
        draw_paint(np.random.default_rng(seed), mesh, own=1.0).textures[0].mean((0, 1)) for seed in range(50)
    ]
    assert all(colour[0] > 3 * colour[1] for colour in own)


def test_glass_is_dark_or_lets_the_inside_be_seen() -> None:
    pieces = [piece(box((1, 1, 1), (0, 0, 0)), RED), piece(box((2, 2, 2), (0, 0, 0)), (0.5, 0.5, 0.5), 0.3)]
    mesh = SourceMesh.of(pieces, np.eye(3), np.zeros(3), np.eye(4, 3), -1, "train")
    paints = [draw_paint(np.random.default_rng(seed), mesh, own=0.5) for seed in range(100)]
    drawn = np.array([paint.drawn for paint in paints])
    assert drawn[:, 0].all() and 0.5 < drawn[:, 1].mean() < 0.9
    assert all(paint.textures[1].max() <= 0.15 for paint in paints)


def test_clear_glass_is_no_part_of_the_object_as_drawn(pack: ObjectClass) -> None:
    """Its depth and silhouette are those of the inside."""
    template = pack.shape_model.mean
    size = np.ptp(template, axis=0)
    pieces = [piece(box(size, template.mean(0)), RED), piece(box(3 * size, template.mean(0)), RED, 0.3)]
    mesh = SourceMesh.of(pieces, np.eye(3), np.zeros(3), template, -1, "train")
    save(pack.folder / "build" / FILE, [mesh])
    source_meshes_of.cache_clear()
    studio = Studio(ObjectClass.load(pack.folder), StudioSettings(source=1.0, absent=0.0))
    shown = {len(studio.draw(0, index).faces) for index in range(24)}
    assert shown == {12, 24}


@pytest.fixture
def pack(tmp_path: Path) -> ObjectClass:
    """A pack of boxes whose front is black, and of a mesh that is for the test."""
    object_class = toy("fin")
    object_class.save(tmp_path)
    template = object_class.shape_model.mean
    save(tmp_path / "build" / FILE, [two_boxes(template), two_boxes(template, "test")])
    return ObjectClass.load(tmp_path)


def test_a_pack_gives_its_meshes_back(pack: ObjectClass) -> None:
    first, second = source_meshes_of(pack)
    expected = two_boxes(pack.shape_model.mean)
    for name in ("vertices", "faces", "uv", "material", "registered"):
        np.testing.assert_array_equal(getattr(first, name), getattr(expected, name))
    np.testing.assert_allclose(first.textures[0], expected.textures[0], rtol=1e-3)
    assert (first.split, second.split) == ("train", "test")
    assert source_meshes_of(replace(pack, folder=None)) == ()


def test_damaged_meshes_are_refused_in_one_line(pack: ObjectClass) -> None:
    assert pack.folder is not None
    (pack.folder / "build" / FILE).write_bytes(b"none")
    source_meshes_of.cache_clear()
    with pytest.raises(UserError, match="expected the meshes of a class"):
        source_meshes_of(pack)


def test_the_studio_draws_the_meshes_of_its_split_with_their_colours(pack: ObjectClass) -> None:
    """Seen from the front all is black, seen from behind red."""
    settings = StudioSettings(
        source=1.0, own_colours=1.0, occluded=0.0, absent=0.0, small=0.0, rolled=0.0, level=1.0
    )
    studio = Studio(pack, settings)
    assert len(studio.models) == 1 and not Studio(pack, settings, "validation").models
    sides: dict[bool, list[float]] = {True: [], False: []}
    for index in range(60):
        drawn = studio.draw(0, index)
        azimuth = float(drawn.latents[pack.shape_model.modes])
        seen = drawn.image[drawn.visible > 250].astype(float)
        towards = np.sin(azimuth)  # the front, +X, towards the eye at azimuth 90 degrees
        if abs(towards) > 0.95 and len(seen):
            sides[bool(towards > 0)].append(float(np.median(seen[:, 0] - seen[:, 1])))
    assert sides[True] and sides[False]
    near, away = np.median(sides[True]), np.median(sides[False])
    assert away > near + 20, (near, away)
