"""Eq. 4 in plain torch, slowly: what native code is compared with, and a text to learn the objective from.

`value` is the default objective of docs/objective.md without its prior p(z). Every step is differentiable.
Which face each pixel shows, and between which pixels an edge passes, are constants of a brute-force search.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch

from vig.likelihood import Geometry
from vig.scene import Camera, Latents, camera_rotation, irradiance, latent_layout, sh_basis
from vig.scene.light import COSINE_LOBE
from vig_native import engine

NO_FACE = -1
BEHIND_EDGE, BEFORE_EDGE = 0.002, 0.04
"""Metres by which a surface beyond an edge lies behind it, and its own may come forward within a pixel."""
MIN_SQUARE = 1e-12
"""Squared length in the image of an edge's normal below which its direction is lost in rounding."""


def faces_of(geometry: Geometry) -> torch.Tensor:
    """(F, 3) int64."""
    return torch.as_tensor(geometry.faces).long()


@dataclass(frozen=True)
class Shaded:
    """One point's object.

    Attributes:
        screen: (V, 3) pixel coordinates and one over the depth of each vertex.
        normals: (V, 3) unit, world frame.
        irradiances: (V,) what a white surface reflects, Eq. 1.
        albedo: (3,) linear RGB.
        rotation: (3, 3) camera_from_world.
    """

    screen: torch.Tensor
    normals: torch.Tensor
    irradiances: torch.Tensor
    albedo: torch.Tensor
    rotation: torch.Tensor


@dataclass(frozen=True)
class Target:
    """What a point is compared with: photo and log_prior (H, W, 3), noise sigma; see `Photos`."""

    photo: torch.Tensor
    log_prior: torch.Tensor
    sigma: float

    def covered(self, shaded: Shaded, x: torch.Tensor, y: torch.Tensor, lit: torch.Tensor) -> torch.Tensor:
        """Eq. 3 of pixels (N,) that show the object under irradiances lit (N,)."""
        colour = lit[:, None] * shaded.albedo
        square = ((self.photo[y, x] - colour) ** 2).sum(-1) / (2 * self.sigma**2)
        visible = self.log_prior[y, x, 0] - square - 3 * math.log(self.sigma) - engine.DENSITIES["gaussian"]
        return torch.logaddexp(visible, self.log_prior[y, x, 1])


def value(
    geometry: Geometry,
    camera: Camera,
    point: torch.Tensor,
    photo: torch.Tensor,
    log_prior: torch.Tensor,
    sigma: float,
    held: torch.Tensor | None = None,
) -> torch.Tensor:
    """Eq. 4 of one point (P',) with analytic coverage; autograd gives the exact gradient.

    Args:
        geometry: In float64, as the point, so that kernels can be compared with it to rounding.
        camera: Of the photo.
        point: Latents followed by framing, in the order of `point_layout`.
        photo, log_prior, sigma: See `Target`.
        held: (H, W) each pixel's face or -1, constant, without coverage: `silhouette="paper"`.
    """
    shaded, target = shade(geometry, camera, point), Target(photo, log_prior, sigma)
    if held is not None:
        return _interior(geometry, shaded, target, held)
    seen = faces_seen(geometry, shaded.screen.detach(), camera)
    total = _interior(geometry, shaded, target, seen)
    for axis in (0, 1):
        total = total + _crossings(geometry, shaded, target, seen, axis)
    return total


def value_and_gradient(
    geometry: Geometry,
    camera: Camera,
    point: np.ndarray,
    photo: np.ndarray,
    log_prior: np.ndarray,
    sigma: float,
    held: np.ndarray | None = None,
) -> tuple[float, np.ndarray]:
    """`value` of arrays, and its gradient (P',)."""
    at = torch.tensor(point, requires_grad=True)
    faces = None if held is None else torch.from_numpy(held)
    found = value(geometry, camera, at, torch.from_numpy(photo), torch.from_numpy(log_prior), sigma, faces)
    found.backward()
    assert at.grad is not None
    return found.item(), at.grad.numpy()


BLOCKS = ("shape", "azimuth", "elevation", "albedo", "light", "framing")
"""What the reference knows of a point: it takes further blocks for 0, and has no derivative by them."""


def shade(geometry: Geometry, camera: Camera, point: torch.Tensor) -> Shaded:
    """Vertices of a point (P',); see `BLOCKS`."""
    blocks = geometry.layout.split(point[None])
    framing = blocks.pop("framing")[0]
    own = latent_layout(geometry.layout.count("shape"))
    latents = Latents.from_vector(own.join({block.name: blocks[block.name] for block in own.blocks}))
    with_one = torch.cat([point.new_ones(1), latents.shape[0]])
    world = torch.einsum("k,kvc->vc", with_one, torch.as_tensor(geometry.positions))
    cos, sin, zero, one = framing[3].cos(), framing[3].sin(), point.new_zeros(()), point.new_ones(())
    turn = torch.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one]).view(3, 3)
    rotation = turn @ camera_rotation(latents.azimuth, latents.elevation)[0]
    seen = (world - world.new_tensor([0.0, 0.0, camera.target_height])) @ rotation.T
    seen = seen + seen.new_tensor([0.0, 0.0, camera.distance])
    focal = camera.focal * torch.exp(framing[2])
    centre = torch.stack([camera.cx + framing[0] * camera.width, camera.cy + framing[1] * camera.width])
    screen = torch.cat([seen[:, :2] / seen[:, 2:] * focal + centre, 1 / seen[:, 2:]], 1)
    a, b, c = world[faces_of(geometry)].unbind(1)
    across = torch.linalg.cross(b - a, c - a)
    normals = torch.zeros_like(world).index_add(0, faces_of(geometry).T.reshape(-1), across.repeat(3, 1))
    normals = normals / normals.norm(dim=1, keepdim=True).clamp_min(1e-30)
    if geometry.transfer is None:
        irradiances = irradiance(latents.light, normals)
    else:  # self-shadow and interreflection change the lobes of each vertex
        change = torch.einsum("k,kvl->vl", with_one, torch.as_tensor(geometry.transfer))
        lobes = torch.tensor(COSINE_LOBE, dtype=point.dtype) * sh_basis(normals)
        irradiances = ((lobes + change) @ latents.light[0]).clamp_min(0.0)
    return Shaded(
        screen, normals, irradiances * torch.as_tensor(geometry.reflectance), latents.albedo[0], rotation
    )


def surface_at(
    geometry: Geometry, shaded: Shaded, face: torch.Tensor, pixel: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Perspective-correct irradiance and one over depth, (N,) each, of faces (N,) at image points (N, 2)."""
    corners = faces_of(geometry)[face.long()]
    a, b, c = shaded.screen[corners].unbind(1)
    weights = _barycentric(a, b, c, pixel) * shaded.screen[corners][:, :, 2]
    q = weights.sum(1)
    return (weights * shaded.irradiances[corners]).sum(1) / q, q


def faces_seen(geometry: Geometry, screen: torch.Tensor, camera: Camera) -> torch.Tensor:
    """The nearest face turned to the eye at each pixel's centre, -1 for none: (H, W) int64."""
    front = _facing(geometry, screen).nonzero()[:, 0]
    corners = screen[faces_of(geometry)[front]]
    x = torch.arange(camera.width).to(screen) + 0.5
    seen = torch.full((camera.height, camera.width), NO_FACE)
    for line in range(camera.height):
        y = line + 0.5
        crossed = ((corners[:, :, 1].amin(1) <= y) & (corners[:, :, 1].amax(1) >= y)).nonzero()[:, 0]
        if len(crossed):
            a, b, c = corners[crossed, None].unbind(2)
            weights = _barycentric(a, b, c, torch.stack([x, torch.full_like(x, y)], 1))
            q = (weights * corners[crossed, None, :, 2]).sum(-1)
            nearest, which = torch.where((weights >= 0).all(-1), q, 0.0).max(0)
            seen[line] = torch.where(nearest > 0, front[crossed[which]], NO_FACE)
    return seen


def occlusion_edges(geometry: Geometry, screen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Edges between a face turned to the eye and one turned away or none: their ends (N, 2), fold (N,).

    The object lies on the same side of a line from first to second end. fold is 1 for an edge of the
    silhouette or of a nearer part, and -1 where the surface folds into itself: the face that is turned away
    lies in front. Near a silhouette such a fold lies between two edges that are both crossed; counted
    against them one crossing is left, and nothing jumps where a pair appears.
    """
    facing, edges = _facing(geometry, screen), torch.as_tensor(geometry.edges).long()
    here, beyond = edges[:, 2], edges[:, 3]
    turned = facing[here]
    edges = edges[turned != (facing[beyond] & (beyond >= 0))]
    turned = facing[edges[:, 2]]
    apex = faces_of(geometry)[edges[:, 2]].sum(1) - edges[:, 0] - edges[:, 1]
    apexes = torch.stack([apex, edges[:, 4]], 1)
    ends = torch.where(turned[:, None], edges[:, :2], edges[:, [1, 0]])
    apexes = torch.where(turned[:, None], apexes, apexes.flip(1))
    a, b, c, d = (screen[index] for index in (*ends.T, *apexes.T))
    inward = (torch.linalg.cross(b - a, c - a) * (d - a)).sum(1) < 0
    fold = torch.where(inward & (edges[:, 3] >= 0), -1.0, 1.0).to(screen)
    before_eye = (a[:, 2] > 0) & (b[:, 2] > 0)
    return ends[before_eye], fold[before_eye]


def _interior(geometry: Geometry, shaded: Shaded, target: Target, seen: torch.Tensor) -> torch.Tensor:
    """Eq. 4 with each pixel either covered, k_i = 1, or not, k_i = 0."""
    y, x = (seen != NO_FACE).nonzero().T
    lit, _ = surface_at(geometry, shaded, seen[y, x], _centre(x, y, shaded))
    background = target.log_prior[..., 2]
    return target.covered(shaded, x, y, lit).sum() + background.sum() - background[y, x].sum()


def _crossings(
    geometry: Geometry, shaded: Shaded, target: Target, seen: torch.Tensor, axis: int
) -> torch.Tensor:
    """What blending across edges adds between neighbours in a row (axis 0) or in a column (axis 1).

    An edge passes between two pixel centres at a share t of the way. The pixel nearer to it is partly the
    other surface's: by |t - 1/2|, times nx^2 or ny^2 of the edge's normal in the image.
    """
    size, count = (seen.shape[1], seen.shape[0]) if axis == 0 else seen.shape
    ends, fold = occlusion_edges(geometry, shaded.screen.detach())
    # Every line of pixels, v = line + 1/2, that an edge from a to b crosses.
    v = shaded.screen[:, 1 - axis].detach()[ends]
    centres = torch.arange(count, dtype=v.dtype) + 0.5
    edge, line = ((v.amin(1)[:, None] <= centres) & (centres < v.amax(1)[:, None])).nonzero().T
    index_a, index_b = ends[edge].T
    fold = fold[edge]
    a, b = shaded.screen[index_a], shaded.screen[index_b]
    length = b[:, 1 - axis] - a[:, 1 - axis]
    share = (centres[line] - a[:, 1 - axis]) / length
    u = a[:, axis] + share * (b[:, axis] - a[:, axis])
    low = (u.detach() - 0.5).floor().long()
    # With the inside of the object on the side of greater u, the inner pixel is the later one.
    later = (fold * length.detach() * (1 - 2 * axis)) > 0
    inner, outer = torch.where(later, low + 1, low), torch.where(later, low, low + 1)
    within = (low >= 0) & (low + 1 < size)

    def pixel(along: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        along = along.clamp(0, size - 1)
        return (along, line) if axis == 0 else (line, along)

    (inner_x, inner_y), (outer_x, outer_y) = pixel(inner), pixel(outer)
    front, behind = seen[inner_y, inner_x], seen[outer_y, outer_x]
    front_lit, front_q = surface_at(geometry, shaded, front, _centre(inner_x, inner_y, shaded))
    behind_lit, behind_q = surface_at(geometry, shaded, behind, _centre(outer_x, outer_y, shaded))
    # It is an edge only where the inner pixel shows the edge's surface, the outer one what lies behind it.
    q = (1 - share) * a[:, 2] + share * b[:, 2]
    ahead = 1 / q - 1 / front_q
    crossed = within & (front != NO_FACE) & (ahead <= BEFORE_EDGE) & (ahead >= -BEHIND_EDGE)
    crossed &= (behind == NO_FACE) | (1 / behind_q >= 1 / q + BEHIND_EDGE)
    normals = shaded.normals @ shaded.rotation.T
    normal = ((1 - share)[:, None] * normals[index_a] + share[:, None] * normals[index_b])[:, :2]
    crossed &= normal.square().sum(1) >= MIN_SQUARE
    weight = fold * normal[:, axis].square() / normal.square().sum(1)
    # Where the edge is beyond the middle as seen from inside, the surface in front reaches over the outer
    # pixel and shows its colour at the edge there; else the inner pixel gives of its own to what is behind.
    t = u - 0.5 - low
    gives = (t < 0.5) != later
    x, y = torch.where(gives, inner_x, outer_x), torch.where(gives, inner_y, outer_y)
    perspective = share * b[:, 2] / q
    lit_a, lit_b = shaded.irradiances[index_a], shaded.irradiances[index_b]
    lit = torch.where(gives, front_lit, lit_a + perspective * (lit_b - lit_a))
    hidden = target.covered(shaded, x, y, torch.where(behind == NO_FACE, 0.0, behind_lit))
    without = torch.where(behind == NO_FACE, target.log_prior[y, x, 2], hidden)
    gain = target.covered(shaded, x, y, lit) - without
    taken = torch.where(gives, -1.0, 1.0) * weight * (t - 0.5).abs()
    return (taken * gain)[crossed].sum()


def _facing(geometry: Geometry, screen: torch.Tensor) -> torch.Tensor:
    """(F,) bool: faces turned to the eye with no corner at or behind it; the screen's y points down."""
    a, b, c = screen[faces_of(geometry)].unbind(1)
    return (_cross(b - a, c - a) < 0) & (a[:, 2] > 0) & (b[:, 2] > 0) & (c[:, 2] > 0)


def _centre(x: torch.Tensor, y: torch.Tensor, shaded: Shaded) -> torch.Tensor:
    return torch.stack([x, y], 1).to(shaded.screen) + 0.5


def _cross(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _barycentric(a: torch.Tensor, b: torch.Tensor, c: torch.Tensor, pixel: torch.Tensor) -> torch.Tensor:
    """Screen-space weights (..., 3), of sum 1, of triangles' corners (..., 3) at image points (..., 2)."""
    a, b, c = a[..., :2], b[..., :2], c[..., :2]
    total = _cross(b - a, c - a)
    second, third = _cross(pixel - a, c - a) / total, _cross(b - a, pixel - a) / total
    return torch.stack([1 - second - third, second, third], -1)
