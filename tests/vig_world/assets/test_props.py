"""Props: each family gives closed, outward, textured meshes of a household size; same seed, same bytes."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from vig_world.assets.fixtures import HOLDERS
from vig_world.assets.props import FAMILIES, ZONE_NAMES, ZONES, families
from vig_world.assets.props.shapes import (
    blob,
    box,
    extrude,
    hoop,
    moved,
    relief,
    revolve,
    rounded,
    scaled,
    smooth,
    superellipse,
    tube,
    vessel,
)
from vig_world.mesh import Mesh, face_normals

SEEDS = range(5)
TALL = ("bottle", "carton", "vase_plant", "lamp", "pen_pot")
LONG = ("keyboard", "table_runner", "frying_pan", "saucepan", "cutting_board", "paper_sheets", "bread")


def volume(mesh: Mesh) -> float:
    points = mesh.vertices.astype(np.float64)
    return float(np.einsum("fi,fi->", points[mesh.faces[:, 0]], face_normals(points, mesh.faces)) / 6)


def gap(mesh: Mesh) -> float:
    """Length of the sum of the faces' area vectors over the mesh's area: 0 for a closed surface."""
    area = face_normals(mesh.vertices.astype(np.float64), mesh.faces)
    return float(np.linalg.norm(area.sum(0)) / np.linalg.norm(area, axis=1).sum())


def points_of(prop) -> np.ndarray:
    return np.concatenate([mesh.vertices for mesh, _ in prop.parts])


def bytes_of(prop) -> bytes:
    return b"".join(
        a.tobytes() for mesh, m in prop.parts for a in (mesh.vertices, mesh.faces, mesh.uv, m.texture)
    )


@pytest.mark.parametrize("family", FAMILIES)
def test_stands_centred_on_the_ground_in_a_plausible_size(family):
    for seed in SEEDS:
        points = points_of(FAMILIES[family](np.random.default_rng(seed)))
        low, high = points.min(0), points.max(0)
        assert np.isfinite(points).all()
        assert abs(low[2]) < 1e-6 and np.allclose(low[:2] + high[:2], 0, atol=1e-6)
        assert 0.002 < high[2] < 0.305
        assert 0.03 < (high - low).max() < (0.5 if family in LONG else 0.32)


@pytest.mark.parametrize("family", FAMILIES)
def test_parts_are_closed_outward_and_light(family):
    for seed in SEEDS:
        prop = FAMILIES[family](np.random.default_rng(seed))
        assert prop.family == family
        assert sum(len(mesh.vertices) for mesh, _ in prop.parts) <= 1500
        assert sum(len(mesh.faces) for mesh, _ in prop.parts) <= 1500
        for mesh, _ in prop.parts:
            assert mesh.vertices.dtype == np.float32 and mesh.faces.dtype == np.int32
            assert mesh.faces.min() == 0 and mesh.faces.max() == len(mesh.vertices) - 1
            assert gap(mesh) < 1e-5
            assert volume(mesh) > 0


@pytest.mark.parametrize("family", FAMILIES)
def test_parts_have_texture_coordinates_and_albedo(family):
    for seed in SEEDS:
        for mesh, material in FAMILIES[family](np.random.default_rng(seed)).parts:
            assert mesh.uv.dtype == np.float32 and np.isfinite(mesh.uv).all()
            assert material.texture.dtype == np.float32 and material.texture.shape[2] == 3
            assert material.texture.min() >= 0.02 and material.texture.max() <= 0.95
            assert 0 <= material.roughness <= 1


@pytest.mark.parametrize("family", FAMILIES)
def test_same_seed_same_bytes_other_seed_other_prop(family):
    a, b, c = (bytes_of(FAMILIES[family](np.random.default_rng(seed))) for seed in (7, 7, 8))
    assert a == b
    assert a != c


@pytest.mark.parametrize("family", FAMILIES)
def test_stands_stably(family):
    """The centre of gravity (all parts of one density) is above the hull of what touches the ground.

    Points within 3 mm of the ground touch it, for meshes are coarse; 2 mm outside the hull are forgiven.
    """
    for seed in SEEDS:
        prop = FAMILIES[family](np.random.default_rng(seed))
        moment, mass = np.zeros(3), 0.0
        for mesh, _ in prop.parts:
            a, b, c = (mesh.vertices.astype(np.float64)[mesh.faces[:, i]] for i in range(3))
            volumes = np.einsum("fi,fi->f", a, np.cross(b, c)) / 6  # of tetrahedra to the origin
            moment += (volumes[:, None] * (a + b + c) / 4).sum(0)
            mass += volumes.sum()
        points = points_of(prop)
        hull = ConvexHull(points[points[:, 2] < 0.003, :2])
        assert (hull.equations[:, :2] @ (moment / mass)[:2] + hull.equations[:, 2]).max() < 0.002


def test_there_are_families_for_every_zone():
    assert len(FAMILIES) >= 50
    assert list(ZONES) == list(FAMILIES) == sorted(FAMILIES), "random draws depend on this order"
    assert set().union(*ZONES.values()) == set(ZONE_NAMES)
    assert all(len(zones) == len(set(zones)) >= 1 for zones in ZONES.values())
    for zone in ZONE_NAMES:
        assert sum(zone in zones for zones in ZONES.values()) >= 8


def test_a_family_in_an_unknown_zone_is_refused():
    with pytest.raises(ValueError, match="zones must be some of cooking"):
        families.family("cooking", "cellar")
    with pytest.raises(ValueError, match="zones must be some of cooking"):
        families.family()


def test_several_families_can_hide_a_teapot():
    for family in TALL:
        heights = [points_of(FAMILIES[family](np.random.default_rng(s)))[:, 2].max() for s in SEEDS]
        assert np.median(heights) >= 0.15


def test_a_book_keeps_its_pages_between_its_covers():
    for seed in range(20):
        pages, *covers = (mesh.vertices for mesh, _ in FAMILIES["book"](np.random.default_rng(seed)).parts)
        shell = np.concatenate(covers)
        assert (pages.min(0) > shell.min(0)).all() and (pages.max(0) < shell.max(0)).all()
        assert len({np.round(np.ptp(cover, axis=0), 6).tobytes() for cover in covers[:2]}) == 1


def test_box_has_its_volume_and_each_side_the_whole_texture():
    plain, bevelled = box((0.1, 0.2, 0.3)), box((0.1, 0.2, 0.3), 0.01)
    assert volume(plain) == pytest.approx(0.006, rel=1e-5)
    assert plain.uv.min() == 0 and plain.uv.max() == 1
    # The edges, without b at each end, lose a prism of section b^2 / 2; each corner's cube b^3 keeps a sixth.
    lost = 0.5e-4 * (4 * 0.6 - 12 * 0.02) + 8 * 5 / 6 * 1e-6
    assert volume(bevelled) == pytest.approx(0.006 - lost, rel=1e-5)
    assert gap(bevelled) < 1e-6
    corners = plain.vertices[:4]  # of the side +X: seen from there, +Y is to the right, +Z up
    assert (corners[:, 0] > 0).all()
    assert np.array_equal(plain.uv[:4], corners[:, 1:] > [0, 0.15])


def test_revolve_of_a_cylinder():
    """A prism over a regular n-gon: volume n/2 r^2 h sin(2 pi / n)."""
    mesh = revolve([[0, 0], [0.1, 0], [0.1, 0], [0.1, 0.5], [0.1, 0.5], [0, 0.5]], 24)
    assert volume(mesh) == pytest.approx(12 * 0.01 * 0.5 * np.sin(2 * np.pi / 24), rel=1e-5)
    assert gap(mesh) < 1e-6
    front = mesh.vertices[np.isclose(mesh.uv[:, 0], 0.5) & (mesh.vertices[:, 1] < -0.09)]
    assert len(front) and np.allclose(front[:, 0], 0, atol=1e-6)  # the texture's middle faces -Y
    right = mesh.vertices[mesh.uv[:, 0] > 0.99]
    assert (right[:, 0] > 0.09).all()  # and its right edge +X


def test_upright_labels_read_the_same_on_both_sides():
    """Half way round (front to back) u goes on by one repeat, and grows to the right all the way."""
    mesh = revolve([[0, 0], [0.1, 0], [0.1, 0.5], [0, 0.5]], 24, upright=True)
    rim = mesh.vertices[:, 2] > 0.4
    on_rim = rim & (np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1]) > 0.09)
    angle = np.arctan2(mesh.vertices[on_rim, 1], mesh.vertices[on_rim, 0])
    u = mesh.uv[on_rim, 0]
    inside = np.abs(angle) < np.pi - 1e-3
    assert np.allclose(u[inside], 1 + angle[inside] / np.pi, atol=1e-5)
    assert gap(mesh) < 1e-6


def test_extruded_outline_has_its_area_times_its_height():
    square = [[1, 0], [1, 1], [0, 1], [0, 0]]
    assert volume(extrude(square, 0.5)) == pytest.approx(0.5, rel=1e-5)
    # A bevel b makes each end's layer a frustum: b/3 (1 + (1 - 2b) + (1 - 2b)^2).
    b = 0.1
    frustum = b / 3 * (1 + (1 - 2 * b) + (1 - 2 * b) ** 2)
    assert volume(extrude(square, 0.5, b)) == pytest.approx(0.3 + 2 * frustum, rel=1e-5)
    corners = rounded(0.2, 0.1, 0.02, 30)
    mesh = extrude(corners, 0.01)
    assert volume(mesh) == pytest.approx(0.01 * (0.02 - (4 - np.pi) * 0.02**2), rel=1e-3)
    assert gap(mesh) < 1e-6
    assert np.allclose(np.ptp(corners, axis=0), [0.2, 0.1])


def test_blob_is_an_ellipsoid_on_the_ground():
    mesh = blob((0.1, 0.2, 0.3), 64, 48)
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi * 0.05 * 0.1 * 0.15, rel=0.01)
    assert np.allclose(mesh.vertices.max(0), [0.05, 0.1, 0.3], rtol=1e-3)
    assert volume(blob((0.1, 0.2, 0.3), 64, 48, 6.0)) > 1.5 * volume(mesh)
    assert volume(scaled(mesh, 2)) == pytest.approx(8 * volume(mesh), rel=1e-4)


def test_hoop_is_a_torus():
    """Volume 2 pi R times the section's area (a regular polygon's)."""
    t = 2 * np.pi * np.arange(96) / 96
    mesh = hoop(np.stack([np.cos(t), np.sin(t), 0 * t], 1), 0.1, 16)
    assert volume(mesh) == pytest.approx(2 * np.pi * 8 * 0.01 * np.sin(2 * np.pi / 16), rel=2e-3)
    assert gap(mesh) < 1e-6


def test_vessel_is_hollow():
    wall = np.linspace([0.05, 0.0], [0.05, 0.1], 12)
    hollow = volume(revolve(vessel(wall, 0.005, 0.005), 64))
    assert 0.1 < hollow / (np.pi * 0.05**2 * 0.1) < 0.4


def test_superellipse_goes_from_round_to_square():
    assert np.allclose(superellipse(32, 2.0), 1)
    assert superellipse(32, 8.0).max() == pytest.approx(np.sqrt(2) * 2 ** (-1 / 8), rel=1e-6)


def test_smooth_passes_through_its_control_points():
    points = np.array([[0, 0], [1, 2], [3, 1], [4, 4]], float)
    assert np.allclose(smooth(points, 13)[::4], points)


def test_tube_and_relief_are_closed_with_the_right_volume():
    rod = tube([[0, 0, 0], [0, 0.5, 0], [0, 1, 0]], 0.1, sides=32)
    assert gap(rod) < 1e-6
    assert volume(rod) == pytest.approx(16 * 0.01 * np.sin(2 * np.pi / 32), rel=1e-5)
    x, y = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 2, 4))
    slab = relief(x, y, np.full_like(x, 0.3), 0.1)
    assert gap(slab) < 1e-6
    assert volume(slab) == pytest.approx(0.4, rel=1e-5)


def test_moved_tilts_then_turns_then_shifts():
    mesh = Mesh(
        np.float32([[0, 0, 1], [1, 0, 0], [0, 1, 0]]), np.int32([[0, 1, 2]]), np.zeros((3, 2), np.float32)
    )
    result = moved(mesh, (0, 0, 5), turn=np.pi / 2, tilt=np.pi / 2).vertices
    assert np.allclose(result, [[1, 0, 5], [0, 1, 5], [0, 0, 6]], atol=1e-6)


@pytest.mark.parametrize("holder", HOLDERS)
def test_holders_are_closed_and_lean(holder):
    for seed in SEEDS:
        prop = HOLDERS[holder](np.random.default_rng(seed))
        assert sum(len(mesh.faces) for mesh, _ in prop.parts) <= 1500
        for mesh, _ in prop.parts:
            assert gap(mesh) < 1e-5 and volume(mesh) > 0
