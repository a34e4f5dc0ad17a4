from __future__ import annotations

from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import trimesh
import warp as wp

from vig.render import Geometry, shade_vertices
from vig.render.geometry import edges_of
from vig.render.scratch import Scratch
from vig.scene import Latents, ObjectClass, irradiance, vertex_normals


@pytest.fixture(scope="module")
def latents(studio) -> Latents:
    return studio.latents(np.random.default_rng(0), 3)


def shaded(
    studio, latents: Latents, framing: torch.Tensor | None = None, geometry: Geometry | None = None
) -> SimpleNamespace:
    """A `VertexState` as tensors of its own."""
    framing = torch.zeros(len(latents), 3, dtype=torch.float64) if framing is None else framing
    state = shade_vertices(geometry or studio.geometry, studio.camera, latents, framing, Scratch("cpu"))
    tensors = {field.name: wp.to_torch(getattr(state, field.name)).clone() for field in fields(state)}
    return SimpleNamespace(**tensors)


def slopes(studio, latents: Latents, column: int, step: float) -> torch.Tensor:
    """Central difference of the vertices' irradiance along one latent: (B, V)."""
    vector = latents.to_vector()
    off = torch.zeros_like(vector)
    off[:, column] = step
    ahead, behind = (shaded(studio, Latents.from_vector(vector + s * off)).irradiances for s in (1, -1))
    return (ahead - behind) / (2 * step)


def test_vertices_are_placed_by_the_cameras_pose(studio, latents: Latents) -> None:
    state = shaded(studio, latents)
    rotation, translation = studio.camera.pose(latents.azimuth, latents.elevation)
    world = studio.geometry.model.vertices(latents.shape)
    expected = world @ rotation.mT + translation[:, None]
    torch.testing.assert_close(state.points, expected, atol=1e-12, rtol=0)
    torch.testing.assert_close(state.rotation, rotation)


def test_normals_and_irradiance_are_those_of_the_mesh(studio, latents: Latents) -> None:
    # The renderer forms normals as a quadratic in the coefficients; the mesh has them from its faces.
    state = shaded(studio, latents)
    world = studio.geometry.model.vertices(latents.shape).numpy()
    normals = torch.from_numpy(np.stack([vertex_normals(v, studio.geometry.model.faces) for v in world]))
    torch.testing.assert_close(state.normals, normals, atol=1e-10, rtol=0)
    expected = irradiance(latents.light[:, None, :], normals)
    torch.testing.assert_close(state.irradiances, expected, atol=1e-10, rtol=0)
    torch.testing.assert_close(
        state.attributes[..., studio.geometry.layout.irradiance], expected, atol=1e-10, rtol=0
    )


def test_attributes_are_the_irradiances_derivatives(studio, latents: Latents) -> None:
    state, layout, step = shaded(studio, latents), studio.geometry.layout, 1e-5
    smooth = state.irradiances > 1e-3  # away from the fold at 0
    assert smooth.double().mean() > 0.8
    columns = {mode: mode for mode in range(layout.modes)}
    columns |= {layout.light + i: layout.modes + 5 + i for i in range(9)}
    for row_column, latent_column in columns.items():
        numeric = slopes(studio, latents, latent_column, step)
        analytic = state.attributes[..., row_column]
        scale = numeric[smooth].abs().max()
        assert scale > 0.01
        torch.testing.assert_close(analytic[smooth], numeric[smooth], atol=float(1e-7 * scale), rtol=0)


def test_the_objects_own_light_does_not_follow_the_eye(studio, latents: Latents) -> None:
    # World light: turning the eye or changing the paint leaves each vertex's irradiance as it is.
    for column in range(studio.geometry.layout.modes, studio.geometry.layout.modes + 5):
        assert not slopes(studio, latents, column, 0.1).any()


def test_a_vertex_in_the_dark_has_no_irradiance_and_no_derivative(studio, latents: Latents) -> None:
    light = torch.zeros_like(latents.light)
    light[:, 2] = 3.0  # from above only: irradiance (2/3) L10 Y10(n), negative on faces that look down
    dark = Latents(latents.shape, latents.azimuth, latents.elevation, latents.albedo, light)
    state = shaded(studio, dark)
    below = state.normals[..., 2] < 0
    assert below.any() and not state.irradiances[below].any() and not state.attributes[below].any()
    assert (state.irradiances[~below] >= 0).all()


def test_framing_shifts_by_widths_and_magnifies_by_its_exponential(studio, latents: Latents) -> None:
    framing = torch.tensor([[0.0, 0.0, 0.0], [0.1, -0.2, 0.0], [0.0, 0.0, 0.3]], dtype=torch.float64)
    focal, cx, cy = shaded(studio, latents, framing).intrinsics.T
    camera = studio.camera
    np.testing.assert_allclose(focal, [camera.focal, camera.focal, camera.focal * np.exp(0.3)])
    np.testing.assert_allclose(cx, [camera.cx, camera.cx + 15, camera.cx])
    np.testing.assert_allclose(cy, [camera.cy, camera.cy - 30, camera.cy])


def test_single_precision_shades_alike(studio, teapot: ObjectClass, latents: Latents) -> None:
    exact = shaded(studio, latents)
    rounded = Latents.from_vector(latents.to_vector().float())
    single = shaded(studio, rounded, geometry=Geometry(teapot.shape_model))
    torch.testing.assert_close(single.points.double(), exact.points, atol=1e-6, rtol=0)
    torch.testing.assert_close(single.irradiances.double(), exact.irradiances, atol=1e-4, rtol=0)


def test_every_edge_of_a_closed_mesh_is_listed_once_with_both_its_faces() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    edges = edges_of(ball.faces)
    assert len(edges) == len(ball.faces) * 3 // 2
    assert len(np.unique(np.sort(edges[:, :2], axis=1), axis=0)) == len(edges)
    for a, b, face, beyond, corner in edges:
        assert {a, b} <= set(ball.faces[face])
        assert set(ball.faces[beyond]) == {a, b, corner}
        at = list(ball.faces[face]).index(a)
        assert ball.faces[face][(at + 1) % 3] == b  # the face holds it as a to b


def test_the_border_of_a_sheet_has_nothing_beyond() -> None:
    edges = edges_of(np.array([[0, 1, 2], [2, 1, 3]]))
    assert len(edges) == 5
    assert (edges[:, 3] == -1).sum() == 4
    inner = edges[edges[:, 3] >= 0][0]
    assert inner.tolist() == [1, 2, 0, 1, 3]


def test_other_precisions_are_refused(teapot: ObjectClass, studio, latents: Latents) -> None:
    half = Geometry(teapot.shape_model, torch.float16)
    with pytest.raises(ValueError, match=r"float32 or float64; got torch\.float16"):
        shaded(studio, latents, geometry=half)
