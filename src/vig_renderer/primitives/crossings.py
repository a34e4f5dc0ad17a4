"""Where visible occlusion edges pass between the centres of neighbouring pixels.

An edge of a mesh is a *silhouette edge* where its two faces lie on the same side of it on the screen, or
where there is one face only. Where it crosses the line between two neighbouring pixel centres, the faces
around are searched for one that hides the crossing; those that none hides are kept. This is exact for the
polygons: no tolerance in metres, no normals, no winding. Surfaces that pierce each other have none where they
do.
"""

import functools
from dataclasses import dataclass
from typing import Any

import torch

from vig_renderer.checks import check_indices
from vig_renderer.device import (
    TEMPLATES,
    check_floats,
    check_size,
    check_table,
    instantiate,
    kernel_module,
    launch,
    opaque,
    vector_types,
)
from vig_renderer.once import make_once
from vig_renderer.primitives.visibility import beyond_near


@make_once
def _kernels(dtype: torch.dtype) -> Any:
    return instantiate(
        [TEMPLATES / "crossings.py"], kernel_module("crossings", dtype), dtype=dtype, **vector_types(dtype)
    )


@dataclass(frozen=True)
class Crossings:
    """Silhouette edges of B images of H x W, and where M of them visibly cross the lines of pixel centres.

    Attributes:
        edges: (S, 2) int64, the vertices a and b of each silhouette edge, visible or not.
        edge: (M,) int64, which of these crosses.
        axis: (M,) int64, 0 between neighbours in a row, 1 in a column.
        line: (M,) which row (axis 0) or column.
        low: (M,) the neighbour's column (row) that comes first.
        here: (M,) int64, the first of the two pixels, as (b H + y) W + x.
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


def find_crossings(
    points: torch.Tensor,
    faces: torch.Tensor,
    edges: torch.Tensor,
    layer: torch.Tensor,
    size: tuple[int, int, int],
) -> Crossings:
    """Find the visible occlusion edges of B images; see `visible_faces` for the arguments.

    Edges with an end nearer than NEAR to the eye's plane are left out. Nothing of the result has a
    derivative: see `antialias`. `edges` is (E, 6) int32: see `Topology`, the vertices and faces of all meshes
    numbered through.
    """
    check_size(size)
    chosen, cells, hidden = opaque(
        functools.partial(_search, size=size), points.detach(), faces, edges, layer
    )
    cells = cells[(hidden == 0).nonzero().squeeze(1)].long()
    edge, axis, image, y, x = cells.unbind(1)
    _, height, width = size
    here = (image * height + y) * width + x
    _, inverse, counts = torch.unique(here * 2 + axis, return_inverse=True, return_counts=True)
    return Crossings(
        edges=edges[chosen, :2].long(),
        edge=edge,
        axis=axis,
        line=torch.where(axis == 0, y, x),
        low=torch.where(axis == 0, x, y),
        here=here,
        there=here + torch.where(axis == 0, 1, width),
        sharers=counts[inverse],
    )


def _search(
    points: torch.Tensor,
    faces: torch.Tensor,
    edges: torch.Tensor,
    layer: torch.Tensor,
    size: tuple[int, int, int],
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Indices of the silhouette edges, all their crossings (M, 5), and which of these are hidden (M,)."""
    check_floats(points=(points, (None, 3)))
    check_table("faces", faces, (None, 3), len(points))
    check_table("edges", edges, (None, 6))
    check_table("layer", layer, (len(faces),), size[0])
    check_indices("vertices of edges", edges[:, :3], len(points))
    check_indices("opposite vertices of edges", edges[:, 3], len(points), -1)
    check_indices("first faces of edges", edges[:, 4], len(faces))
    check_indices("second faces of edges", edges[:, 5], len(faces), -1)
    kernels = _kernels(points.dtype)
    images, height, width = size
    flags = torch.empty(len(edges), dtype=torch.uint8, device=points.device)
    launch(kernels.find_silhouette, len(edges), points, edges, flags)
    chosen = flags.nonzero().squeeze(1)
    counts = torch.zeros(len(chosen), dtype=torch.int32, device=points.device)
    heads = torch.full((images, 2, height, width), -1, dtype=torch.int32, device=points.device)

    def cross(fill: int, ends: torch.Tensor, total: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        cells = torch.empty((total, 5), dtype=torch.int32, device=points.device)
        links, spots = cells.new_empty(total), points.new_empty(total, 3)
        arguments = points, edges, layer, chosen, fill, counts, ends, heads, links, cells, spots
        launch(kernels.cross_lines, len(chosen), *arguments)
        return cells, links, spots

    cross(0, counts, 0)
    ends = counts.cumsum(0).int()
    cells, links, spots = cross(1, ends, int(ends[-1]) if len(ends) else 0)
    hidden = torch.zeros(len(cells), dtype=torch.uint8, device=points.device)
    if len(cells):
        points, parts, origin = beyond_near(points, faces.long())
        arguments = (
            points,
            parts.int(),
            origin,
            faces,
            layer,
            edges,
            chosen,
            heads,
            links,
            cells,
            spots,
            hidden,
        )
        launch(kernels.hide, len(parts), *arguments)
    return chosen, cells, hidden
