"""Visibility, occlusion edges and interpolation in plain torch, as their definitions read: slow, for tests.

Derivatives are autograd's own. `find` asks the library for the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch

from vig_native import engine
from vig_renderer import NEAR, Pyramid, Topology
from vig_renderer.general import MARGIN

Edges = set[tuple[int, int, int, int, int]]
"""Visible occlusion edges: vertex a, vertex b, axis, line, the first of the two pixels."""


@dataclass(frozen=True)
class Found:
    """What the library sees of one layer of H x W pixels: face (H, W), numbered through, -1 for none."""

    face: torch.Tensor
    edges: Edges


def layers(points: torch.Tensor, topologies: Sequence[Topology], size: tuple[int, int]) -> Any:
    """A layer for each topology in the library; points (V, 3) of all, one after the other."""
    kind = engine.Scenes32 if points.dtype == torch.float32 else engine.Scenes64
    count = len(topologies)
    numbers = [0] * count, list(range(count + 1))
    scenes = kind([each.mesh for each in topologies], [None] * count, *numbers, *size, 1, NEAR, 1, True)
    scenes.bind(points.numpy(), None)
    return scenes


def find(points: torch.Tensor, topologies: Sequence[Topology], size: tuple[int, int]) -> list[Found]:
    """What is seen of each layer."""
    scenes, found = layers(points, topologies, size), []
    scenes.find(True, 1)
    for face, silhouettes, crossings in scenes.found():
        grid = torch.from_numpy(face).view(size[0] + 2 * MARGIN, size[1] + 2 * MARGIN)
        edges = set()
        for edge, axis, line, low, *_ in (crossings - [0, 0, MARGIN, MARGIN, 0, 0, 0]).tolist():
            if 0 <= line < size[axis] and 0 <= low < size[1 - axis] - 1:
                edges.add((*silhouettes[edge, :2].tolist(), axis, line, low))
        found.append(Found(grid[MARGIN:-MARGIN, MARGIN:-MARGIN], edges))
    return found


def coverage(points: torch.Tensor, topology: Topology, size: tuple[int, int]) -> torch.Tensor:
    """The share of each pixel that a mesh covers, by the library: (H, W)."""
    mask = points.new_empty(1, 1, *size)
    layers(points, [topology], size).paint(None, None, None, mask.numpy(), 1)
    return mask[0, 0]


def _edge_functions(corners: torch.Tensor, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
    """Doubled areas (..., 3) that the pixel at (x, y) cuts off opposite each corner, times two depths.

    corners (..., 3, 3): homogeneous screen points.
    """
    pixel = torch.stack([x, y], dim=-1)[..., None, :]
    a, b, c = (corners[..., :2] - pixel * corners[..., 2:]).unbind(-2)

    def cross(p: torch.Tensor, q: torch.Tensor) -> torch.Tensor:
        return p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]

    return torch.stack([cross(b, c), cross(c, a), cross(a, b)], dim=-1)


def _depth_at(corners: torch.Tensor, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
    """Depth at which the ray through (x, y) meets a triangle beyond NEAR; inf where it does not."""
    weights = _edge_functions(corners, x, y)
    total = weights.sum(-1)
    inside = ((weights >= 0).all(-1) | (weights <= 0).all(-1)) & (total != 0)
    depth = (weights * corners[..., 2]).sum(-1) / torch.where(total == 0, 1.0, total)
    return torch.where(inside & (depth >= NEAR), depth, torch.inf)


def visible_faces(points: torch.Tensor, faces: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    """Every face against every pixel: the nearest (H, W), -1 for none."""
    nearest, seen = points.new_full(size, torch.inf), torch.full(size, -1)
    y, x = torch.meshgrid(*(torch.arange(side).to(points) + 0.5 for side in size), indexing="ij")
    for face, corners in enumerate(faces.long()):
        depth = _depth_at(points[corners].expand(*size, 3, 3), x, y)
        nearer = depth < nearest
        nearest = torch.where(nearer, depth, nearest)
        seen = torch.where(nearer, face, seen)
    return seen


def barycentrics(points: torch.Tensor, corners: torch.Tensor, pixels: torch.Tensor) -> torch.Tensor:
    """Weights by their definition, and their derivatives along the screen by the quotient rule."""
    x, y = (pixels.to(points.dtype) + 0.5).unbind(1)
    triangles = points[corners.long()]
    functions = _edge_functions(triangles, x, y)
    total = functions.sum(1, keepdim=True)
    weights = functions / total
    rows = [weights]
    for step_x, step_y in ((1, 0), (0, 1)):
        # Edge functions are linear in x and y: one whole step is their derivative.
        change = _edge_functions(triangles, x + step_x, y + step_y) - functions
        rows.append((change - weights * change.sum(1, keepdim=True)) / total)
    return torch.stack(rows, dim=1)


def interpolate(attributes: torch.Tensor, corners: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    """The weighted sum over the three corners."""
    return (attributes[corners.long()] * weights[..., None]).sum(1)


def sample_texture(texture: Pyramid, uv: torch.Tensor, footprint: torch.Tensor) -> torch.Tensor:
    """One point after the other."""
    rows, last = [], len(texture.levels) - 1
    _, height, width = texture.levels[0].tolist()
    for place, change in zip(uv, footprint.reshape(-1, 2, 2), strict=True):
        texels = change * change.new_tensor([width, height])
        mean_square = texels.square().sum() / 2
        level = (0.5 * torch.log2(mean_square.clamp_min(1e-12))).clamp(0, last)
        fine = int(level)
        share = level - fine
        coarse = _bilinear(texture, min(fine + 1, last), place)
        rows.append((1 - share) * _bilinear(texture, fine, place) + share * coarse)
    return torch.stack(rows)


def _bilinear(textures: Pyramid, level: int, uv: torch.Tensor) -> torch.Tensor:
    start, height, width = textures.levels[level].tolist()
    image = textures.texels[start : start + height * width].view(height, width, -1)
    x, y = uv[0] * width - 0.5, (1 - uv[1]) * height - 0.5
    left, top = int(x.floor()), int(y.floor())
    fx, fy = x - left, y - top

    def texel(row: int, column: int) -> torch.Tensor:
        return image[row % height, column % width]

    upper = (1 - fx) * texel(top, left) + fx * texel(top, left + 1)
    lower = (1 - fx) * texel(top + 1, left) + fx * texel(top + 1, left + 1)
    return (1 - fy) * upper + fy * lower


def visible_edges(points: torch.Tensor, topology: Topology, size: tuple[int, int]) -> Edges:
    """What `find` finds."""
    height, width = size
    faces, found = topology.faces.long(), set()
    for a, b, apex, beyond, face, other in topology.edges.tolist():
        if min(points[a, 2], points[b, 2]) < NEAR:
            continue
        pixel_a, pixel_b = points[a, :2] / points[a, 2], points[b, :2] / points[b, 2]
        if beyond >= 0:
            # On which side of the line a to b a face lies: the sign of a determinant of homogeneous points.
            sides = [torch.linalg.det(torch.stack([points[a], points[b], points[c]])) for c in (apex, beyond)]
            if sides[0] * sides[1] <= 0:
                continue
        others = torch.tensor([number for number in range(len(faces)) if number not in (face, other)])
        for axis in range(2):
            across, lines, steps = 1 - axis, (height, width)[axis], (width, height)[axis]
            for line in range(lines):
                v = line + 0.5
                if (pixel_a[across] <= v) == (pixel_b[across] <= v):
                    continue
                share = (v - pixel_a[across]) / (pixel_b[across] - pixel_a[across])
                u = pixel_a[axis] + share * (pixel_b[axis] - pixel_a[axis])
                low = int((u - 0.5).floor())
                if not 0 <= low < steps - 1:
                    continue
                depth = 1 / ((1 - share) / points[a, 2] + share / points[b, 2])
                x, y = (u, u.new_tensor(v)) if axis == 0 else (u.new_tensor(v), u)
                before = _depth_at(points[faces[others]], x.expand(len(others)), y.expand(len(others)))
                if not (before < depth * (1 - 1e-7)).any():
                    found.add((a, b, axis, line, low))
    return found
