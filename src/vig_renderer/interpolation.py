"""Vertex attributes at pixels, and the blending of pixels at occlusion edges, in plain torch."""

from dataclasses import dataclass

import torch


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
