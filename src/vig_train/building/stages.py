"""The stages from meshes to shapes in correspondence; each keeps its result under all that it depends on."""

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from vig.io.progress import Meter
from vig_train.building.acceptance import Quality, judge_meshes, quality_of
from vig_train.building.pose import PointCloud
from vig_train.building.reading import Scan
from vig_train.building.registration import Registration
from vig_train.building.surface import SurfaceSample, visible_surface
from vig_train.building.template import closed_template, genus
from vig_world.asset_cache import AssetCache


class BuildRun(AssetCache):
    """Cache of the stages of a class's build, and its progress output.

    Args:
        folder: Folder of the arrays.
        say: Called with a line for each step.
        progress: Whether to report progress on standard error.
    """

    def __init__(self, folder: Path, say: Callable[[str], None], progress: bool) -> None:
        super().__init__(folder, required=True)
        self.say, self.progress = say, progress

    def result(
        self, stage: str, inputs: list[str], compute: Callable[[], Mapping[str, np.ndarray]]
    ) -> dict[str, np.ndarray]:
        """Return a stage's result for these inputs, from the cache where an earlier run left it there."""
        # 1 is the version of the results; those of another are computed again.
        key = hashlib.sha256(json.dumps([1, stage, inputs]).encode()).hexdigest()[:24]
        return self.arrays(
            f"{stage}-{key}", lambda: {name: np.ascontiguousarray(value) for name, value in compute().items()}
        )


def surface_of(scan: Scan, run: BuildRun) -> SurfaceSample:
    """Return the visible surface of a mesh, in its file's axes."""
    arrays = run.result(
        "surface", [scan.content_hash], lambda: vars(visible_surface(scan.vertices, scan.faces))
    )
    return SurfaceSample(arrays["points"], arrays["normals"])


@dataclass(frozen=True, eq=False)
class StandingMesh:
    """A mesh in the class's frame: +X the front, the foot's middle at the origin, of unit size.

    Attributes:
        scan: The mesh as in its file.
        rotation: (3, 3) from the file's axes.
        linear: (3, 3), the rotation times the scale.
        offset: (3,), added after the linear map.
        surface: Its visible surface, in the class's frame.
    """

    scan: Scan
    rotation: np.ndarray
    linear: np.ndarray
    offset: np.ndarray
    surface: SurfaceSample

    @staticmethod
    def of(scan: Scan, surface: SurfaceSample, rotation: np.ndarray) -> "StandingMesh":
        """Make one of a mesh, its surface in the file's axes, and the rotation (3, 3) that puts it upright.

        The size is the root mean square distance of the surface from its middle.
        """
        points = surface.points @ rotation.T
        scale = 1 / math.sqrt(((points - points.mean(0)) ** 2).sum(1).mean())
        height = points[:, 2] - points[:, 2].min()
        foot = points[height <= 0.02 * height.max()]
        middle = np.append((foot[:, :2].min(0) + foot[:, :2].max(0)) / 2, points[:, 2].min())
        linear, offset = scale * rotation, -scale * middle
        return StandingMesh(scan, rotation, linear, offset, surface.transform(linear, offset))

    @property
    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices (V, 3) in the class's frame and faces (F, 3)."""
        return self.scan.vertices @ self.linear.T + self.offset, self.scan.faces

    def hole_count(self, run: BuildRun) -> int:
        """Return the number of holes through it."""
        arrays = run.result(
            "holes", [self.scan.content_hash], lambda: {"holes": np.array([genus(*self.triangles)])}
        )
        return int(arrays["holes"][0])


@dataclass(frozen=True, eq=False)
class Template:
    """The mesh that is carried onto all others.

    Attributes:
        medoid: Index of the mesh that it was made from, the one most like the others.
        vertices: (V, 3) in the class's frame.
        faces: (F, 3).
        about: The number of vertices that was asked for.
    """

    medoid: int
    vertices: np.ndarray
    faces: np.ndarray
    about: int

    @cached_property
    def registration(self) -> Registration:
        """Return the template as registration needs it."""
        return Registration(self.vertices, self.faces)


def template_of(
    meshes: Sequence[StandingMesh], used: list[int], about: int, run: BuildRun
) -> Template | None:
    """Return the template from the first of used meshes that can be closed, those most like the others first.

    about: The number of its vertices. None where no mesh can be closed.
    """
    clouds = [PointCloud.from_surface(meshes[n].surface) for n in used]
    identity = np.eye(3)
    costs = np.array([[a.distance(b, identity) for b in clouds] for a in clouds])
    for index in np.argsort(np.median(costs, axis=1), kind="stable"):
        arrays = _close_mesh(meshes[used[index]], about, run)
        if len(arrays["vertices"]):
            return Template(used[index], arrays["vertices"], arrays["faces"], about)
    return None


def _close_mesh(mesh: StandingMesh, about: int, run: BuildRun) -> dict[str, np.ndarray]:
    """Return a closed mesh of about so many vertices; no vertices where it cannot be closed."""

    def compute() -> dict[str, np.ndarray]:
        try:
            vertices, faces = closed_template(*mesh.triangles, mesh.surface, about)
        except ValueError:
            return {"vertices": np.zeros((0, 3)), "faces": np.zeros((0, 3), np.int64)}
        return {"vertices": vertices, "faces": faces}

    return run.result("template", [mesh.scan.content_hash, repr(mesh.rotation), str(about)], compute)


@dataclass(frozen=True, eq=False)
class RegisteredMeshes:
    """Meshes in correspondence: the template as it lies on each.

    Attributes:
        meshes: (N,) all of them.
        template: Template of the class.
        vertices: (N, V, 3) in the class's frame; zeros for dropped meshes.
        qualities: Fit of the template to each mesh that was not dropped, by the mesh's index.
    """

    meshes: list[StandingMesh]
    template: Template
    vertices: np.ndarray
    qualities: dict[int, Quality]

    @property
    def accepted(self) -> list[int]:
        """Return indices of the meshes that belong to the class."""
        return [index for index, quality in self.qualities.items() if not quality.reason]


def register(
    meshes: list[StandingMesh], used: list[int], template: Template, symmetry: str, run: BuildRun
) -> RegisteredMeshes:
    """Carry the template onto each used mesh, and judge which meshes belong to a class of this symmetry."""
    vertices = np.zeros((len(meshes), *template.vertices.shape))
    qualities: dict[int, Quality] = {}
    with Meter(len(used), 0, run.progress, "meshes") as meter:
        for number in used:
            mesh = meshes[number]
            vertices[number] = _register(mesh, meshes[template.medoid], template, run)
            quality = quality_of(template.vertices, vertices[number], template.faces, mesh.surface)
            qualities[number] = quality
            run.say(f"{number + 1:3d} {mesh.scan.name}: off by {quality.mean:.2%} of its size")
            meter.advance(1)
    qualities = judge_meshes(qualities, vertices, template.medoid, symmetry)
    for number, quality in qualities.items():
        if quality.reason:
            run.say(f"refused {number + 1} {meshes[number].scan.name}: {quality.reason}")
    return RegisteredMeshes(meshes, template, vertices, qualities)


def _register(mesh: StandingMesh, medoid: StandingMesh, template: Template, run: BuildRun) -> np.ndarray:
    """Return vertices (V, 3) of the template, which is the medoid's, as they lie on a mesh."""
    poses = repr(np.stack([mesh.rotation, medoid.rotation]))
    inputs = [mesh.scan.content_hash, medoid.scan.content_hash, poses, str(template.about)]
    arrays = run.result("registered", inputs, lambda: {"vertices": template.registration.onto(mesh.surface)})
    return arrays["vertices"]
