"""Self-shadow and bounce light of a class: a transfer vector per vertex, linear in the shape coefficients.

At a vertex x with unit normal n a surface of albedo a reflects a * T(x) . L of distant light L, with

    T(x) = mean over w of [ Y(w) where w meets nothing of the object, else a T(y), y being what it meets ]

over directions w that are distributed as the clamped cosine over pi (Sloan, Kautz and Snyder, 2002). Where
nothing is occluded T_lm = A_l Y_lm(n), which is `vig.scene.irradiance`; the table holds the change from
that. The ground is not in T: L is the light that arrives at the object's place, light reflected by the ground
included.

`python -m vig_train.packs.transfer FOLDER` computes and writes a class pack's.
"""

import argparse
import functools
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import scipy.sparse
import torch
import warp as wp

from vig.io.files import atomic_write, write_arrays
from vig.io.progress import Meter
from vig.renderer.device import initialise
from vig.scene import SHAPE_LIMIT, ObjectClass, ShapeModel
from vig.scene.light import COSINE_LOBE, sh_basis
from vig.scene.object_class import TRANSFER_FILE
from vig_world.mesh import vertex_normals

ALBEDO = 0.5
"""Albedo of the object for its interreflections: the middle of the sampled range."""

BOUNCES = 4
"""Interreflections that are added up."""
SHAPE_SAMPLES = 160
"""Shapes drawn for the regression."""
RIGID_SAMPLES = 4
"""So often is the one shape of a rigid class computed: rays are drawn at random."""
RAY_GRID = 16
"""Each vertex casts RAY_GRID squared rays, stratified."""

RAY_OFFSET = 2e-4
"""Distance along the normal at which rays start, metres at unit scale, lest a facet hides its own corners."""

INSIDE_SHARE = 0.3
"""A vertex that sees more than this share of faces from behind lies within another part."""

_BEHIND = -2
_CHUNK = 1024


@functools.cache
def ray_kernels() -> SimpleNamespace:
    """The kernel that casts rays against a mesh, compiled at first use."""
    initialise()

    @wp.kernel(module="vig_transfer")
    def cast(
        mesh: wp.uint64,
        origins: wp.array(dtype=wp.vec3),
        directions: wp.array2d(dtype=wp.vec3),
        faces: wp.array2d(dtype=wp.int32),
        weights: wp.array2d(dtype=wp.vec3),
    ):
        point, ray = wp.tid()
        hit = wp.mesh_query_ray(mesh, origins[point], directions[point, ray], 1.0e3)
        face = wp.int32(-1)
        if hit.result:
            face = hit.face
            if hit.sign < 0.0:
                face = wp.int32(-2)
            weights[point, ray] = wp.vec3(hit.u, hit.v, 1.0 - hit.u - hit.v)
        faces[point, ray] = face

    return SimpleNamespace(cast=cast)


@dataclass(frozen=True)
class Rays:
    """What N points meet in R directions each, cosine-weighted about their normals.

    Attributes:
        origins: (N, 3).
        directions: (N, R, 3).
        face: (N, R) index of the face met, -1 nothing, -2 a face seen from behind.
        weights: (N, R, 3) barycentric, of the face's corners.
    """

    origins: np.ndarray
    directions: np.ndarray
    face: np.ndarray
    weights: np.ndarray


def cast(
    vertices: np.ndarray,
    faces: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    side: int,
    rng: np.random.Generator,
    device: str = "cpu",
) -> Rays:
    """Cast side^2 rays from points (N, 3), metres, with unit normals (N, 3) against a mesh."""
    kernel = ray_kernels().cast

    def on_device(array: np.ndarray, kind: type) -> wp.array:
        return wp.from_numpy(np.ascontiguousarray(array), dtype=kind, device=device)

    mesh = wp.Mesh(
        on_device(vertices.astype(np.float32), wp.vec3), on_device(faces.astype(np.int32).ravel(), wp.int32)
    )
    directions = cosine_directions(normals, side, rng)
    origins = points + RAY_OFFSET * normals
    face = wp.zeros(directions.shape[:2], dtype=wp.int32, device=device)
    weights = wp.zeros(directions.shape[:2], dtype=wp.vec3, device=device)
    wp.launch(
        kernel,
        dim=directions.shape[:2],
        inputs=[
            mesh.id,
            on_device(origins.astype(np.float32), wp.vec3),
            on_device(directions.astype(np.float32), wp.vec3),
        ],
        outputs=[face, weights],
        device=device,
    )
    return Rays(origins, directions, face.numpy(), weights.numpy())


def cosine_directions(normals: np.ndarray, side: int, rng: np.random.Generator) -> np.ndarray:
    """Unit directions (N, side^2, 3) about unit normals (N, 3): density cosine / pi, stratified.

    All points share one pattern, each turned by an angle of its own.
    """
    cells = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
    radius, turn = ((cells + rng.uniform(size=cells.shape)) / side).T
    angle = 2 * np.pi * (turn + rng.uniform(size=(len(normals), 1)))
    least = np.abs(normals).argmin(axis=1)
    tangent = np.cross(normals, np.eye(3)[least])
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    bitangent = np.cross(normals, tangent)
    across, along = np.sqrt(radius) * np.cos(angle), np.sqrt(radius) * np.sin(angle)
    return (
        across[..., None] * tangent[:, None]
        + along[..., None] * bitangent[:, None]
        + np.sqrt(1 - radius)[:, None] * normals[:, None]
    )


def unoccluded(normals: np.ndarray) -> np.ndarray:
    """The transfer where nothing is occluded, A_l Y_lm(n): (..., 3) to (..., 9)."""
    return sh_basis(torch.from_numpy(np.ascontiguousarray(normals, np.float64))).numpy() * COSINE_LOBE


@dataclass(frozen=True)
class Occlusion:
    """What a shape's vertices see of the shape itself.

    Attributes:
        normals: (V, 3).
        blocked: (V, 9) mean over directions of Y where something is met.
        seen: (V, V) sparse; times a vertex attribute it is the mean over directions of the attribute of what
            is met.
        inside: (V,) bool, whether the vertex lies within another part.
    """

    normals: np.ndarray
    blocked: np.ndarray
    seen: scipy.sparse.csr_matrix
    inside: np.ndarray

    @staticmethod
    def of(
        vertices: np.ndarray, faces: np.ndarray, side: int, rng: np.random.Generator, device: str = "cpu"
    ) -> "Occlusion":
        """Cast side^2 rays from each vertex (V, 3), metres, of a closed mesh."""
        normals = vertex_normals(vertices, faces).astype(np.float64)
        total, share = len(vertices), 1.0 / side**2
        blocked, inside, met = np.empty((total, 9)), np.empty(total, bool), []
        for start in range(0, total, _CHUNK):
            chunk = slice(start, start + _CHUNK)
            rays = cast(vertices, faces, vertices[chunk], normals[chunk], side, rng, device)
            values = sh_basis(torch.from_numpy(rays.directions)).numpy()
            blocked[chunk] = np.einsum("nr,nrl->nl", (rays.face != -1).astype(float), values) * share
            inside[chunk] = (rays.face == _BEHIND).mean(axis=1) > INSIDE_SHARE
            row, ray = np.nonzero(rays.face >= 0)
            corners = faces[rays.face[row, ray]].ravel()
            entries = (np.repeat(row, 3), corners)
            shape = (len(rays.face), total)
            met.append(
                scipy.sparse.csr_matrix((share * rays.weights[row, ray].ravel(), entries), shape=shape)
            )
        return Occlusion(normals, blocked, scipy.sparse.vstack(met).tocsr(), inside)

    def change(self, albedo: float, bounces: int, neighbours: scipy.sparse.csr_matrix) -> np.ndarray:
        """T minus `unoccluded` (V, 9) for an object of this albedo in its own light.

        Vertices inside another part take the change from their neighbours (V, V) outside, as the triangles
        that reach in to them are seen in part.
        """
        free = unoccluded(self.normals)
        change = fill_from_neighbours(-self.blocked, self.inside, neighbours)
        for _ in range(bounces):
            change = fill_from_neighbours(
                albedo * (self.seen @ (free + change)) - self.blocked, self.inside, neighbours
            )
        return change


def fill_from_neighbours(
    values: np.ndarray, missing: np.ndarray, neighbours: scipy.sparse.csr_matrix
) -> np.ndarray:
    """Values (V, C), the missing (V,) taken over from neighbours ring by ring; 0 where none are in reach."""
    filled = ~missing
    values = np.where(filled[:, None], values, 0.0)
    while not filled.all():
        count = neighbours @ filled.astype(float)
        reached = ~filled & (count > 0)
        if not reached.any():
            break
        values[reached] = (neighbours @ values)[reached] / count[reached, None]
        filled = filled | reached
    return values


def neighbours_of(faces: np.ndarray, total: int) -> scipy.sparse.csr_matrix:
    """Which vertices share an edge: (V, V) of ones and zeros."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    table = scipy.sparse.csr_matrix((np.ones(len(pairs)), pairs.T), shape=(total, total))
    table.data[:] = 1.0
    return table


def transfer_model(
    model: ShapeModel,
    shapes: int = SHAPE_SAMPLES,
    side: int = RAY_GRID,
    seed: int = 0,
    albedo: float = ALBEDO,
    device: str = "cpu",
    progress: bool = False,
) -> np.ndarray:
    """The change of transfer by self-shadow and bounces, (K + 1, V, 9) float32: mean, then per coefficient.

    At coefficients c it is table[0] + sum_k c_k table[k + 1], by least squares over shapes drawn N(0, 1)
    within their limits. Add it to A_l Y_lm(n) of the shape's own normals.
    """
    shapes = min(shapes, RIGID_SAMPLES) if model.rigid else shapes
    with Meter(shapes, 0, progress, "shapes") as meter:
        coefficients, changes, _ = sample_changes(model, shapes, side, seed, albedo, device, meter.advance)
    if model.rigid:
        return np.stack([changes.mean(0), np.zeros_like(changes[0])])
    with_one = np.column_stack([np.ones(shapes), coefficients])
    table = np.linalg.lstsq(with_one, changes.reshape(shapes, -1), rcond=None)[0]
    return table.reshape(model.modes + 1, -1, 9).astype(np.float32)


def sample_changes(
    model: ShapeModel,
    shapes: int,
    side: int,
    seed: int,
    albedo: float = ALBEDO,
    device: str = "cpu",
    advance: Callable[[int], None] = lambda count: None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random shapes' coefficients (N, K), changes (N, V, 9) float32, and `Occlusion.inside` (N, V)."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, shapes]))
    coefficients = np.clip(rng.standard_normal((shapes, model.modes)), -SHAPE_LIMIT, SHAPE_LIMIT)
    neighbours = neighbours_of(model.faces, len(model.mean))
    shapes_vertices = model.vertices(torch.from_numpy(coefficients)).numpy()
    changes = np.empty((*shapes_vertices.shape[:2], 9), np.float32)
    inside = np.empty(shapes_vertices.shape[:2], bool)
    for index, vertices in enumerate(shapes_vertices):
        occlusion = Occlusion.of(vertices, model.faces, side, rng, device)
        changes[index] = occlusion.change(albedo, BOUNCES, neighbours)
        inside[index] = occlusion.inside
        advance(1)
    return coefficients, changes, inside


def relative_error(table: np.ndarray, model: ShapeModel, shapes: int = 12, seed: int = 1) -> float:
    """Root mean square error of the table's changes over that of the changes, on shapes of its own.

    Of vertices that lie outside other parts.
    """
    coefficients, exact, inside = sample_changes(model, shapes, RAY_GRID, seed)
    residual = np.tensordot(np.column_stack([np.ones(shapes), coefficients]), table, axes=1) - exact
    return float(np.sqrt((residual[~inside] ** 2).sum() / (exact[~inside] ** 2).sum()))


def write_transfer(object_class: ObjectClass, folder: Path, progress: bool = False) -> np.ndarray:
    """Compute a class's table and write it, in half precision, into a class pack's folder; returns it.

    class.json then tells of it, so that it cannot go missing unnoticed. progress: whether standard error
    shows how far it is.
    """
    table = transfer_model(object_class.at_unit_scale.shape_model, progress=progress)
    write_arrays(folder / TRANSFER_FILE, {"transfer": table.astype(np.float16)})
    if (folder / "class.json").is_file():
        described = json.loads((folder / "class.json").read_text()) | {"self_shadow": True}
        with atomic_write(folder / "class.json") as temporary:
            temporary.write_text(json.dumps(described, indent=1) + "\n")
    return table


def main() -> None:
    """Compute and save a class pack's table; print how well it predicts."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("folder", type=Path, help="of the class pack, whose table is replaced")
    folder = parser.parse_args().folder
    object_class = ObjectClass.load(folder)
    table = write_transfer(object_class, folder)
    mean_only = np.concatenate([table[:1], np.zeros_like(table[1:])])
    errors = [relative_error(candidate, object_class.shape_model) for candidate in (table, mean_only)]
    print(f"relative error on other shapes: {errors[0]:.3f}; of the mean alone: {errors[1]:.3f}")
    print(f"{table.shape}, {(folder / TRANSFER_FILE).stat().st_size} bytes: {folder / TRANSFER_FILE}")


if __name__ == "__main__":
    main()
