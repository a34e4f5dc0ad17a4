"""From latents to shaded vertices in the camera frame, with exact Jacobians."""

import functools
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import torch
import warp as wp

from vig.render.device import warp_array
from vig.render.scratch import Scratch, ScratchPool
from vig.render.surface import RowLayout, surface_functions
from vig.scene import Camera, Latents, ShapeModel, camera_rotation


@functools.cache
def vertex_kernels(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """The kernel that shades vertices, compiled at first use."""
    f = surface_functions(dtype, modes)
    real, vec3, mat33, row_type, normal_jacobian = f.real, f.vec3, f.mat33, f.row_type, f.normal_jacobian
    shade = f.shade
    modes_, irradiance_at = modes, f.layout.irradiance

    @wp.kernel(module=module_name("vertices", dtype, modes))
    def shade_vertices(
        world: wp.array2d(dtype=vec3),
        normal_rates: wp.array3d(dtype=normal_jacobian),
        coefficients: wp.array2d(dtype=real),
        light: wp.array2d(dtype=real),
        rotation: wp.array(dtype=mat33),
        target: vec3,
        distance: real,
        points: wp.array2d(dtype=vec3),
        normals: wp.array2d(dtype=vec3),
        inverse_lengths: wp.array2d(dtype=real),
        attributes: wp.array2d(dtype=row_type),
        irradiances: wp.array2d(dtype=real),
    ):
        image, vertex = wp.tid()
        point = rotation[image] * (world[image, vertex] - target)
        points[image, vertex] = vec3(point[0], point[1], point[2] + distance)
        dn_x = normal_rates[image, vertex, 0]
        dn_y = normal_rates[image, vertex, 1]
        dn_z = normal_rates[image, vertex, 2]
        # The unscaled normal is a quadratic form in (1, coefficients), the rates half its derivative.
        normal = vec3(dn_x[0], dn_y[0], dn_z[0])
        for mode in range(modes_):
            c = coefficients[image, mode]
            normal = normal + vec3(dn_x[mode + 1], dn_y[mode + 1], dn_z[mode + 1]) * c
        length = wp.length(normal)
        inverse = real(0.0)
        if length > real(0.0):
            inverse = real(1.0) / length
        normal = normal * inverse
        inverse = inverse * real(2.0)
        normals[image, vertex] = normal
        inverse_lengths[image, vertex] = inverse
        attribute = shade(normal, inverse, light, image, dn_x, dn_y, dn_z)
        attributes[image, vertex] = attribute
        irradiances[image, vertex] = attribute[irradiance_at]

    return SimpleNamespace(shade_vertices=shade_vertices, **vars(f))


def module_name(room: str, dtype: torch.dtype, modes: int) -> str:
    """The name under which kernels of this scalar type and width are cached."""
    return f"vig_{room}_{str(dtype).removeprefix('torch.')}_{modes}"


class Geometry:
    """A shape model made ready for the renderer on one device: matrices, faces, edges, and scratch.

    Vertex positions are linear in the shape coefficients and area-weighted vertex normals quadratic, so
    both, and the normals' exact Jacobian, come from one matrix product each.
    """

    def __init__(self, model: ShapeModel, dtype: torch.dtype = torch.float32, device: str = "cpu"):
        self.model, self.dtype, self.device = model, dtype, device
        self.layout = RowLayout(model.modes)
        self.scratch = ScratchPool(device)
        self.faces = torch.from_numpy(np.ascontiguousarray(model.faces, np.int32)).to(device)
        self.edges = torch.from_numpy(edges_of(model.faces)).to(device)
        stack = np.concatenate([model.mean[None], model.basis]).astype(np.float64)
        self.positions = torch.from_numpy(stack.reshape(len(stack), -1)).to(device, dtype).contiguous()
        self.normal_rates = torch.from_numpy(_normal_rates(stack, model.faces)).to(device, dtype)
        padded = np.zeros((3, len(model.mean), self.layout.width))
        padded[:, :, : model.modes] = model.basis.transpose(2, 1, 0)
        self.basis = torch.from_numpy(padded).to(device, dtype)

        self.faces_wp, self.edges_wp = warp_array(self.faces, wp.int32), warp_array(self.edges, wp.int32)
        self._basis_wp: wp.array | None = None

    def basis_wp(self, row_type: type) -> wp.array:
        """Warp's view of the basis as rows."""
        if self._basis_wp is None:
            self._basis_wp = warp_array(self.basis, row_type)
        return self._basis_wp

    @property
    def vertex_count(self) -> int:
        """V."""
        return len(self.model.mean)


@dataclass(frozen=True)
class VertexState:
    """Shaded vertices of B images, as Warp arrays; what rasterisation and the likelihood read.

    points (B, V) vec3: camera frame, metres. normals (B, V) vec3: unit, world frame. inverse_lengths (B, V):
    2 / length of the unscaled normal. attributes (B, V): rows, see `surface`. irradiances (B, V): their
    column of that name. normal_rates (B, V, 3) of K + 1 numbers: half the derivative of the unscaled normal
    with respect to (1, coefficients). intrinsics (B,) vec3: focal length, cx, cy in pixels, framing applied.
    rotation (B,) mat33. They live in the scratch that was given: the next call overwrites them.
    """

    points: wp.array
    normals: wp.array
    inverse_lengths: wp.array
    attributes: wp.array
    irradiances: wp.array
    normal_rates: wp.array
    intrinsics: wp.array
    rotation: wp.array


def shade_vertices(
    geometry: Geometry, camera: Camera, latents: Latents, framing: torch.Tensor, scratch: Scratch
) -> VertexState:
    """Place and shade the vertices of B images.

    framing (B, 3): the image's horizontal and vertical shift in widths and log magnification; zero is
    the camera as it is.
    """
    kernels = vertex_kernels(geometry.dtype, geometry.layout.modes)
    dtype, count, total = geometry.dtype, len(latents), geometry.vertex_count
    width = geometry.layout.modes + 1
    with_one, _ = scratch.get("with_one", (count, width), dtype, kernels.real)
    with_one[:, 0], with_one[:, 1:] = 1.0, latents.shape
    world, world_wp = scratch.get("world", (count, total, 3), dtype, kernels.vec3)
    rates, rates_wp = scratch.get("rates", (count, total, 3, width), dtype, kernels.normal_jacobian)
    torch.mm(with_one, geometry.positions, out=world.view(count, -1))
    torch.mm(with_one, geometry.normal_rates, out=rates.view(count, -1))
    turned = camera_rotation(latents.azimuth, latents.elevation)
    intrinsics = torch.stack(
        [
            camera.focal * torch.exp(framing[:, 2]),
            camera.cx + framing[:, 0] * camera.width,
            camera.cy + framing[:, 1] * camera.width,
        ],
        dim=1,
    )
    vertices = (count, total)
    state = VertexState(
        points=scratch.get("points", (*vertices, 3), dtype, kernels.vec3)[1],
        normals=scratch.get("normals", (*vertices, 3), dtype, kernels.vec3)[1],
        inverse_lengths=scratch.get("inverse_lengths", vertices, dtype, kernels.real)[1],
        attributes=scratch.get("attributes", (*vertices, geometry.layout.width), dtype, kernels.row_type)[1],
        irradiances=scratch.get("irradiances", vertices, dtype, kernels.real)[1],
        normal_rates=rates_wp,
        intrinsics=scratch.put("intrinsics", intrinsics, dtype, kernels.vec3),
        rotation=scratch.put("rotation", turned, dtype, kernels.mat33),
    )
    wp.launch(
        kernels.shade_vertices,
        dim=vertices,
        inputs=[
            world_wp,
            rates_wp,
            scratch.put("coefficients", latents.shape, dtype, kernels.real),
            scratch.put("light", latents.light, dtype, kernels.real),
            state.rotation,
            kernels.vec3(0.0, 0.0, camera.target_height),
            camera.distance,
        ],
        outputs=[state.points, state.normals, state.inverse_lengths, state.attributes, state.irradiances],
        device=geometry.device,
    )
    return state


def edges_of(faces: np.ndarray) -> np.ndarray:
    """Edges of a triangle mesh: (E, 5) int32 of vertex a, vertex b, face, face beyond, corner beyond.

    `face` holds the edge as a to b; the face beyond holds it as b to a, `corner beyond` being that face's
    third vertex; both are -1 at a border. Edges of more than two faces are listed once per pair.
    """
    directed: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for face, corners in enumerate(faces.tolist()):
        for i in range(3):
            directed.setdefault((corners[i], corners[(i + 1) % 3]), []).append((face, corners[(i + 2) % 3]))
    rows = []
    for (a, b), here in directed.items():
        beyond = directed.get((b, a), [])
        for index, (face, _) in enumerate(here):
            if not beyond:
                rows.append((a, b, face, -1, -1))
            elif a < b:
                rows.append((a, b, face, *beyond[min(index, len(beyond) - 1)]))
    return np.array(rows, np.int32)


def _normal_rates(stack: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """T such that (1, c) @ T is half the Jacobian of area-weighted normals: (K+1, V * 3 * (K+1)).

    With positions sum_k c_k S_k the normal at a vertex is sum_kl c_k c_l M_kl, M_kl the sum over adjacent
    faces of cross(first edge of S_k, second edge of S_l); T_kl = (M_kl + M_lk) / 2.
    """
    count, total = stack.shape[:2]
    a, b, c = (stack[:, faces[:, i]] for i in range(3))
    first, second = b - a, c - a
    rates = np.empty((count, total, 3, count))
    for k in range(count):
        for m in range(k, count):
            face_part = (np.cross(first[k], second[m]) + np.cross(first[m], second[k])) / 2
            at_vertex = np.zeros((total, 3))
            for corner in range(3):
                for axis in range(3):
                    at_vertex[:, axis] += np.bincount(faces[:, corner], face_part[:, axis], minlength=total)
            rates[k, :, :, m] = at_vertex
            rates[m, :, :, k] = at_vertex
    return rates.reshape(count, -1)
