from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from tests.vig_renderer.primitives import reference
from vig.scene import Camera
from vig_renderer.primitives import Visible, visible_faces
from vig_renderer.raster import NEAR
from vig_world.raster.rasterize import rasterize

SIZE = (2, 24, 32)


def faces_seen(visible: Visible) -> torch.Tensor:
    return visible.image(visible.face[:, None] + 1)[..., 0] - 1


def depths_seen(visible: Visible, points: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    x, y = (visible.centres + 0.5).to(points.dtype).unbind(1)
    return reference._depth_at(points[faces.long()][visible.face], x, y)


@pytest.mark.parametrize(("dtype", "flips"), [(torch.float64, 0.0), (torch.float32, 2e-3)])
def test_random_triangles_are_seen_as_by_the_reference(
    triangles: Callable, dtype: torch.dtype, flips: float
) -> None:
    rng = np.random.default_rng(0)
    different, covered = [], []
    for _ in range(6):
        points, faces = triangles(rng, 100)
        layer = torch.from_numpy(rng.integers(0, 2, len(faces))).int()
        found = visible_faces(points.to(dtype), faces, layer, SIZE)
        expected = reference.visible_faces(points, faces, layer, SIZE)
        a, b = faces_seen(found), faces_seen(expected)
        different.append((a != b).float().mean().item())
        covered.append(((a >= 0).float() - (b >= 0).float()).mean().item())
        assert 0.2 < (b >= 0).float().mean() < 1  # something to see, and past
    assert max(different) <= flips and abs(np.mean(covered)) <= flips / 4


def test_batches_are_drawn_as_single_meshes_are(triangles: Callable) -> None:
    """The same kernel: each image of a batch shows what `rasterize` shows of its faces alone."""
    rng = np.random.default_rng(2)
    camera = Camera(32, 24, 40.0, 16.2, 11.9)
    points, faces = triangles(rng, 100)
    ahead = (points[:, 2][faces.long()] > NEAR).all(1)  # `rasterize` draws no others
    faces, layer = faces[ahead], torch.from_numpy(rng.integers(0, 2, int(ahead.sum()))).int()
    seen = faces_seen(visible_faces(points.float(), faces, layer, SIZE))
    in_camera = points.numpy().copy()
    in_camera[:, :2] = (in_camera[:, :2] - np.array([16.2, 11.9]) * in_camera[:, 2:]) / 40.0
    for image in range(2):
        own = (layer == image).nonzero().squeeze(1)
        alone = rasterize(in_camera, faces[own].numpy(), np.eye(3), np.zeros(3), camera).face
        expected = np.where(alone < 0, -1, own.numpy()[alone])
        assert (expected >= 0).mean() > 0.2
        assert (seen[image].numpy() != expected).mean() < 2e-3


def test_what_lies_nearer_than_the_near_plane_is_cut_off_and_the_rest_is_drawn(triangles: Callable) -> None:
    points = torch.tensor(
        [[16.0 * 0.5, 12 * 0.5, 0.5], [32 * 0.5, 12 * 0.5, 0.5], [-4.0, 6.0, -0.5]]
    ).double()
    faces, layer = torch.tensor([[0, 1, 2]]).int(), torch.zeros(1).int()
    seen = visible_faces(points, faces, layer, (1, 24, 32))
    assert 20 < len(seen.pixel) < 24 * 32
    depth = depths_seen(seen, points, faces)
    assert depth.min() >= NEAR and depth.max() <= 0.5
    mirrored = points * torch.tensor([1.0, 1, -1])  # behind the eye altogether, but for one corner
    assert depths_seen(visible_faces(mirrored, faces, layer, (1, 24, 32)), mirrored, faces).isfinite().all()
    assert len(visible_faces(-points.abs(), faces, layer, (1, 24, 32)).pixel) == 0


def test_degenerate_faces_are_nothing() -> None:
    points = torch.tensor([[8.0, 6, 0.5], [16, 6, 0.5], [24, 6, 0.5], [0, 0, 0], [0, 0, 0]])
    faces = torch.tensor([[0, 0, 0], [0, 1, 1], [0, 1, 2], [3, 4, 0], [3, 3, 4]]).int()
    assert len(visible_faces(points, faces, torch.zeros(5).int(), (1, 24, 32)).pixel) == 0


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
    layer = torch.zeros(len(faces)).int()
    seen = visible_faces(torch.tensor(points, dtype=torch.float32), faces, layer, (1, size, size))
    assert (faces_seen(seen)[0, offset + 1 : -1, offset + 1 : -1] >= 0).all()


def test_an_image_of_rows_puts_each_where_it_was_seen() -> None:
    visible = Visible(torch.tensor([1, 7]), torch.tensor([5, 6]), (2, 2, 2))
    image = visible.image(torch.tensor([[1.0], [2.0]]), -3.0)
    assert image.shape == (2, 2, 2, 1)
    assert image[..., 0].tolist() == [[[-3, 1], [-3, -3]], [[-3, -3], [-3, 2]]]
    assert visible.centres.tolist() == [[1, 0], [1, 1]]
