"""Self-shadow and bounce light of a class: a transfer vector per vertex, linear in the shape coefficients.

At a vertex x with unit normal n a surface of albedo a reflects a * T(x) . L of distant light L, with

    T(x) = mean over w of [ Y(w) where w meets nothing of the object, else a T(y), y being the place met ]

over directions w that are distributed as the clamped cosine over pi (Sloan, Kautz and Snyder, 2002). Where
nothing is occluded T_lm = A_l Y_lm(n), which is `vig.scene.irradiance`; the table holds the change from
that. The ground is not in T: L is the light that arrives at the object's place, the ground's included.

`python -m tools.classes.transfer FOLDER` computes and writes a class pack's.
"""

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse

from vig.io.files import write_arrays, write_json
from vig.io.progress import Meter
from vig.parallel import map_on_threads
from vig.scene import SHAPE_LIMIT, ObjectClass, ShapeModel
from vig.scene.light import COSINE_LOBE, sh_basis
from vig.scene.object_class import TRANSFER_FILE
from vig_native import engine
from vig_world.mesh import face_edges, vertex_normals

ALBEDO = 0.5  # albedo of the object for its interreflections: the middle of the sampled range

BOUNCES = 4  # interreflections that are added up
SHAPE_SAMPLES = 160  # shapes drawn for the regression
RAY_GRID = 16  # each vertex casts RAY_GRID squared rays, stratified


KEPT_SHAPES = 4  # shapes that are kept together: a second or two of a core

_CHUNK = 1024

Compute = Callable[[], Mapping[str, np.ndarray]]
Keep = Callable[[str, list[str], Compute], Mapping[str, np.ndarray]]
"""Returns the result of a stage for its inputs, computed if not kept, as `BuildRun.result` does."""


def compute_stage(stage: str, inputs: list[str], compute: Compute) -> Mapping[str, np.ndarray]:
    """Keep nothing."""
    return compute()


@dataclass(frozen=True)
class Rays:
    """Directions of cosine-weighted rays: chunks of points share a stratified pattern, each point turns it.

    The direction of ray r from a point of chunk c, whose normal is the third axis of its frame, is
    sqrt(u) cos(a), sqrt(u) sin(a), sqrt(1 - u) in that frame, u = patterns[c, r, 0], a = 2 pi (patterns[c,
    r, 1] + turns): density cosine / pi.

    Attributes:
        patterns: (C, R, 2) within [0, 1].
        turns: (V,) shares of a whole turn.
    """

    patterns: np.ndarray
    turns: np.ndarray

    @staticmethod
    def draw(points: int, side: int, rng: np.random.Generator) -> "Rays":
        """Draw side^2 rays of each of so many points."""
        cells = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
        patterns, turns = [], []
        for start in range(0, points, _CHUNK):
            patterns.append((cells + rng.uniform(size=cells.shape)) / side)
            turns.append(rng.uniform(size=min(_CHUNK, points - start)))
        return Rays(np.stack(patterns), np.concatenate(turns))

    @staticmethod
    def numbers(points: int, side: int) -> int:
        """Return how many random numbers `draw` takes."""
        return points + 2 * side**2 * math.ceil(points / _CHUNK)


def frames_of(normals: np.ndarray) -> np.ndarray:
    """Return frames (N, 3, 3) of unit normals (N, 3): rows are a tangent, the bitangent and the normal."""
    tangent = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return np.stack([tangent, np.cross(normals, tangent), normals], axis=1)


def unoccluded_transfer(normals: np.ndarray) -> np.ndarray:
    """Return the transfer where nothing is occluded, A_l Y_lm(n): (..., 3) to (..., 9)."""
    return sh_basis(np.asarray(normals, np.float64)) * COSINE_LOBE


@dataclass(frozen=True)
class Occlusion:
    """Self-occlusion of a shape at its vertices.

    Attributes:
        normals: (V, 3).
        blocked: (V, 9) mean over directions of Y where something is met.
        seen: (V, V) sparse; times a vertex attribute it is the mean over directions of the attribute of the
            visible surface.
        inside: (V,) bool, whether the vertex lies within another part.
    """

    normals: np.ndarray
    blocked: np.ndarray
    seen: scipy.sparse.csr_matrix
    inside: np.ndarray

    @staticmethod
    def of(vertices: np.ndarray, faces: np.ndarray, side: int, rng: np.random.Generator) -> "Occlusion":
        """Cast side^2 rays from each vertex (V, 3), metres, of a closed mesh."""
        normals = vertex_normals(vertices, faces).astype(np.float64)
        total, count = len(vertices), side**2
        rays, frames = Rays.draw(total, side, rng), frames_of(normals)
        given = (vertices.astype(np.float64), frames, rays.patterns, rays.turns)
        # Rays start 2e-4 m along the normal, at unit scale, so that no facet hides its own corners.
        blocked, face, weights = engine.cast_hemisphere_rays(
            vertices.astype(np.float32), faces.astype(np.int32), *given, 2e-4, _CHUNK
        )
        front = face >= 0
        starts = np.concatenate([[0], np.cumsum(3 * front.sum(1))])
        entries = weights[front].ravel().astype(np.float64) / count, faces[face[front]].ravel()
        seen = scipy.sparse.csr_matrix((*entries, starts), shape=(total, total))
        # A vertex that sees more than .3 of the faces from behind lies within another part.
        return Occlusion(normals, blocked / count, seen, (face == -2).mean(axis=1) > 0.3)

    def change(self, albedo: float, bounces: int, neighbours: scipy.sparse.csr_matrix) -> np.ndarray:
        """Return T minus `unoccluded` (V, 9) for an object of this albedo in its own light.

        Vertices inside another part take the change from their neighbours (V, V) outside, as the triangles
        that reach in to them are seen in part.
        """
        free = unoccluded_transfer(self.normals)
        change = fill_from_neighbours(-self.blocked, self.inside, neighbours)
        for _ in range(bounces):
            change = fill_from_neighbours(
                albedo * (self.seen @ (free + change)) - self.blocked, self.inside, neighbours
            )
        return change


def fill_from_neighbours(
    values: np.ndarray, missing: np.ndarray, neighbours: scipy.sparse.csr_matrix
) -> np.ndarray:
    """Return values (V, C), the missing (V,) taken from neighbours ring by ring; 0 where none is in reach."""
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
    """Return which vertices share an edge: (V, V) of ones and zeros."""
    pairs = face_edges(faces)
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    table = scipy.sparse.csr_matrix((np.ones(len(pairs)), pairs.T), shape=(total, total))
    table.data[:] = 1.0
    return table


def transfer_model(
    model: ShapeModel,
    shapes: int = SHAPE_SAMPLES,
    side: int = RAY_GRID,
    seed: int = 0,
    progress: bool = False,
    keep: Keep = compute_stage,
) -> np.ndarray:
    """Return change of transfer by self-shadow and bounces, (K + 1, V, 9) float32: mean, then by coefficient.

    At coefficients c it is table[0] + sum_k c_k table[k + 1], by least squares over shapes drawn N(0, 1)
    within their limits. Add it to A_l Y_lm(n) of the shape's own normals.

    keep: Keeps finished shapes, so that an interrupted run resumes.
    """
    # The one shape of a rigid class is computed four times: rays are drawn at random.
    shapes = min(shapes, 4) if model.rigid else shapes
    with Meter(shapes, 0, progress, "shapes") as meter:
        samples = SampledChanges.draw(model, shapes, side, seed, meter.advance, keep)
    if model.rigid:
        return np.stack([samples.changes.mean(0), np.zeros_like(samples.changes[0])])
    with_one = np.column_stack([np.ones(shapes), samples.coefficients])
    table = np.linalg.lstsq(with_one, samples.changes.reshape(shapes, -1), rcond=None)[0]
    return table.reshape(model.modes + 1, -1, 9).astype(np.float32)


@dataclass(frozen=True)
class SampledChanges:
    """Random shapes of a model, and how self-shadow and bounces change the transfer on each.

    Attributes:
        coefficients: (N, K).
        changes: (N, V, 9) float32.
        inside: (N, V) bool, see `Occlusion.inside`.
    """

    coefficients: np.ndarray
    changes: np.ndarray
    inside: np.ndarray

    @staticmethod
    def draw(
        model: ShapeModel,
        shapes: int,
        side: int,
        seed: int,
        advance: Callable[[int], None] = lambda count: None,
        keep: Keep = compute_stage,
    ) -> "SampledChanges":
        """Draw so many shapes; the same for any content of `keep` and any number of threads."""
        drawn = np.random.PCG64(np.random.SeedSequence([seed, shapes]))
        rng = np.random.Generator(drawn)
        coefficients = np.clip(rng.standard_normal((shapes, model.modes)), -SHAPE_LIMIT, SHAPE_LIMIT)
        vertices = model.vertices(coefficients)
        total, begun = len(model.mean), drawn.state
        neighbours, numbers = neighbours_of(model.faces, total), Rays.numbers(total, side)

        def compute(chosen: range) -> dict[str, np.ndarray]:
            bits = np.random.PCG64()
            bits.state = begun
            rng = np.random.Generator(bits.advance(chosen.start * numbers))
            met = [Occlusion.of(vertices[number], model.faces, side, rng) for number in chosen]
            changes = [each.change(ALBEDO, BOUNCES, neighbours).astype(np.float32) for each in met]
            return {"changes": np.stack(changes), "inside": np.stack([each.inside for each in met])}

        content = b"".join(array.tobytes() for array in (model.mean, model.basis, model.faces))
        key = [hashlib.sha256(content).hexdigest(), f"{shapes} {side} {seed} {ALBEDO} {BOUNCES}"]
        parts = []
        for part in map_on_threads(
            lambda chosen: keep("transfer", [*key, str(chosen)], lambda: compute(chosen)),
            [range(start, min(start + KEPT_SHAPES, shapes)) for start in range(0, shapes, KEPT_SHAPES)],
        ):
            parts.append(part)
            advance(len(part["inside"]))
        changes, inside = (np.concatenate([part[name] for part in parts]) for name in ("changes", "inside"))
        return SampledChanges(coefficients, changes, inside)


def write_transfer(
    object_class: ObjectClass, folder: Path, progress: bool = False, keep: Keep = compute_stage
) -> np.ndarray:
    """Compute a class's table and write it, in half precision, into a class pack's folder; returns it.

    class.json then records it, so that its absence is noticed. progress: whether to report
    progress on standard error. keep: see `transfer_model`.
    """
    table = transfer_model(object_class.at_unit_scale.shape_model, progress=progress, keep=keep)
    write_arrays(folder / TRANSFER_FILE, {"transfer": table.astype(np.float16)})
    if (folder / "class.json").is_file():
        described = json.loads((folder / "class.json").read_text()) | {"self_shadow": True}
        write_json(folder / "class.json", described, 1)
    return table
