"""Rays of the native library beside brute force: what they meet, where, from which side; what they block."""

from typing import Any

import numpy as np
import pytest
import torch
import trimesh

from vig.scene.light import sh_basis
from vig_native import engine


def cast(
    vertices: np.ndarray, faces: np.ndarray, origins: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return blocked (N, 9), faces (N,), weights (N, 3) of single rays: those along the points' normals."""
    frames = np.zeros((len(origins), 3, 3))
    frames[:, 2] = directions
    patterns, turns = np.zeros((1, 1, 2)), np.zeros(len(origins))
    mesh = vertices.astype(np.float32), faces.astype(np.int32)
    blocked, met, weights = engine.cast_hemisphere_rays(
        *mesh, origins, frames, patterns, turns, 0.0, len(origins)
    )
    return blocked, met[:, 0], weights[:, 0]


def by_brute_force(
    vertices: np.ndarray, faces: np.ndarray, origin: np.ndarray, direction: np.ndarray
) -> tuple[int, np.ndarray, float]:
    """Return the first face met, -1, or -2 if seen from behind; its weights; how clearly it was decided."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = ((a - origin) * normal).sum(1) / (normal @ direction)
        at = origin + distance[:, None] * direction
        # A weight is the signed area of the triangle opposite a corner, over the whole.
        pairs = ((b, c), (c, a), (a, b))
        weights = np.stack([(np.cross(p - at, q - at) * normal).sum(1) for p, q in pairs], axis=1)
        weights /= (normal**2).sum(1)[:, None]
    met = (weights.min(1) >= 0) & (distance > 0)
    clear = np.abs(weights.min(1)[distance > 0]).min(initial=1.0)
    if not met.any():
        return -1, np.zeros(3), clear
    nearest = np.sort(distance[met])
    clear = min(clear, *np.diff(nearest[:2]), 1.0)
    first = int(np.where(met, distance, np.inf).argmin())
    return (-2 if normal[first] @ direction > 0 else first), weights[first], clear


@pytest.mark.parametrize("count", [1, 15, 16, 17, 300, 5000])
def test_random_triangles_are_met_as_by_brute_force(count: int) -> None:
    rng = np.random.default_rng(count)
    centres = rng.normal(size=(count, 1, 3))
    vertices = (centres + 0.3 * rng.normal(size=(count, 3, 3))).reshape(-1, 3).astype(np.float32)
    faces = np.arange(3 * count).reshape(-1, 3)
    origins, directions = rng.normal(size=(2, 200, 3)).astype(np.float32).astype(float)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    blocked, met, weights = cast(vertices, faces, origins, directions)
    doubtful = 0
    for ray in range(200):
        face, where, clear = by_brute_force(vertices.astype(float), faces, origins[ray], directions[ray])
        if clear < 1e-4:
            doubtful += 1
            continue
        assert met[ray] == face
        np.testing.assert_allclose(weights[ray], where, atol=1e-3)
    assert doubtful < 100
    basis = sh_basis(torch.from_numpy(directions)).numpy()
    np.testing.assert_allclose(blocked, np.where((met == -1)[:, None], 0, basis), atol=1e-12)


def test_a_sphere_is_met_where_it_is() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4)
    rng = np.random.default_rng(1)
    inwards = -trimesh.unitize(rng.normal(size=(5000, 3)))
    aside = np.cross(inwards, rng.normal(size=(5000, 3)))
    off = rng.uniform(0, 1.5, 5000)
    origins = trimesh.unitize(aside) * off[:, None] - 4 * inwards
    _, met, weights = cast(ball.vertices, ball.faces, origins, inwards)
    # The mesh lies within the sphere, by less than .003 at its faces' middles.
    assert (met[off < 0.997] >= 0).all() and (met[off > 1] == -1).all()
    hit = met >= 0
    where = np.einsum("nk,nkd->nd", weights[hit], ball.vertices[ball.faces[met[hit]]])
    expected = origins[hit] + inwards[hit] * (4 - np.sqrt(np.maximum(1 - off[hit] ** 2, 0)))[:, None]
    near = off[hit] < 0.9
    assert np.linalg.norm(where - expected, axis=1)[near].max() < 0.01
    # From within every ray meets the wall, none passes between two faces, and all see it from behind.
    _, within, _ = cast(ball.vertices, ball.faces, np.zeros((5000, 3)), inwards)
    assert (within == -2).all()


def test_rays_along_shared_edges_and_corners_do_not_pass() -> None:
    steps = np.arange(-8, 9) / 8.0
    grid = np.stack([*np.meshgrid(steps, steps), np.zeros((17, 17))], -1).reshape(-1, 3)
    at = np.arange(17 * 17).reshape(17, 17)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])
    targets = grid[(np.abs(grid) < 1).all(1)]
    for origin in ([0, 0, 1.0], [0.3, -0.2, 0.7], [0.5, 0.5, -2.0]):
        directions = trimesh.unitize(targets - origin)
        _, met, _ = cast(grid, faces, np.tile(origin, (len(targets), 1)), directions)
        assert (met != -1).all()


def test_what_is_no_triangle_or_no_ray_meets_nothing() -> None:
    vertices = np.array([[0, 0, 1], [1, 0, 1], [0, 1, 1], [np.nan, 0, 1], [np.inf, 1, 1], [3, 0, 1.0]])
    faces = np.array([[0, 1, 3], [0, 4, 1], [0, 1, 5], [0, 0, 0]])
    origins, up = np.full((3, 3), 0.1), np.array([[0, 0, 1.0], [0, 0, 0], [np.nan, 0, 1]])
    for some in (faces, faces[:0], np.concatenate([faces, [[0, 1, 2]] * 40])):
        blocked, met, weights = cast(vertices, some, origins, up)
        expected = np.array([-1, -1, -1])
        expected[0] = -1 if len(some) < 40 else -2  # its front is turned up
        np.testing.assert_array_equal(met, expected)
        assert not weights[met == -1].any() and not blocked[met == -1].any()
    flipped = np.concatenate([faces, [[0, 2, 1]] * 40])
    assert cast(vertices, flipped, origins, up)[1][0] == 4  # the first of equals


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("vertices", np.zeros((3, 2), np.float32), r"vertices must be \(any, 3\); got \(3, 2\)"),
        ("faces", np.array([[0, 1, 3]], np.int32), "faces must be from 0 to 2; they are from 0 to 3"),
        ("points", np.zeros((5, 4)), r"points must be \(any, 3\); got \(5, 4\)"),
        ("frames", np.zeros((4, 3, 3)), r"frames must be \(5, 3, 3\); got \(4, 3, 3\)"),
        ("patterns", np.zeros((2, 4, 2)), r"patterns must be \(3, any, 2\); got \(2, 4, 2\)"),
        ("turns", np.zeros(4), r"turns must be \(5\); got \(4\)"),
        ("chunk", 0, "chunk must be 1 or more; got 0"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(name: str, value: Any, message: str) -> None:
    given = {
        "vertices": np.zeros((3, 3), np.float32),
        "faces": np.array([[0, 1, 2]], np.int32),
        "points": np.zeros((5, 3)),
        "frames": np.zeros((5, 3, 3)),
        "patterns": np.zeros((3, 4, 2)),
        "turns": np.zeros(5),
        "offset": 0.0,
        "chunk": 2,
    }
    with pytest.raises(ValueError, match=message):
        engine.cast_hemisphere_rays(**given | {name: value})


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_rays_of_numbers_that_are_not_finite_meet_nothing(number: float) -> None:
    vertices = np.random.default_rng(5).normal(size=(60, 3))
    faces = np.arange(60).reshape(-1, 3)
    origins, directions = np.zeros((2, 3)), np.array([[0.0, 0, 1], [0, 0, number]])
    origins[0, 1] = number
    _, met, _ = cast(vertices, faces, origins, directions)
    assert met.tolist() == [-1, -1]
