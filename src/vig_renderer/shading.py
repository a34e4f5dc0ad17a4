"""Smooth normals of a mesh, in plain torch."""

from __future__ import annotations

import torch


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
