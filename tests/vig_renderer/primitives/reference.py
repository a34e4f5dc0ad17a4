"""Each kernel once more in plain torch, as its definition reads: slow, for tests and for reading.

Arguments and results are those of the primitive of the same name; derivatives are autograd's own.
"""

from __future__ import annotations

import torch

from vig_renderer.primitives.texture import Pyramid
from vig_renderer.primitives.visibility import Visible
from vig_renderer.raster import NEAR


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


def visible_faces(
    points: torch.Tensor, faces: torch.Tensor, layer: torch.Tensor, size: tuple[int, int, int]
) -> Visible:
    """Every face against every pixel."""
    nearest = points.new_full(size, torch.inf)
    seen = torch.full(size, -1)
    y, x = torch.meshgrid(
        torch.arange(size[1]).to(points) + 0.5, torch.arange(size[2]).to(points) + 0.5, indexing="ij"
    )
    for face, corners in enumerate(faces.long()):
        depth = _depth_at(points[corners].expand(*size[1:], 3, 3), x, y)
        image = int(layer[face])
        nearer = depth < nearest[image]
        nearest[image] = torch.where(nearer, depth, nearest[image])
        seen[image] = torch.where(nearer, face, seen[image])
    pixel = (seen.view(-1) >= 0).nonzero().squeeze(1)
    return Visible(pixel, seen.view(-1)[pixel], size)


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


def sample_texture(
    textures: Pyramid, texture: torch.Tensor, uv: torch.Tensor, footprint: torch.Tensor
) -> torch.Tensor:
    """One point after the other."""
    rows = []
    for which, place, change in zip(texture.tolist(), uv, footprint.reshape(-1, 2, 2), strict=True):
        if which < 0:
            rows.append(textures.texels.new_ones(textures.texels.shape[1]))
            continue
        first, end = textures.first[which : which + 2].tolist()
        height, width = textures.levels[first, 1:].tolist()
        texels = change * change.new_tensor([width, height])
        mean_square = texels.square().sum() / 2
        level = (0.5 * torch.log2(mean_square.clamp_min(1e-12))).clamp(0, end - first - 1)
        fine = int(level)
        coarse = min(fine + 1, end - first - 1)
        share = level - fine
        rows.append(
            (1 - share) * _bilinear(textures, first + fine, place)
            + share * _bilinear(textures, first + coarse, place)
        )
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


def visible_crossings(
    points: torch.Tensor,
    faces: torch.Tensor,
    edges: torch.Tensor,
    layer: torch.Tensor,
    size: tuple[int, int, int],
) -> set[tuple[int, int, int, int, int]]:
    """What `find_crossings` finds, as a set: vertex a, vertex b, axis, first pixel, second pixel."""
    _, height, width = size
    faces, found = faces.long(), set()
    for a, b, apex, beyond, face, other in edges.tolist():
        if min(points[a, 2], points[b, 2]) < NEAR:
            continue
        pixel_a, pixel_b = points[a, :2] / points[a, 2], points[b, :2] / points[b, 2]
        if beyond >= 0:
            # On which side of the line a to b a face lies: the sign of a determinant of homogeneous points.
            sides = [torch.linalg.det(torch.stack([points[a], points[b], points[c]])) for c in (apex, beyond)]
            if sides[0] * sides[1] <= 0:
                continue
        image = int(layer[face])
        others = (layer == image).nonzero().squeeze(1)
        others = others[(others != face) & (others != other)]
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
                if (before < depth * (1 - 1e-7)).any():
                    continue
                here = (
                    (image * height + line) * width + low
                    if axis == 0
                    else (image * height + low) * width + line
                )
                found.add((a, b, axis, here, here + (1 if axis == 0 else width)))
    return found
