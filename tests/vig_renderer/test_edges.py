"""Occlusion edges: which are seen, and what coverage they make of it."""

import numpy as np
import pytest
import torch
import trimesh

from tests.vig_renderer.reference import coverage, find, visible_edges
from vig_renderer import Topology

SIZE = (24, 32)


def on_screen(vertices: np.ndarray, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    """Screen points of camera-frame vertices; the camera looks at (16.2, 11.9) with f = 40."""
    depth = vertices[:, 2:]
    points = np.concatenate([vertices[:, :2] * 40 + np.array([16.2, 11.9]) * depth, depth], axis=1)
    return torch.tensor(points, dtype=dtype)


def flat(*polygons: list[tuple[float, float]], depth: float = 1.0) -> tuple[torch.Tensor, Topology]:
    """Convex polygons (pixels) on a plane before the eye, the later ones nearer, as one mesh."""
    points, faces = [], []
    for number, polygon in enumerate(polygons):
        z = depth - 0.1 * number
        start = len(points)
        points += [[x * z, y * z, z] for x, y in polygon]
        faces += [[start, start + i, start + i + 1] for i in range(1, len(polygon) - 1)]
    points = np.array(points)
    return torch.from_numpy(points), Topology.of(np.array(faces), points)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_visible_rims_are_the_references(dtype: torch.dtype) -> None:
    rng = np.random.default_rng(0)
    missed = total = 0
    for _ in range(3):
        torus = trimesh.creation.torus(0.12, 0.05, major_sections=9, minor_sections=6)
        torus.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
        box = trimesh.creation.box((0.1, 0.15, 0.1))
        vertices = np.concatenate(
            [torus.vertices + (0.05, 0, 0.7), box.vertices + (*rng.normal(0, 0.05, 2), 1)]
        )
        faces = np.concatenate([torus.faces, box.faces + len(torus.vertices)])
        topology = Topology.of(faces, vertices)
        (found,) = find(on_screen(vertices, dtype), [topology], SIZE)
        expected = visible_edges(on_screen(vertices), topology, SIZE)
        assert len(expected) > 60  # and many more that are hidden
        missed += len(found.edges ^ expected)
        total += len(expected)
    assert missed <= (0 if dtype == torch.float64 else 0.02 * total)


def test_rims_behind_something_and_edges_within_a_surface_are_not_seen() -> None:
    points, topology = flat(
        [(10.2, 8.1), (18.3, 8.2), (18.1, 15.7), (10.4, 15.4)],  # hidden
        [(5.2, 4.1), (25.3, 4.4), (25.1, 20.2), (5.4, 20.3)],
    )
    (found,) = find(points, [topology], SIZE)
    pairs = {(a, b) for a, b, *_ in found.edges}
    # None of the first four vertices; the diagonal (4, 6) is no rim.
    assert pairs == {(4, 5), (5, 6), (6, 7), (4, 7)}


def test_an_edge_that_runs_away_is_as_near_as_perspective_has_it() -> None:
    """From a depth of 1/2 to 2 its middle on the screen is 0.8 away, before what is 1 away; not 1.25."""
    receding = [(6.2, 2.1, 0.5), (16.1, 2.1, 0.5), (16.3, 22.1, 2.0), (6.4, 22.1, 2.0)]
    behind = [(10.4, 10.1, 1.0), (25.2, 10.2, 1.0), (25.3, 13.8, 1.0), (10.3, 13.7, 1.0)]
    points = np.array([(x * z, y * z, z) for x, y, z in receding + behind])
    topology = Topology.of(np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]), points)
    (found,) = find(torch.from_numpy(points), [topology], SIZE)
    right_edge = {line for a, b, axis, line, _ in found.edges if (a, b, axis) == (1, 2, 0)}
    assert right_edge == set(range(2, 22))


@pytest.mark.parametrize("right", [20.0, 20.3, 20.5, 20.6, 21.0])
def test_upright_edges_cover_exactly_their_area(right: float) -> None:
    points, topology = flat([(5.25, 3.4), (right, 3.4), (right, 17.7), (5.25, 17.7)])
    found = coverage(points, topology, SIZE)
    # Area of the rectangle in each pixel, corners left out.
    columns = np.clip(right - np.arange(32), 0, 1) * np.clip(np.arange(1, 33) - 5.25, 0, 1)
    rows = np.clip(17.7 - np.arange(24), 0, 1) * np.clip(np.arange(1, 25) - 3.4, 0, 1)
    middle = found[6:15].numpy()
    np.testing.assert_allclose(middle, np.broadcast_to(columns, middle.shape), atol=1e-12)
    np.testing.assert_allclose(found[:, 8:18].numpy(), np.broadcast_to(rows[:, None], (24, 10)), atol=1e-12)


def test_the_covered_area_follows_the_polygon_without_jumps() -> None:
    # A hexagon that drifts over the pixel grid: its area is constant, so must be the sum of coverages.
    angles = np.arange(6) * np.pi / 3 + 0.2
    area = 1.5 * np.sqrt(3) * 8**2
    sums = []
    for step in np.linspace(0, 1, 101):
        centre = (14 + step, 12 + 0.37 * step)
        hexagon = [(centre[0] + 8 * np.cos(t), centre[1] + 8 * np.sin(t)) for t in angles]
        sums.append(coverage(*flat(hexagon), SIZE).sum().item())
    assert np.mean(sums) == pytest.approx(area, abs=0.1)
    assert np.abs(np.array(sums) - area).max() < 1.0
    assert np.abs(np.diff(sums)).max() < 0.15


def test_what_two_edges_share_is_blended_once() -> None:
    # Two sheets with the same outline, one right behind the other: the same coverage as one of them.
    outline = [(5.2, 4.1), (25.3, 4.4), (25.1, 20.2), (5.4, 20.3)]
    double, single = coverage(*flat(outline, outline), SIZE), coverage(*flat(outline), SIZE)
    torch.testing.assert_close(double, single)


def test_images_without_edges_stay_as_they_are() -> None:
    points, topology = flat([(-50.0, -50.0), (90, -50), (90, 90), (-50, 90)])
    assert (coverage(points, topology, SIZE) == 1).all()
    assert coverage(points, topology, (1, 1)).item() == 1
