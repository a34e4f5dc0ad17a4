"""Shading in plain torch: light reflected by a white Lambertian surface of a given normal."""

import torch

from vig_renderer.harmonics import COSINE_LOBE, sh_basis


def shade(
    normals: torch.Tensor,
    owner: torch.Tensor,
    light: torch.Tensor,
    direction: torch.Tensor,
    radiance: torch.Tensor,
) -> torch.Tensor:
    """Return the light that white surfaces reflect, (N, 3): max(0, sum A_l L_lm Y_lm(n)) + radiance
    max(0, n . direction).

    normals (N, 3): unit, world frame. owner (N,): which of the O lights below shines on each. light
    (O, 9, 3): SH coefficients of incident radiance, RGB. direction (O, 3): unit, towards a distant lamp.
    radiance (O, 3): its light that a white surface facing the lamp reflects. No shadows.
    """
    lobe = torch.tensor(COSINE_LOBE, dtype=normals.dtype, device=normals.device)
    basis = sh_basis(normals) * lobe
    # One object, the usual case: no gathering of its light for each normal.
    if len(light) == 1:
        diffuse = basis @ light[0]
        cosine = normals @ direction[0]
        radiance = radiance.expand(len(normals), 3)
    else:
        diffuse = torch.einsum("nl,nlc->nc", basis, light[owner])
        cosine = (normals * direction[owner]).sum(1)
        radiance = radiance[owner]
    reflected: torch.Tensor = diffuse.clamp_min(0.0) + cosine.clamp_min(0.0)[:, None] * radiance
    return reflected


def smooth_normals(vertices: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """Return unit vertex normals, the mean of adjacent faces' weighted by area: (V, 3) and (F, 3) to (V, 3).

    A vertex without area gets the zero vector. Differentiable in vertices.
    """
    index = faces.long().reshape(-1)
    a, b, c = vertices.index_select(0, index).view(-1, 3, 3).unbind(1)
    weighted = torch.linalg.cross(b - a, c - a)
    # One addition per corner: together each of the three corners of a face takes its share.
    total = torch.zeros_like(vertices).index_add(0, index, weighted.repeat_interleave(3, 0))
    return unit(total)


def unit(vectors: torch.Tensor) -> torch.Tensor:
    """Return vectors (N, 3) of length one; vectors shorter than 1e-15 become zero and have no derivative."""
    # Scaled first, as squares of short vectors and their derivatives leave float32's range.
    size = vectors.detach().abs().amax(1, keepdim=True)
    there = size > 1e-15
    scaled = torch.where(there, vectors / torch.where(there, size, 1.0), 0.0)
    return scaled * torch.where(there, scaled.square().sum(1, keepdim=True), 1.0).rsqrt()
