from collections.abc import Callable

import numpy as np
import pytest
import torch

from tests.vig_renderer import reference
from tests.vig_renderer.reference import find
from vig.scene import Camera
from vig_renderer import NEAR, Topology
from vig_world.raster.rasterize import rasterize

SIZE = (24, 32)


def seen_by_library(points: torch.Tensor, faces: torch.Tensor, size: tuple[int, int] = SIZE) -> torch.Tensor:
    return find(points, [Topology.of(faces.numpy(), points.numpy())], size)[0].face


def depths_seen(seen: torch.Tensor, points: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    y, x = (seen >= 0).nonzero().to(points.dtype).add(0.5).unbind(1)
    return reference._depth_at(points[faces.long()][seen[seen >= 0].long()], x, y)


@pytest.mark.parametrize(("dtype", "flips"), [(torch.float64, 0.0), (torch.float32, 2e-3)])
def test_random_triangles_are_seen_as_by_the_reference(
    triangles: Callable, dtype: torch.dtype, flips: float
) -> None:
    rng = np.random.default_rng(0)
    different, covered, past = [], [], 0
    for _ in range(6):
        points, faces = triangles(rng, 50)
        a, b = seen_by_library(points.to(dtype), faces), reference.visible_faces(points, faces, SIZE)
        different.append((a != b).float().mean().item())
        covered.append(((a >= 0).float() - (b >= 0).float()).mean().item())
        assert (b >= 0).float().mean() > 0.2
        past += int((b < 0).sum())
    assert past > 100 and max(different) <= flips and abs(np.mean(covered)) <= flips / 4


def test_layers_are_drawn_as_single_meshes_are(triangles: Callable) -> None:
    """Each layer shows what `rasterize` shows of its faces, numbered after those of layers before."""
    rng = np.random.default_rng(2)
    camera = Camera(32, 24, 40.0, 16.2, 11.9)
    points, faces = triangles(rng, 100)
    ahead = (points[:, 2][faces.long()] > NEAR).all(1)  # `rasterize` draws no others
    halves = faces[ahead].numpy()[:30], faces[ahead].numpy()[30:]
    topologies = [Topology.of(half, points.numpy()) for half in halves]
    found = find(points.float().repeat(2, 1), topologies, SIZE)
    in_camera = points.numpy().copy()
    in_camera[:, :2] = (in_camera[:, :2] - np.array([16.2, 11.9]) * in_camera[:, 2:]) / 40.0
    for layer, half, first in zip(found, halves, (0, 30), strict=True):
        alone = rasterize(in_camera, half, np.eye(3), np.zeros(3), camera).face
        expected = np.where(alone < 0, -1, alone + first)
        assert (expected >= 0).mean() > 0.2
        assert (layer.face.numpy() != expected).mean() < 2e-3


def test_what_lies_nearer_than_the_near_plane_is_cut_off_and_the_rest_is_drawn(triangles: Callable) -> None:
    points = torch.tensor(
        [[16.0 * 0.5, 12 * 0.5, 0.5], [32 * 0.5, 12 * 0.5, 0.5], [-4.0, 6.0, -0.5]]
    ).double()
    faces = torch.tensor([[0, 1, 2]]).int()
    seen = seen_by_library(points, faces)
    assert 20 < (seen >= 0).sum() < 24 * 32
    depth = depths_seen(seen, points, faces)
    assert depth.min() >= NEAR and depth.max() <= 0.5
    mirrored = points * torch.tensor([1.0, 1, -1])  # behind the eye altogether, but for one corner
    assert depths_seen(seen_by_library(mirrored, faces), mirrored, faces).isfinite().all()
    assert (seen_by_library(-points.abs(), faces) < 0).all()


def test_degenerate_faces_are_nothing() -> None:
    points = torch.tensor([[8.0, 6, 0.5], [16, 6, 0.5], [24, 6, 0.5], [0, 0, 0], [0, 0, 0]])
    faces = torch.tensor([[0, 0, 0], [0, 1, 1], [0, 1, 2], [3, 4, 0], [3, 3, 4]]).int()
    assert (seen_by_library(points, faces) < 0).all()


@pytest.mark.parametrize("size", [60, 4096])
def test_a_sheet_of_small_faces_has_no_seams(size: int) -> None:
    # Float32, rows and columns of vertices on and beside pixel centres.
    rng = np.random.default_rng(4)
    n = 40
    u, v = np.meshgrid(np.linspace(-2, 62, n), np.linspace(-2, 62, n))
    u, v = u + np.round(rng.normal(0, 0.4, u.shape)) * 0.5, v + np.round(rng.normal(0, 0.4, v.shape)) * 0.5
    depth = 0.5 + 0.05 * rng.random(u.shape)
    offset = size - 60  # the far corner of the image
    points = np.stack([(u + offset) * depth, (v + offset) * depth, depth], -1).reshape(-1, 3)
    at = np.arange(n * n).reshape(n, n)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]))
    faces = torch.from_numpy(np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])).int()
    seen = seen_by_library(torch.tensor(points, dtype=torch.float32), faces, (size, size))
    assert (seen[offset + 1 : -1, offset + 1 : -1] >= 0).all()
