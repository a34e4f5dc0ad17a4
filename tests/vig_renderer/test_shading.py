import numpy as np
import pytest
import torch
import trimesh

from vig.scene import irradiance
from vig_renderer.shading import shade, smooth_normals, unit
from vig_world.mesh import vertex_normals


def test_smooth_normals_are_the_scenes() -> None:
    torus = trimesh.creation.torus(0.1, 0.03, major_sections=9, minor_sections=7)
    found = smooth_normals(torch.from_numpy(torus.vertices), torch.from_numpy(torus.faces).int())
    np.testing.assert_allclose(found, vertex_normals(torus.vertices, torus.faces), atol=1e-12)


def test_a_vertex_without_area_has_no_normal_and_a_finite_derivative() -> None:
    vertices = torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [5, 5, 5]], requires_grad=True)
    normals = smooth_normals(vertices, torch.tensor([[0, 1, 2]]).int())
    assert not normals.any()
    normals.sum().backward()
    assert vertices.grad is not None and vertices.grad.isfinite().all()
    assert unit(torch.tensor([[3.0, 0, 4], [0, 0, 0]])).tolist() == [
        [pytest.approx(0.6), 0, pytest.approx(0.8)],
        [0, 0, 0],
    ]


@pytest.mark.parametrize("count", [1, 3])
def test_light_is_reflected_as_the_scene_says_and_a_lamp_by_its_cosine(count: int) -> None:
    rng = np.random.default_rng(0)
    normals = unit(torch.from_numpy(rng.normal(size=(50, 3))))
    owner = torch.from_numpy(rng.integers(0, count, 50))
    light = torch.from_numpy(rng.normal(size=(count, 9, 3)))
    direction = unit(torch.from_numpy(rng.normal(size=(count, 3))))
    radiance = torch.from_numpy(rng.random((count, 3)))
    found = shade(normals, owner, light, direction, radiance)
    for row in range(50):
        n, o = normals[row], owner[row]
        expected = irradiance(light[o].T, n) + radiance[o] * max(float(n @ direction[o]), 0)
        torch.testing.assert_close(found[row], expected)
