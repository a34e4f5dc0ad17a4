from typing import Any

import numpy as np
import pytest
import trimesh

from vig.scene import Camera, ObjectClass
from vig_native import engine
from vig_world.raster.rasterize import Fragments, rasterize

CAMERA = Camera(width=120, height=90, focal=130.0, cx=61.3, cy=44.1)
IDENTITY, ORIGIN = np.eye(3), np.zeros(3)


def reference(points: np.ndarray, faces: np.ndarray, camera: Camera, cull: bool = False) -> Fragments:
    """What `rasterize` means, plainly and in float64: points (V, 3) in the camera frame, a z-buffer."""
    size = camera.height, camera.width
    nearest, seen, barycentric = np.full(size, np.inf), np.full(size, -1), np.zeros((*size, 3))
    for face, corners in enumerate(faces):
        corner = points[corners]
        depth = corner[:, 2]
        if depth.min() < 0.01:
            continue
        u, v = (camera.focal * corner[:, :2] / depth[:, None] + (camera.cx, camera.cy)).T
        doubled_area = (u[1] - u[0]) * (v[2] - v[0]) - (u[2] - u[0]) * (v[1] - v[0])
        # y points down, so outward faces turn the other way.
        if doubled_area == 0 or (cull and doubled_area > 0):
            continue
        left, right = max(int(u.min()), 0), max(int(u.max()) + 1, 0)
        top, bottom = max(int(v.min()), 0), max(int(v.max()) + 1, 0)
        box = np.s_[top:bottom, left:right]
        y, x = (grid[box] + 0.5 for grid in np.mgrid[: camera.height, : camera.width])
        weights = np.stack(
            [
                (u[j] - x) * (v[k] - y) - (u[k] - x) * (v[j] - y)  # doubled area opposite corner i
                for j, k in ((1, 2), (2, 0), (0, 1))
            ],
            axis=-1,
        )
        screen = weights / doubled_area
        inverse = screen / depth  # perspective: weights over depth are linear on the screen
        with np.errstate(divide="ignore"):
            at = 1 / inverse.sum(-1)
        here = (screen >= 0).all(-1) & (at < nearest[box])
        nearest[box][here], seen[box][here] = at[here], face
        barycentric[box][here] = (inverse * at[..., None])[here]
    return Fragments(seen, barycentric, nearest)


def soup(rng: np.random.Generator, count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of all sizes that pierce each other, some half outside the image."""
    centre = rng.uniform((-0.3, -0.25, 0.3), (0.3, 0.25, 0.8), (count, 1, 3))
    size = rng.uniform(0.02, 0.2, (count, 1, 1))
    points = (centre + size * rng.normal(size=(count, 3, 3))).reshape(-1, 3)
    return points.astype(np.float32).astype(np.float64), np.arange(3 * count).reshape(-1, 3)


def teapot_points(teapot: ObjectClass, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """World vertices, rotation and translation of a random teapot before a random eye."""
    coefficients = rng.normal(size=(1, teapot.shape_model.modes)).clip(-2, 2)
    angles = rng.uniform((0, 0.1), (6.3, 1.2))
    rotation, translation = Camera.standard(target_height=teapot.target_height).pose(angles[:1], angles[1:])
    vertices = teapot.shape_model.vertices(coefficients)[0]
    return vertices, rotation[0], translation[0]


def compare(found: Fragments, expected: Fragments) -> float:
    """Share of pixels whose face differs; the others agree tightly."""
    same = found.face == expected.face
    drawn = same & (expected.face >= 0)
    np.testing.assert_allclose(found.depth[drawn], expected.depth[drawn], atol=1e-4)
    np.testing.assert_allclose(found.barycentric[drawn], expected.barycentric[drawn], atol=2e-4)
    nothing = found.face < 0
    assert np.isinf(found.depth[nothing]).all() and not found.barycentric[nothing].any()
    return 1 - same.mean()


@pytest.mark.parametrize("cull", [False, True])
def test_random_triangles_are_drawn_as_by_the_reference(cull: bool) -> None:
    rng = np.random.default_rng(0)
    flips, covered = [], []
    for _ in range(8):
        points, faces = soup(rng)
        found = rasterize(points, faces, IDENTITY, ORIGIN, CAMERA, cull)
        expected = reference(points, faces, CAMERA, cull)
        flips.append(compare(found, expected))
        covered.append((found.face >= 0).mean() - (expected.face >= 0).mean())
    assert np.mean(flips) < 2e-4 and max(flips) < 2e-3
    assert abs(np.mean(covered)) < 2e-4  # what flips does so in either direction


def test_teapots_are_drawn_as_by_the_reference(teapot: ObjectClass) -> None:
    rng = np.random.default_rng(1)
    faces = teapot.shape_model.faces
    camera = Camera.standard(target_height=teapot.target_height)
    for _ in range(2):
        vertices, rotation, translation = teapot_points(teapot, rng)
        found = rasterize(vertices, faces, rotation, translation, camera)
        expected = reference(vertices @ rotation.T + translation, faces, camera)
        assert (found.face >= 0).mean() > 0.1
        assert compare(found, expected) < 2e-3


def test_barycentrics_and_depth_say_where_the_ray_meets_the_face(teapot: ObjectClass) -> None:
    vertices, rotation, translation = teapot_points(teapot, np.random.default_rng(2))
    camera = Camera.standard(target_height=teapot.target_height)
    seen = rasterize(vertices, teapot.shape_model.faces, rotation, translation, camera)
    rows, columns = np.nonzero(seen.face >= 0)
    corners = (vertices @ rotation.T + translation)[teapot.shape_model.faces[seen.face[rows, columns]]]
    met = np.einsum("nc,ncd->nd", seen.barycentric[rows, columns], corners)
    np.testing.assert_allclose(met[:, 2], seen.depth[rows, columns], atol=1e-5)
    projected = (met @ camera.K.T)[:, :2] / met[:, 2:]
    np.testing.assert_allclose(projected, np.stack([columns, rows], 1) + 0.5, atol=0.02)


def test_a_closed_mesh_shows_only_faces_turned_to_the_eye() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    place = (np.eye(3), np.array([0.0, 0.0, 0.4]))
    both = rasterize(ball.vertices, ball.faces, *place, CAMERA)
    culled = rasterize(ball.vertices, ball.faces, *place, CAMERA, cull=True)
    np.testing.assert_array_equal(both.face, culled.face)
    # A sphere of radius r at distance d covers a disc of radius f r / sqrt(d^2 - r^2).
    area = np.pi * (130 * 0.1) ** 2 / (0.4**2 - 0.1**2)
    assert (both.face >= 0).sum() == pytest.approx(area, rel=0.02)
    inside_out = ball.faces[:, ::-1]
    hollow = rasterize(ball.vertices, inside_out, *place, CAMERA, cull=True)
    # The far wall, seen from within: beyond the depth (d^2 - r^2) / d = 0.375 where the rays graze.
    assert hollow.depth[hollow.face >= 0].min() > 0.37 and both.depth[both.face >= 0].max() < 0.38
    assert (hollow.face >= 0).sum() == pytest.approx(area, rel=0.02)
    turned = rasterize(ball.vertices, inside_out, *place, CAMERA)
    np.testing.assert_array_equal(turned.face, both.face)


def test_faces_behind_or_across_the_eyes_plane_are_not_drawn() -> None:
    rng = np.random.default_rng(3)
    points, faces = soup(rng, 30)
    alone = rasterize(points, faces, IDENTITY, ORIGIN, CAMERA)
    behind, _ = soup(rng, 30)
    behind[:, 2] *= -1
    across, _ = soup(rng, 30)
    across[::3, 2] = rng.uniform(-0.5, 0.0099, 30)
    both = rasterize(
        np.concatenate([points, behind, across]),
        np.concatenate([faces, faces + 90, faces + 180]),
        IDENTITY,
        ORIGIN,
        CAMERA,
    )
    np.testing.assert_array_equal(both.face, alone.face)
    np.testing.assert_array_equal(both.depth, alone.depth)


def test_degenerate_faces_and_empty_views_are_nothing() -> None:
    point = np.array([[0.0, 0, 0.5], [0.1, 0, 0.5], [0.2, 0, 0.5], [0, 9, 0.5], [1, 9, 0.5], [0, 10, 0.5]])
    for faces in ([[0, 0, 0], [0, 1, 1], [0, 1, 2]], [[3, 4, 5]]):
        seen = rasterize(point, np.array(faces), IDENTITY, ORIGIN, CAMERA)
        assert (seen.face == -1).all() and np.isinf(seen.depth).all()


def test_neighbouring_faces_leave_no_gap_and_hide_nothing() -> None:
    # A wavy sheet of small faces across the whole image: no pixel may look through its seams.
    rng = np.random.default_rng(4)
    u, v = np.meshgrid(np.linspace(-0.4, 0.4, 60), np.linspace(-0.35, 0.35, 50))
    points = np.stack([u, v, 0.5 + 0.05 * rng.normal(size=u.shape)], -1).reshape(-1, 3)
    at = np.arange(50 * 60).reshape(50, 60)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])
    seen = rasterize(points, faces, IDENTITY, ORIGIN, CAMERA)
    assert not (seen.face < 0).any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.zeros((3, 4), np.float32)}, r"points must be \(any, 3\); got \(3, 4\)"),
        ({"faces": np.array([[0, 1, 3]], np.int32)}, "faces must be from 0 to 2; they are from 0 to 3"),
        ({"camera": (9.0, 1.0, 1.0, 0, 4)}, "width and height must be 1 or more"),
        ({"camera": (9.0, 1.0, 1.0, 2**20, 2**20)}, "fit into memory"),
    ],
)
def test_native_code_refuses_what_does_not_fit(change: dict[str, Any], message: str) -> None:
    points, faces = np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32)
    given = {"points": points, "faces": faces, "camera": (9.0, 1.0, 1.0, 4, 4), "near": 0.01, "cull": False}
    with pytest.raises(ValueError, match=message):
        engine.rasterize(**given | change)
