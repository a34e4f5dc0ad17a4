"""Perspective-correct barycentric weights of the seen faces, and attributes interpolated with them."""

from __future__ import annotations

import torch

from vig.renderer.kernel_calls import check_floats, check_table


def barycentrics(
    points: torch.Tensor, corners: torch.Tensor, pixels: torch.Tensor, derivatives: bool = True
) -> torch.Tensor:
    """Weights of the corners of N seen faces at the centres of N pixels; differentiable in points.

    Args:
        points: (V, 3) homogeneous screen points (x z, y z, z).
        corners: (N, 3) int32, the faces' vertices.
        pixels: (N, 2) int32, column and row.
        derivatives: Also give the weights' derivatives along the screen.

    Returns:
        (N, 3, 3): the weights, then their derivatives per pixel to the right, and per pixel downwards;
        without `derivatives` (N, 1, 3).

    Raises:
        ValueError: Other shapes and types, or corners that are not there.
    """
    check_floats(points=(points, (None, 3)))
    check_table("corners", corners, (None, 3), len(points))
    check_table("pixels", pixels, (len(corners), 2))
    # Corners relative to the pixel, times their depths: (3, N) each, as rows are fastest.
    picked = points.T.index_select(1, corners.T.reshape(-1).long()).view(3, 3, -1)
    centre = (pixels.T + 0.5).to(points.dtype)
    z = picked[2]
    x, y = picked[0] - centre[0] * z, picked[1] - centre[1] * z

    def areas(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
        # Opposite each corner, the cross product of the two others.
        return a.roll(-1, 0) * b.roll(-2, 0) - a.roll(-2, 0) * b.roll(-1, 0)

    edges = areas(x, y)
    inverse = 1 / edges.sum(0)
    weights = edges * inverse
    rows = [weights]
    # A step of one pixel moves a corner by its depth; the quotient rule.
    for change in (-areas(z, y), -areas(x, z)) if derivatives else ():
        rows.append((change - weights * change.sum(0)) * inverse)
    return torch.stack(rows).permute(2, 0, 1)


def interpolate(attributes: torch.Tensor, corners: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    """Interpolate vertex attributes at N seen points: sum_i weights[n, i] attributes[corners[n, i]].

    Args:
        attributes: (V, C) float32 or float64.
        corners: (N, 3) int32.
        weights: (N, 3) barycentric weights, or their derivatives along the screen for the attributes' own.

    Returns:
        (N, C), differentiable in attributes and weights.

    Raises:
        ValueError: Other shapes and types, or corners that are not there.
    """
    check_table("corners", corners, (None, 3), len(attributes))
    check_floats(attributes=(attributes, (None, None)), weights=(weights, (len(corners), 3)))
    rows = attributes.index_select(0, corners.reshape(-1).long()).view(len(corners), 3, attributes.shape[1])
    return (weights[:, None] @ rows)[:, 0]
