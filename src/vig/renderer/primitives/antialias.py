"""Analytic coverage at occlusion edges: the part of the renderer through which a loss feels silhouettes.

A silhouette edge that crosses the line between two neighbouring pixel centres at a share t of the way leaves
the pixel whose half it crosses with |1/2 - t| of the other's colour. Edges are looked for along rows and
columns, weighted by the squares n_x^2 and n_y^2 of the edge's normal on the screen: the two sum to one
wherever they are taken, so that over all places of an edge against the pixel grid the area it sweeps is
counted exactly. Within a pixel of its ends its weights pass over into the mean of the edges that meet there:
nothing jumps where one hands a line over to the next.
"""

from __future__ import annotations

import torch

from vig.renderer.primitives.crossings import Crossings


def antialias(image: torch.Tensor, screen: torch.Tensor, crossings: Crossings) -> torch.Tensor:
    """Blend an image at its occlusion edges.

    image (B, H, W, C): sampled at the pixels' centres, any channels (colours, masks). screen (V, 2): the
    vertices in pixels. crossings: of the same scene. Result (B, H, W, C). Differentiable in image and screen.
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
    """Of each crossing: the weight of its direction, and its share of the way between the two centres."""
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
    """Coordinates along and across the pair of pixels: (x, y) in rows, (y, x) in columns."""
    x, y = points.unbind(1)
    return torch.where(column, y, x), torch.where(column, x, y)
