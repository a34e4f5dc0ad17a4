"""The same numbers in plain torch, slowly: what the kernels are compared with, and a text to learn from."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from vig.likelihood.kernels.geometry import Geometry
from vig.likelihood.pixel import mixture
from vig.scene import Camera, Latents, camera_rotation, irradiance, sh_basis
from vig.scene.light import COSINE_LOBE, L_COUNT


@dataclass(frozen=True)
class Shaded:
    """One point's vertices. screen (V, 3): pixel coordinates and one over the depth. normals (V, 3): unit,
    world frame. irradiances (V,)."""

    screen: torch.Tensor
    normals: torch.Tensor
    irradiances: torch.Tensor


def shade(geometry: Geometry, camera: Camera, point: torch.Tensor) -> Shaded:
    """Vertices of a point (P',): latents followed by framing. All steps can be differentiated."""
    latents = Latents.from_vector(point[None, :-3])
    shift_x, shift_y, magnification = point[-3:]
    world = (torch.cat([point.new_ones(1), latents.shape[0]]) @ geometry.positions).view(-1, 3)
    rotation = camera_rotation(latents.azimuth, latents.elevation)[0]
    seen = (world - world.new_tensor([0.0, 0.0, camera.target_height])) @ rotation.T
    seen = seen + seen.new_tensor([0.0, 0.0, camera.distance])
    focal = camera.focal * torch.exp(magnification)
    centre = torch.stack([camera.cx + shift_x * camera.width, camera.cy + shift_y * camera.width])
    screen = torch.cat([seen[:, :2] / seen[:, 2:] * focal + centre, 1 / seen[:, 2:]], 1)
    a, b, c = (world[geometry.faces[:, i].long()] for i in range(3))
    across = torch.linalg.cross(b - a, c - a)
    normals = torch.zeros_like(world).index_add(0, geometry.faces.long().T.reshape(-1), across.repeat(3, 1))
    normals = normals / normals.norm(dim=1, keepdim=True).clamp_min(1e-30)
    return Shaded(screen, normals, _irradiance(geometry, latents, normals))


def _irradiance(geometry: Geometry, latents: Latents, normals: torch.Tensor) -> torch.Tensor:
    """Eq. 1 at the vertices, with self-shadow where the geometry has a table of it."""
    if geometry.transfer is None:
        return irradiance(latents.light, normals)
    with_one = torch.cat([latents.shape.new_ones(1), latents.shape[0]])
    change = (with_one @ geometry.transfer).view(-1, L_COUNT)
    lobe = torch.tensor(COSINE_LOBE, dtype=normals.dtype)
    return ((lobe * sh_basis(normals) + change) @ latents.light[0]).clamp_min(0.0)


def irradiance_at(
    geometry: Geometry, shaded: Shaded, face: torch.Tensor, pixel: torch.Tensor
) -> torch.Tensor:
    """Perspective-correct irradiance (N,) of faces (N,) int at image points (N, 2), in pixels."""
    corners = geometry.faces[face.long()].long()
    a, b, c = (shaded.screen[corners[:, i]] for i in range(3))

    def area(u: torch.Tensor, v: torch.Tensor, w: torch.Tensor) -> torch.Tensor:
        return (v[:, 0] - u[:, 0]) * (w[:, 1] - u[:, 1]) - (v[:, 1] - u[:, 1]) * (w[:, 0] - u[:, 0])

    weights = torch.stack([area(pixel, b, c), area(a, pixel, c), area(a, b, pixel)], 1)
    weights = weights * shaded.screen[corners][:, :, 2]
    return (weights * shaded.irradiances[corners]).sum(1) / weights.sum(1)


def constant_mask_value(
    geometry: Geometry,
    camera: Camera,
    point: torch.Tensor,
    photo: torch.Tensor,
    log_prior: torch.Tensor,
    sigma: float,
    seen: torch.Tensor,
) -> torch.Tensor:
    """Eq. 4 of one point (P',) with the mask held: seen (H, W) int is each pixel's face, -1 for none.

    photo, log_prior: (H, W, 3). Through it autograd gives the gradient of `silhouette="paper"`.
    """
    shaded = shade(geometry, camera, point)
    y, x = (seen >= 0).nonzero().T
    pixel = torch.stack([x + 0.5, y + 0.5], 1).to(point)
    lit = irradiance_at(geometry, shaded, seen[y, x], pixel)
    albedo = Latents.from_vector(point[None, :-3]).albedo
    value, _ = mixture(photo[y, x], albedo * lit[:, None], log_prior[y, x], sigma)
    return value.sum() + log_prior[..., 2].sum() - log_prior[y, x, 2].sum()
