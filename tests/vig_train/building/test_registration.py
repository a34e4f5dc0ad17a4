import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from vig_train.building.acceptance import folded_share, quality_of
from vig_train.building.model import fit_components
from vig_train.building.pose import (
    PointCloud,
    align_clouds,
    axis_of_revolution,
    class_symmetry,
    cube_turns,
    levelling_rotation,
    rotation_to_vertical,
)
from vig_train.building.registration import DeformationGraph, Registration
from vig_train.building.surface import SurfaceSample, sample_surface, vertex_areas, visible_surface
from vig_train.building.symmetries import MIRROR_Y, mirror_map, rotation_projection
from vig_train.building.template import closed_template, outer_surface, remesh, split_long_edges
from vig_world.assets.designs.design import TEAPOTS
from vig_world.assets.designs.teapot import TEAPOT_FACES, teapot_vertices


def design(name: str) -> np.ndarray:
    return teapot_vertices(next(each for each in TEAPOTS["train"] if each.name == name)).astype(float)


@pytest.fixture(scope="module")
def pot() -> tuple[np.ndarray, SurfaceSample]:
    vertices = design("classic")
    return vertices, visible_surface(vertices, TEAPOT_FACES)


@pytest.fixture(scope="module")
def template(pot: tuple[np.ndarray, SurfaceSample]) -> tuple[np.ndarray, np.ndarray]:
    return closed_template(pot[0], TEAPOT_FACES, pot[1], 2000)


def test_a_visible_surface_has_no_inner_walls_and_points_outward(
    pot: tuple[np.ndarray, SurfaceSample],
) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    nested = trimesh.util.concatenate([ball, trimesh.creation.icosphere(subdivisions=2, radius=0.6)])
    faces = nested.faces[:, ::-1]  # turned inside out
    seen = visible_surface(np.asarray(nested.vertices), np.asarray(faces), 3000)
    assert np.linalg.norm(seen.points, axis=1).min() > 0.98
    assert ((seen.points * seen.normals).sum(1) > 0.98).all()
    assert 2500 < len(seen.points) <= 3010


def test_parts_that_overlap_become_one_closed_surface(
    pot: tuple[np.ndarray, SurfaceSample], template: tuple[np.ndarray, np.ndarray]
) -> None:
    mesh = trimesh.Trimesh(*template, process=False)
    assert mesh.is_watertight and mesh.body_count == 1 and mesh.volume > 0
    assert mesh.euler_number == 0  # the handle's hole stays
    assert abs(len(mesh.vertices) - 2000) <= 20
    away = cKDTree(pot[1].points).query(mesh.vertices)[0]
    assert away.max() < 0.02 * np.ptp(pot[0], axis=0).max()


def test_an_open_soup_is_closed() -> None:
    box = trimesh.creation.box((1, 0.5, 0.5)).subdivide().subdivide()
    soup = box.triangles[1:].reshape(-1, 3)  # a face is missing, nothing is welded
    faces = np.arange(len(soup)).reshape(-1, 3)
    closed = trimesh.Trimesh(*outer_surface(soup, faces, visible_surface(soup, faces)), process=False)
    assert closed.is_watertight
    # A thin shell where air gets in.
    assert closed.volume == pytest.approx(0.25, rel=0.03) or closed.volume < 0.025


def test_vertices_are_denser_where_the_surface_curves() -> None:
    egg = trimesh.creation.icosphere(subdivisions=4)
    egg.apply_scale((0.3, 0.3, 1.0))
    vertices, faces = remesh(np.asarray(egg.vertices), np.asarray(egg.faces), 600)
    tip = np.abs(vertices[:, 2]) > 0.9
    areas = vertex_areas(vertices, faces)
    assert tip.mean() > 1.5 * areas[tip].sum() / areas.sum()


@pytest.mark.parametrize("name, most", [("brown betty", 0.01), ("squat yixing", 0.013)])
def test_places_are_met_where_the_design_has_them(
    pot: tuple[np.ndarray, SurfaceSample], template: tuple[np.ndarray, np.ndarray], name: str, most: float
) -> None:
    first, second = pot[0], design(name)
    target = visible_surface(second, TEAPOT_FACES)
    size = np.ptp(second, axis=0).max()
    vertices, faces = template
    face, weights = sample_surface(first, TEAPOT_FACES, 300_000)
    corners = TEAPOT_FACES[face]
    _, nearest = cKDTree(np.einsum("nk,nkd->nd", weights, first[corners])).query(vertices)
    truth = np.einsum("nk,nkd->nd", weights[nearest], second[corners[nearest]])
    seen = cKDTree(target.points).query(truth)[0] < 0.02 * size
    found = Registration(vertices, faces).onto(target)
    error = np.linalg.norm(found - truth, axis=1)[seen] / size
    before = np.linalg.norm(vertices - truth, axis=1)[seen] / size
    assert error.mean() < most < 0.5 * before.mean()
    quality = quality_of(vertices, found, faces, target)
    assert quality.mean < 0.006 and not quality.reason
    assert folded_share(found, faces) < 0.02


def test_a_rig_at_rest_leaves_the_template_and_has_no_differences() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    for nodes in (1, 30, 250):
        rig = DeformationGraph.of(vertices, faces, nodes)
        assert rig.skinning @ rig.identity == pytest.approx(vertices, abs=1e-12)
        assert abs(rig.smoothness @ rig.identity).max(initial=0) < 1e-12
        linear, offset = np.array([[1, 0.2, 0], [0, 0.8, 0.1], [0.3, 0, 1.1]]), np.array([1.0, 2, 3])
        maps = rig.identity.reshape(-1, 4, 3) @ linear.T
        maps[:, 3] += offset
        assert rig.skinning @ maps.reshape(-1, 3) == pytest.approx(vertices @ linear.T + offset, abs=1e-12)
        assert abs(rig.smoothness @ maps.reshape(-1, 3)).max(initial=0) < 1e-12


def test_meshes_turned_at_random_come_into_one_pose(pot: tuple[np.ndarray, SurfaceSample]) -> None:
    names = ["classic", "brown betty", "globe", "squat yixing"]
    turns = [np.eye(3), cube_turns()[7], Rotation.from_euler("xyz", (30, -50, 100), degrees=True).as_matrix()]
    turns.append(turns[2].T)
    clouds = []
    for name, turn in zip(names, turns, strict=True):
        clouds.append(
            PointCloud.from_surface(
                visible_surface(design(name), TEAPOT_FACES, 6000).transform(turn, np.zeros(3))
            )
        )
    first, found, _ = align_clouds(clouds)
    for turn, rotation in zip(turns, found, strict=True):
        off = rotation @ turn @ (found[first] @ turns[first]).T
        assert np.degrees(np.arccos((np.trace(off) - 1) / 2)) < 8


def test_symmetries_are_found() -> None:
    def shape(parts: list[trimesh.Trimesh]) -> str:
        mesh = trimesh.util.concatenate(parts)
        seen = visible_surface(np.asarray(mesh.vertices), np.asarray(mesh.faces), 6000)
        return class_symmetry([PointCloud.from_surface(seen)]).symmetry

    post = trimesh.creation.cylinder(0.4, 1.5, sections=64)
    fins = [trimesh.creation.box((0.5, 0.15, 0.8)) for _ in range(2)]
    fins[0].apply_translation((0.5, 0, 0))
    fins[1].apply_translation((-0.5, 0, 0))
    assert shape([post]) == "any-turn"
    assert shape([post, *fins]) == "half-turn"
    assert shape([post, fins[0]]) == "none"
    # A spout and a handle are a small share of a surface, and tell the view all the same.
    spout = trimesh.creation.cylinder(0.05, 0.4, sections=24)
    spout.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0), (0, 0, 0)))
    spout.apply_translation((0.55, 0, 0))
    assert shape([post, spout]) == "none"


def test_a_foot_is_put_level() -> None:
    box = trimesh.creation.box((1, 0.8, 1.5)).subdivide().subdivide().subdivide()
    tilt = Rotation.from_euler("xy", (4, -6), degrees=True).as_matrix()
    seen = visible_surface(np.asarray(box.vertices) @ tilt.T, np.asarray(box.faces), 4000)
    assert np.degrees(np.arccos((levelling_rotation(seen) @ tilt)[2, 2])) < 0.5


def test_the_axis_of_a_thing_with_a_handle_is_found_however_it_lies() -> None:
    bottle = trimesh.creation.revolve([[0, 0], [0.3, 0], [0.5, 0.6], [0.15, 1.0], [0.15, 1.4], [0, 1.4]])
    handle = trimesh.creation.box((0.3, 0.08, 0.08))
    handle.apply_translation((0.45, 0, 1.0))
    mesh = trimesh.util.concatenate([bottle.subdivide(), handle])
    for angles in ((10, -7, 0), (80, 12, 40)):
        lies = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        seen = visible_surface(np.asarray(mesh.vertices) @ lies.T, np.asarray(mesh.faces), 4000)
        axis = axis_of_revolution(PointCloud.from_surface(seen), np.array([0.0, 0.0, 1.0]))
        assert abs(axis @ lies[:, 2]) > np.cos(np.radians(5))
        assert (rotation_to_vertical(axis, lies[:, 2]) @ lies[:, 2])[2] > np.cos(np.radians(5))
        assert (rotation_to_vertical(axis, -lies[:, 2]) @ lies[:, 2])[2] < -np.cos(np.radians(5))


def test_long_edges_are_cut_and_what_is_closed_stays_closed() -> None:
    strips = trimesh.creation.cylinder(0.4, 3, sections=12)
    points, faces = split_long_edges(np.asarray(strips.vertices), np.asarray(strips.faces), 0.1)
    mesh = trimesh.Trimesh(points, faces, process=False)
    assert mesh.edges_unique_length.max() <= 0.1
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(strips.volume)
    template = trimesh.Trimesh(*remesh(points, faces, 500), process=False)
    assert folded_share(np.asarray(template.vertices), template.faces) == 0, (
        "no slivers, whatever the file's are"
    )


def test_a_round_map_leaves_what_is_round_and_makes_the_rest_so() -> None:
    post = trimesh.creation.icosphere(subdivisions=3)
    vertices = np.asarray(post.vertices) * (1, 1, 2)
    made_round = rotation_projection(vertices, np.asarray(post.faces))
    away = vertices[:, :2] / np.linalg.norm(vertices[:, :2], axis=1, keepdims=True).clip(1e-9)
    swollen = np.concatenate([away * np.cos(vertices[:, 2:]), 0.3 * vertices[:, 2:]], axis=1)
    assert np.abs(made_round(swollen) - swollen)[np.abs(vertices[:, 2]) < 1.8].max() < 0.1
    leaning = np.stack([vertices[:, 2], 0 * vertices[:, 0], vertices[:, 0]], axis=1)
    assert np.abs(made_round(leaning)).mean() < 0.2 * np.abs(leaning).mean()


def test_a_mirror_map_gives_mirror_images(template: tuple[np.ndarray, np.ndarray]) -> None:
    vertices, faces = template
    image = (mirror_map(vertices, faces) @ vertices) * MIRROR_Y
    assert np.linalg.norm(image - vertices, axis=1).mean() < 0.01 * np.ptp(vertices, axis=0).max()


def test_the_model_holds_what_the_shapes_have_in_common() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    mean, areas = np.asarray(ball.vertices), vertex_areas(np.asarray(ball.vertices), np.asarray(ball.faces))
    rng = np.random.default_rng(0)
    ways = np.stack([mean * [1, 0, 0], mean * [0, 0, 1]])
    shapes = mean + np.einsum("nk,kvd->nvd", rng.normal(0, 0.2, (8, 2)), ways)
    model = fit_components(shapes, areas / areas.sum())
    assert len(model.basis) == 2 and model.amplitude == 0
    assert model.errors[2] < 1e-9 < model.errors[0]
    assert model.ratio.sum() == pytest.approx(1)
