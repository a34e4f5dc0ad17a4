"""Furnished rooms: nothing stands in anything else, supports tell the truth, one can walk there."""

from collections import Counter
from functools import lru_cache

import numpy as np
import pytest
from scipy import ndimage

from vig_world.assets.shapes import box
from vig_world.assets.things import ZONE_NAMES, Furniture, Material, Support
from vig_world.library import Library
from vig_world.mesh import Mesh, face_normals
from vig_world.rooms.draw import draw_layout
from vig_world.rooms.layout import Layout
from vig_world.rooms.shell import inside, walls_of

COUNT = 64
LEVEL = 0.02
"""Metres by which seats and covers may differ from the height of a support on them."""
SHELL = ("wall", "floor", "ceiling")


packaged = Library("train")._furniture
"""Draws a piece of a family from the packaged catalogue."""


@lru_cache(maxsize=COUNT)
def drawn(seed: int) -> Layout:
    return draw_layout(np.random.default_rng(seed), packaged)


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
        assert np.abs(heights - z).min(initial=np.inf) < LEVEL, "the support lies on a surface"
        above = heights[heights > z + LEVEL]
        free = min(support.clearance, ceiling - z)
        assert above.min(initial=np.inf) >= z + free - LEVEL, "it is free above"


def bytes_of(parts) -> bytes:
    return b"".join(a.tobytes() for mesh, m in parts for a in (mesh.vertices, mesh.faces, mesh.uv, m.texture))


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    """How deep two solids (5, 2) are in one another, metres, by separating axes; not positive if apart."""
    depth = min(a[4, 1], b[4, 1]) - max(a[4, 0], b[4, 0])
    for corners in (a[:4], b[:4]):
        for axis in (corners[1] - corners[0], corners[3] - corners[0]):
            axis = axis / np.hypot(*axis)
            p, q = a[:4] @ axis, b[:4] @ axis
            depth = min(depth, min(p.max(), q.max()) - max(p.min(), q.min()))
    return depth


def test_rooms_are_of_many_kinds_and_shapes_and_all_different():
    layouts = [drawn(seed) for seed in range(COUNT)]
    kinds = Counter(layout.kind for layout in layouts)
    assert len(kinds) >= 6 and max(kinds.values()) < COUNT / 2
    shapes = Counter(len(layout.outline) for layout in layouts)
    assert set(shapes) == {4, 6} and shapes[6] >= COUNT / 10
    assert len({layout.outline.tobytes() + layout.solids.tobytes() for layout in layouts}) == COUNT
    zones = Counter(s.zone for layout in layouts for s in layout.supports)
    assert set(zones) == set(ZONE_NAMES)


def test_furniture_stays_apart_and_indoors():
    for seed in range(COUNT):
        layout = drawn(seed)
        solids = layout.solids
        assert solids.shape[1:] == (5, 2) and len(solids) >= 3
        low, high = layout.outline.min(0), layout.outline.max(0)
        for i, solid in enumerate(solids):
            assert 0 <= solid[4, 0] < solid[4, 1] <= layout.height
            assert (solid[:4] > low - 1e-3).all() and (solid[:4] < high + 1e-3).all()
            middle = solid[:4].mean(0)
            assert inside(layout.outline, middle + 0.995 * (solid[:4] - middle)).all()
            area = np.diff(solid[[0, 1]], axis=0)[0], np.diff(solid[[1, 2]], axis=0)[0]
            assert area[0][0] * area[1][1] - area[0][1] * area[1][0] > 0, "counter-clockwise"
            for other in solids[:i]:
                assert overlap(solid, other) < 2e-3


def test_all_that_reaches_into_the_room_is_in_a_solid():
    """No vertex is in the middle of the room unless a solid holds it: solids are where things really are."""
    for seed in range(16):
        layout = drawn(seed)
        points = np.concatenate([mesh.vertices for mesh, stuff in layout.parts if stuff.slot not in SHELL])
        away = np.min(
            [
                np.abs((points[:, :2] - wall.start) @ [-np.sin(wall.angle), np.cos(wall.angle)])
                for wall in walls_of(layout.outline)
            ],
            axis=0,
        )
        rest = points[(away > 0.16) & (points[:, 2] > 0.02) & inside(layout.outline, points[:, :2])]
        held = np.zeros(len(rest), bool)
        for solid in layout.solids:
            corner, u, v = solid[0], solid[1] - solid[0], solid[3] - solid[0]
            s, t = (rest[:, :2] - corner) @ u / (u @ u), (rest[:, :2] - corner) @ v / (v @ v)
            a, b = 1e-3 / np.hypot(*u), 1e-3 / np.hypot(*v)
            level = (rest[:, 2] > solid[4, 0] - 1e-3) & (rest[:, 2] < solid[4, 1] + 1e-3)
            held |= (s > -a) & (s < 1 + a) & (t > -b) & (t < 1 + b) & level
        assert held.all()


@pytest.mark.parametrize("seed", range(12))
def test_supports_lie_on_surfaces_and_are_free_above(seed):
    layout = drawn(seed)
    points, _ = joined(layout.parts)
    for support in layout.supports:
        corners = spread(support)
        assert (corners > points.min(0)[:2]).all() and (corners < points.max(0)[:2]).all()
        check_support(layout.parts, support, layout.height - 0.16)  # lamps and cornices are above
        if support.zone == "floor":
            assert support.centre[2] == 0 and min(support.half) >= 0.25 - 1e-6
            assert inside(layout.outline, corners).all()


def test_what_is_behind_a_support_is_there():
    """From its +y edge, a little above it, a level ray meets a face within `behind`, or nothing near."""
    told, missed = 0, 0
    for seed in range(12):
        layout = drawn(seed)
        vertices, faces = joined(layout.parts)
        for support in layout.supports:
            c, s = np.cos(support.turn), np.sin(support.turn)
            ahead = np.array([-s, c, 0.0])
            edge = np.array(support.centre) + (support.half[1] - 0.02) * ahead + [0, 0, 0.09]
            across = support.half[0] * np.array([c, s, 0.0])
            distance = (
                min(first_hit(vertices, faces, edge + k * across, ahead) for k in (-0.8, 0, 0.8)) - 0.02
            )
            if np.isinf(support.behind):
                assert distance > 0.3
            elif support.zone != "floor":  # what stands on the floor may have legs
                told += 1
                missed += distance > support.behind + 0.1  # between the rods of a chair's back
    assert told > 40 and missed < 0.1 * told


def first_hit(vertices: np.ndarray, faces: np.ndarray, start: np.ndarray, ahead: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    e, f = b - a, c - a
    p = np.cross(ahead, f)
    det = np.einsum("fi,fi->f", e, p)
    usable = np.abs(det) > 1e-12
    det = np.where(usable, det, 1.0)
    away = start - a
    u = np.einsum("fi,fi->f", away, p) / det
    q = np.cross(away, e)
    v = q @ ahead / det
    t = np.einsum("fi,fi->f", f, q) / det
    hits = t[usable & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)]
    return float(hits.min(initial=np.inf))


def test_the_shell_is_seen_from_inside():
    for seed in range(16):
        layout = drawn(seed)
        slots = {stuff.slot for _, stuff in layout.parts}
        assert set(SHELL) <= slots
        middle = np.array([*layout.outline.mean(0), layout.height / 2])
        for mesh, stuff in layout.parts:
            if stuff.slot in ("floor", "ceiling"):
                normals = face_normals(mesh.vertices.astype(float), mesh.faces)
                assert (normals[:, 2] * (middle[2] - mesh.vertices[mesh.faces[:, 0], 2]) > 0).all()
                rings = np.roll(layout.outline, -1, 0)
                area = layout.outline[:, 0] @ rings[:, 1] - layout.outline[:, 1] @ rings[:, 0]
                assert np.abs(normals[:, 2]).sum() == pytest.approx(area, rel=1e-5)
            elif stuff.slot == "wall":
                for wall in walls_of(layout.outline):
                    inward = np.array([-np.sin(wall.angle), np.cos(wall.angle)])
                    away = (mesh.vertices[:, :2] - wall.start) @ inward
                    flat = (np.abs(away)[mesh.faces] < 1e-4).all(1)
                    normals = face_normals(mesh.vertices.astype(float), mesh.faces)[flat]
                    facing = normals[:, :2] @ inward / np.linalg.norm(normals, axis=1)
                    assert (facing[np.abs(facing) > 0.9] > 0).sum() >= 2
                    assert not (facing < -0.9).any()


def test_rooms_are_lean():
    counts = [sum(len(mesh.faces) for mesh, _ in drawn(seed).parts) for seed in range(COUNT)]
    assert max(counts) < 15_000 and np.mean(counts) < 9_000
    assert max(len(drawn(seed).parts) for seed in range(COUNT)) < 64


def test_one_can_walk_from_the_door():
    """Floor 0.5 m wide, free up to head height, is in one piece (0.85 of it at least) in a grid of 5 cm."""
    for seed in range(16):
        layout = drawn(seed)
        low, high = layout.outline.min(0), layout.outline.max(0)
        x, y = (np.arange(a, b, 0.05) for a, b in zip(low, high, strict=True))
        cells = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        free = inside(layout.outline, cells)
        for solid in layout.solids:
            if solid[4, 0] < 1.8 and solid[4, 1] > 0.05:
                free &= ~inside(solid[:4], cells)
        wide = ndimage.binary_opening(np.pad(free.reshape(len(y), len(x)), 10), np.ones((10, 10)))
        labels, _ = ndimage.label(wide)
        sizes = np.bincount(labels.ravel())[1:]
        assert sizes.max() > 0.8 * sizes.sum()


def test_same_seed_same_layout():
    a, b = drawn(5), draw_layout(np.random.default_rng(5), packaged)
    assert bytes_of(a.parts) == bytes_of(b.parts)
    assert a.supports == b.supports and a.solids.tobytes() == b.solids.tobytes()


def test_users_furniture_takes_a_familys_place():
    asked = Counter()

    def crate(family: str, rng: np.random.Generator) -> Furniture:
        asked[family] += 1
        if family != "chair":
            return packaged(family, rng)
        stuff = Material(np.full((1, 1, 3), 0.123, np.float32), "wood", 0.5)
        return Furniture("crate", ((box((0.4, 0.4, 0.4)), stuff),), ())

    seen = 0
    for seed in range(8):
        layout = draw_layout(np.random.default_rng(seed), crate)
        seen += sum(bool((stuff.texture == np.float32(0.123)).all()) for _, stuff in layout.parts)
    assert asked["chair"] > 0 and seen > 0


def test_a_mesh_without_a_place_is_left_out():
    def giant(family: str, rng: np.random.Generator) -> Furniture:
        stuff = Material(np.full((1, 1, 3), 0.5, np.float32), "wood", 0.5)
        return Furniture("giant", ((box((30.0, 30.0, 1.0)), stuff),), ())

    layout = draw_layout(np.random.default_rng(0), giant)
    assert isinstance(layout.parts[0][0], Mesh)
    assert np.abs(joined(layout.parts)[0]).max() < 10
