"""Vertex attributes, light and textures at pixels, and the blending at occlusion edges, in plain torch."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from vig_renderer import Pyramid
from vig_renderer.harmonics import COSINE_LOBE, sh_basis


@dataclass(frozen=True)
class Crossings:
    """Silhouette edges of L layers, and where M of them visibly cross the lines of pixel centres.

    Attributes:
        edges: (S, 2) int64, the vertices a and b of each silhouette edge, visible or not.
        edge: (M,) int64, which of these crosses.
        axis: (M,) int64, 0 between neighbours in a row, 1 in a column.
        line: (M,) which row (axis 0) or column.
        low: (M,) the neighbour's column (row) that comes first.
        here: (M,) int64, the first of the two pixels, as (l H + y) W + x.
        there: (M,) int64, the second.
        sharers: (M,) how many visible crossings lie between the same two pixels.
    """

    edges: torch.Tensor
    edge: torch.Tensor
    axis: torch.Tensor
    line: torch.Tensor
    low: torch.Tensor
    here: torch.Tensor
    there: torch.Tensor
    sharers: torch.Tensor


def antialias(image: torch.Tensor, screen: torch.Tensor, crossings: Crossings) -> torch.Tensor:
    """Blend an image at its occlusion edges.

    image (B, H, W, C): sampled at the pixels' centres, any channels (colours, masks). screen (V, 2): the
    vertices, pixels. crossings: from the same scene. Result (B, H, W, C). Differentiable in image and screen.
    """
    if len(crossings.edge) == 0:
        return image
    channels = image.shape[-1]
    weight, share = _weight_and_place(screen, crossings)
    amount = weight * (0.5 - share) / crossings.sharers
    flat = image.reshape(-1, channels)
    step = flat.index_select(0, crossings.there) - flat.index_select(0, crossings.here)
    change = amount[:, None] * step
    target = torch.where(share < 0.5, crossings.here, crossings.there)
    return flat.index_add(0, target, change).view(image.shape)


def _weight_and_place(screen: torch.Tensor, crossings: Crossings) -> tuple[torch.Tensor, torch.Tensor]:
    """Return for each crossing the weight of its direction, and its share of the way between the centres."""
    tiny = 1e-12  # square pixels
    joints = crossings.edges.reshape(-1)
    first, second = screen.index_select(0, joints).view(-1, 2, 2).unbind(1)
    along = second - first
    square = along.square()
    length_square = square.sum(1).clamp_min(tiny)
    # Square of the normal's x component: the weight of crossings along rows.
    steep = square[:, 1] / length_square
    total = screen.new_zeros(len(screen)).index_add(0, joints, steep.repeat_interleave(2))
    count = screen.new_zeros(len(screen)).index_add(0, joints, torch.ones_like(steep).repeat_interleave(2))
    joint_steep = (total / count.clamp_min(1.0)).index_select(0, joints).view(-1, 2)

    edge, column = crossings.edge, crossings.axis == 1
    u_first, v_first = _by_axis(first.index_select(0, edge), column)
    u_second, v_second = _by_axis(second.index_select(0, edge), column)
    on_edge = (crossings.line + 0.5 - v_first) / (v_second - v_first)
    share = u_first + on_edge * (u_second - u_first) - 0.5 - crossings.low
    # Within one pixel of an end, or over the whole edge where that is shorter, the joint's mean takes over.
    length = length_square.index_select(0, edge).sqrt().clamp_min(1.0)
    near_first = (1 - on_edge * length).clamp_min(0.0)
    near_second = (1 - (1 - on_edge) * length).clamp_min(0.0)
    own = steep.index_select(0, edge)
    at_first, at_second = joint_steep.index_select(0, edge).unbind(1)
    weight = own + near_first * (at_first - own) + near_second * (at_second - own)
    return torch.where(column, 1 - weight, weight), share


def _by_axis(points: torch.Tensor, column: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return coordinates along and across the pair of pixels: (x, y) in rows, (y, x) in columns."""
    x, y = points.unbind(1)
    return torch.where(column, y, x), torch.where(column, x, y)


def barycentrics(
    points: torch.Tensor, corners: torch.Tensor, pixels: torch.Tensor, derivatives: bool = True
) -> torch.Tensor:
    """Return weights of the corners of N seen faces at the centres of N pixels; differentiable in points.

    Args:
        points: (V, 3) homogeneous screen points (x z, y z, z).
        corners: (N, 3) int64, the faces' vertices.
        pixels: (N, 2), column and row.
        derivatives: Whether to return the weights' derivatives along the screen, too.

    Returns:
        (N, 3, 3): the weights, then their derivatives per pixel to the right, and per pixel downwards;
        without `derivatives` (N, 1, 3).
    """
    # Corners relative to the pixel, times their depths: (3, N) each, as rows are fastest.
    picked = points.T.index_select(1, corners.T.reshape(-1)).view(3, 3, -1)
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

    attributes (V, C), corners (N, 3) int64 and barycentric weights (N, 3) give (N, C), differentiable in
    attributes and weights; derivatives of the weights along the screen give those of the attributes.
    """
    rows = attributes.index_select(0, corners.reshape(-1)).view(len(corners), 3, attributes.shape[1])
    # A batched product: one kernel for forward and backward where a sum over corners takes three.
    return (weights[:, None] @ rows)[:, 0]


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


def sample_texture(texture: Pyramid, uv: torch.Tensor, footprint: torch.Tensor) -> torch.Tensor:
    """Look a texture up at N points: (N, C), in plain torch.

    uv (N, 2): (0, 0) is the image's lower left corner, (1, 1) its upper right, repeated outside. footprint
    (N, 2, 2): how uv change per pixel to the right, then per pixel downwards. The level of detail is the
    logarithm of the pixel's root mean square size in texels. Differentiable in texels, uv and footprint.
    """
    size = texture.levels[0, [2, 1]].to(uv)
    last = len(texture.levels) - 1
    square = (footprint * size).square().sum(dim=(1, 2)) / 2
    level = 0.5 / math.log(2.0) * square.clamp_min(1e-12).log()
    fine = level.detach().floor().clamp(0, last).long()
    between = (level > 0) & (level < last)
    share = torch.where(between, level - fine, 0.0)[:, None]
    coarse = (fine + 1).clamp_max(last)
    # Trilinear: the two nearest levels, blended (Williams 1983).
    return (1 - share) * _bilinear(texture, fine, uv) + share * _bilinear(texture, coarse, uv)


def _bilinear(texture: Pyramid, level: torch.Tensor, uv: torch.Tensor) -> torch.Tensor:
    start, height, width = texture.levels[level].long().unbind(1)
    # Whole turns of the texture are dropped first: large uv must not overflow. v runs up, rows run down.
    u, v = (uv - uv.detach().floor()).unbind(1)
    x, y = u * width - 0.5, (1 - v) * height - 0.5
    left, top = x.detach().floor().long(), y.detach().floor().long()
    across, down = (x - left)[:, None], (y - top)[:, None]

    def texel(row: torch.Tensor, column: torch.Tensor) -> torch.Tensor:
        return texture.texels.index_select(0, start + row.remainder(height) * width + column.remainder(width))

    upper = (1 - across) * texel(top, left) + across * texel(top, left + 1)
    lower = (1 - across) * texel(top + 1, left) + across * texel(top + 1, left + 1)
    return (1 - down) * upper + down * lower
