"""Furniture: closed meshes of real sizes whose supports lie on them; same seed, same bytes."""

import numpy as np
import pytest

from vig_world.assets.furniture import FAMILIES, Furniture, Support
from vig_world.assets.furniture.joinery import board, boards, cushion, slab, stick
from vig_world.assets.furniture.pierced import cells, pierced
from vig_world.mesh import Mesh, face_normals

SEEDS = range(6)
ZONES = {
    "cooking",
    "dining",
    "drinks",
    "desk",
    "reading",
    "display",
    "storage",
    "bedside",
    "washing",
    "floor",
}
HEIGHTS = {  # of the support that is used most, metres
    "dining_table": (0.72, 0.76),
    "cafe_table": (0.72, 0.76),
    "desk": (0.72, 0.76),
    "coffee_table": (0.35, 0.48),
    "side_table": (0.45, 0.6),
    "sink_counter": (0.88, 0.94),
    "hob_counter": (0.88, 0.94),
    "kitchen_counter": (0.88, 0.94),
    "kitchen_island": (0.88, 0.94),
    "chair": (0.43, 0.48),
    "stool": (0.43, 0.48),
    "armchair": (0.43, 0.48),
    "sofa": (0.43, 0.48),
    "bench": (0.43, 0.48),
    "window_seat": (0.43, 0.48),
    "bed": (0.4, 0.6),
    "sideboard": (0.7, 0.9),
    "chest_of_drawers": (0.7, 1.1),
    "bedside_table": (0.4, 0.6),
    "tea_trolley": (0.15, 0.85),
    "fireplace": (1.0, 1.3),
}


def made(family: str, seed: int) -> Furniture:
    return FAMILIES[family](np.random.default_rng(seed))


def joined(parts) -> tuple[np.ndarray, np.ndarray]:
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh, _ in parts])
    faces = [mesh.faces + start for (mesh, _), start in zip(parts, starts, strict=False)]
    return np.concatenate([mesh.vertices for mesh, _ in parts]).astype(float), np.concatenate(faces)


def crossings(parts, points: np.ndarray) -> list[np.ndarray]:
    """Heights at which the upright line through each point (x, y) meets the parts' faces."""
    vertices, faces = joined(parts)
    low, high = points.min(0), points.max(0)
    xy = vertices[faces][:, :, :2]
    near = (xy.max(1) >= low).all(1) & (xy.min(1) <= high).all(1)
    triangles = vertices[faces[near]]
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    level = np.abs(area) > 1e-10
    a, b, c, area = a[level], b[level], c[level], area[level]
    result = []
    for x, y in points:
        wb = ((x - a[:, 0]) * (c[:, 1] - a[:, 1]) - (y - a[:, 1]) * (c[:, 0] - a[:, 0])) / area
        wc = ((b[:, 0] - a[:, 0]) * (y - a[:, 1]) - (b[:, 1] - a[:, 1]) * (x - a[:, 0])) / area
        hit = (wb >= -1e-9) & (wc >= -1e-9) & (wb + wc <= 1 + 1e-9)
        result.append((a[:, 2] + wb * (b[:, 2] - a[:, 2]) + wc * (c[:, 2] - a[:, 2]))[hit])
    return result


def spread(support: Support) -> np.ndarray:
    """Points (M, 2) all over a support, its corners included."""
    x, y = support.half
    c, s = np.cos(support.turn), np.sin(support.turn)
    shares = np.array([-0.999, -0.613, -0.217, 0.211, 0.607, 0.999])  # off the edges between triangles
    u, v = (grid.ravel() for grid in np.meshgrid(x * shares, y * shares))
    return np.stack([c * u - s * v, s * u + c * v], -1) + support.centre[:2]


def check_support(parts, support: Support, ceiling: float = float("inf")) -> None:
    z = support.centre[2]
    for heights in crossings(parts, spread(support)):
        assert np.abs(heights - z).min(initial=np.inf) < 1e-4, "the support lies on a surface"
        above = heights[heights > z + 1e-4]
        assert above.min(initial=np.inf) >= z + min(support.clearance, ceiling - z) - 1e-4, "it is free above"


def gap(mesh: Mesh) -> float:
    area = face_normals(mesh.vertices.astype(float), mesh.faces)
    return float(np.linalg.norm(area.sum(0)) / np.linalg.norm(area, axis=1).sum())


def volume(mesh: Mesh) -> float:
    points = mesh.vertices.astype(float)
    return float(np.einsum("fi,fi->", points[mesh.faces[:, 0]], face_normals(points, mesh.faces)) / 6)


def bytes_of(parts) -> bytes:
    return b"".join(a.tobytes() for mesh, m in parts for a in (mesh.vertices, mesh.faces, mesh.uv, m.texture))


def test_there_are_many_families_and_most_carry_things():
    assert len(FAMILIES) >= 16 and list(FAMILIES) == sorted(FAMILIES)
    assert sum(bool(made(family, 0).supports) for family in FAMILIES) >= 16
    zones = {s.zone for family in FAMILIES for seed in range(12) for s in made(family, seed).supports}
    assert zones == ZONES - {"floor"}


@pytest.mark.parametrize("family", FAMILIES)
def test_stands_centred_on_the_ground_closed_and_lean(family):
    for seed in SEEDS:
        piece = made(family, seed)
        assert piece.family == family
        points, _ = joined(piece.parts)
        low, high = points.min(0), points.max(0)
        assert abs(low[2]) < 1e-6 and np.allclose(low[:2] + high[:2], 0, atol=1e-6)
        assert 0.3 < (high - low).max() < 2.6 and (high - low).min() > 0.015
        assert 40 < sum(len(mesh.faces) for mesh, _ in piece.parts) < 2200
        for mesh, material in piece.parts:
            assert gap(mesh) < 1e-5 and volume(mesh) > 0
            assert mesh.faces.min() == 0 and mesh.faces.max() == len(mesh.vertices) - 1
            assert mesh.uv.shape == (len(mesh.vertices), 2) and np.isfinite(mesh.uv).all()
            assert (
                material.texture.dtype == np.float32
                and 0 <= material.texture.min() <= material.texture.max() <= 1
            )
            assert material.slot in ("", "wood", "top", "fabric")


@pytest.mark.parametrize("family", FAMILIES)
def test_supports_lie_on_the_piece_and_are_free_above(family):
    for seed in SEEDS:
        piece = made(family, seed)
        points, _ = joined(piece.parts)
        for support in piece.supports:
            corners = spread(support)
            assert (corners >= points.min(0)[:2]).all() and (corners <= points.max(0)[:2]).all()
            assert min(support.half) >= 0.06
            check_support(piece.parts, support)


@pytest.mark.parametrize("family", HEIGHTS)
def test_heights_are_those_of_real_furniture(family):
    low, high = HEIGHTS[family]
    for seed in SEEDS:
        main = max(made(family, seed).supports, key=lambda s: s.half[0] * s.half[1])
        assert low - 0.005 <= main.centre[2] <= high + 0.005


@pytest.mark.parametrize("family", FAMILIES)
def test_same_seed_same_bytes_other_seed_other_piece(family):
    a, b, c = (bytes_of(made(family, seed).parts) for seed in (7, 7, 8))
    assert a == b
    assert a != c


def test_texture_coordinates_of_slots_are_metres():
    """On faces of a size the texture's area is the surface's; edges and curved parts may stretch a little."""
    for family in ("dining_table", "bookshelf", "sofa", "kitchen_counter"):
        for mesh, material in made(family, 3).parts:
            if material.slot:
                normals = face_normals(mesh.vertices.astype(float), mesh.faces)
                area = np.linalg.norm(normals, axis=1)
                p, q, r = (mesh.uv[mesh.faces[:, k]].astype(float) for k in range(3))
                flat = np.abs((q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0])
                seen = normals[:, 2] > -0.5 * area
                ratio = flat[seen].sum() / area[seen].sum()
                assert ratio == pytest.approx(1, abs=0.3)  # cushions' corners stretch


def test_grain_runs_along_a_board():
    mesh = board((2.0, 0.3, 0.02))
    top = np.isclose(mesh.vertices[:, 2], 0.02)
    assert np.ptp(mesh.uv[top, 1]) == pytest.approx(2.0) and np.ptp(mesh.uv[top, 0]) == pytest.approx(0.3)


def test_blocks_have_their_volumes():
    two = boards([[0, 0, 0], [1, 1, 1]], [[1, 1, 1], [2, 3, 4]], 0.0, [[0, 0], [0, 0]])
    assert volume(two) == pytest.approx(1 + 6, rel=1e-6) and gap(two) < 1e-6
    cylinder = slab((0.5, 0.5), 0.5, [[(0.0, 0.0), (0.0, 2.0)]], 6)  # a prism over a regular 24-gon
    assert volume(cylinder) == pytest.approx(2.0 * 12 * 0.25 * np.sin(2 * np.pi / 24), rel=1e-5)
    sharp = slab((0.5, 0.25), 0.0, [[(0.1, 0.0), (0.0, 1.0)]], 0)  # a truncated pyramid: mean of 3 sections
    assert volume(sharp) == pytest.approx((0.8 * 0.3 + 4 * 0.9 * 0.4 + 1.0 * 0.5) / 6, rel=1e-5)
    bar = stick((0, 0, 0), (0, 3, 4), 0.1, 8)
    assert volume(bar) == pytest.approx(5 * 4 * 0.01 * np.sin(2 * np.pi / 8), rel=1e-5)
    for mesh in (cylinder, sharp, bar, cushion((0.3, 0.2), 0.1, 0.04)):
        assert gap(mesh) < 1e-6 and volume(mesh) > 0


def test_a_pierced_board_lacks_its_holes():
    hole = (0.5, 0.2, 0.9, 0.4)
    mesh = pierced((0.0, 0.0), (2.0, 0.6), 0.1, 0.2, [hole])
    assert volume(mesh) == pytest.approx((2.0 * 0.6 - 0.4 * 0.2) * 0.1, rel=1e-5)
    assert gap(mesh) < 1e-6
    assert sum((c - a) * (d - b) for a, b, c, d in cells((0, 0), (2, 0.6), [hole])) == pytest.approx(1.12)
