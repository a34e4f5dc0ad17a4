"""A class pack from a folder of meshes, stage by stage; each stage's result is cached for the next run."""

from __future__ import annotations

import hashlib
import json
import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file, save_file

from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig.scene import Family, ObjectClass, ShapeModel, Symmetry
from vig_train.building import pictures
from vig_train.building.acceptance import (
    MAX_ATTACHMENT_SHARE,
    MAX_UNMATCHED_SHARE,
    Quality,
    median_distance_ratios,
    quality_of,
)
from vig_train.building.card import card
from vig_train.building.families import families_of, genus
from vig_train.building.materials import dark_part
from vig_train.building.model import Components, SymmetryProjection, fit_components
from vig_train.building.pose import (
    ClassSymmetry,
    PointCloud,
    align_clouds,
    axis_of_revolution,
    class_symmetry,
    cube_turn_to_up,
    front_angle,
    levelling_rotation,
    rotation_to_vertical,
    straightening_angle,
    up_axis,
    usual_axes,
)
from vig_train.building.reading import Scan, read_scans
from vig_train.building.registration import Registration
from vig_train.building.surface import SurfaceSample, vertex_areas, visible_surface
from vig_train.building.symmetries import MIRROR_Y, mirror_map, mirror_projection, rotation_projection
from vig_train.building.template import TEMPLATE_VERTICES, closed_template
from vig_train.packs.lights import light_prior
from vig_train.packs.transfer import write_transfer
from vig_world.assets.held_out import HeldOutDesigns
from vig_world.assets.own.catalogue import Source, mesh_folder, read_sources
from vig_world.assets.own.load import load
from vig_world.assets.props.families import ZONE_NAMES
from vig_world.assets.source_meshes import FILE as SOURCE_MESHES_FILE
from vig_world.assets.source_meshes import SourceMesh
from vig_world.assets.source_meshes import save as save_source_meshes
from vig_world.dataset.spec import Split
from vig_world.rotations import about_z

CACHE_VERSION = 1
"""Version of the cached results of stages; those of another version are computed again."""
TRAINED_FILES = ("recognition.safetensors", "calibration.json", "reliability.png")
"""Files of a pack that `vig class train` writes."""
USUAL_LENGTH, LENGTHS = 0.2, (0.001, 10.0)
"""Longest side of a class's mean shape where none is told, and the bounds of one that is, metres."""
DARK_VIEW_WEIGHT = 1000.0
"""`view_weight` of fits where a class has a dark part: evidence then tells front from back by itself. On 205
photos of real cars views are as good as with 3,000, and those that are turned have a lower confidence."""
VIEWING_LENGTHS = 1.5
"""Distance of the standard camera, in longest sides of the mean shape."""
MIN_MESHES_TO_HOLD_OUT = 10
"""From so many meshes on, one in six is held out for validation and one in six for the test."""
MIN_VERTICES = 200
MAX_VERTICES = 20_000
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}


@dataclass(frozen=True)
class BuildSettings:
    """What the user states about a class.

    Attributes:
        name: The class's name.
        up: The axis that points up in most files, such as "z"; None: estimated.
        front: The axis that the front faces in most files, such as "+x"; None: estimated.
        shows: What the front shows, such as "the handle"; for texts.
        symmetry: "none", "half-turn", "any-turn"; None: estimated.
        length: Longest side of the mean shape, metres; None: `USUAL_LENGTH`, or of a single glTF file, which
            is in metres, its own.
        turns: Degrees by which meshes, by number, are turned counter-clockwise about the vertical at last.
        drops: Numbers of meshes that are left out.
        vertices: Number of vertices of the template, about.
        places: Zones of rooms where such things stand, with relative frequencies.
        materials: Whether colours and textures of the files are kept, for training.
    """

    name: str
    up: str | None = None
    front: str | None = None
    shows: str = ""
    symmetry: str | None = None
    length: float | None = None
    turns: dict[int, float] = field(default_factory=dict)
    drops: tuple[int, ...] = ()
    vertices: int = TEMPLATE_VERTICES
    places: dict[str, float] = field(default_factory=dict)
    materials: bool = True

    def check(self) -> None:
        """Raise UserError when a setting is out of its range."""
        if self.length is not None and not LENGTHS[0] <= self.length <= LENGTHS[1]:
            raise UserError(f"expected a length from 0.001 to 10 metres; got {self.length}.")
        if not MIN_VERTICES <= self.vertices <= MAX_VERTICES:
            raise UserError(
                f"expected {MIN_VERTICES} to {MAX_VERTICES} vertices; got {self.vertices}."
                f" Take about {TEMPLATE_VERTICES}."
            )
        for text in (self.name, self.shows or "-"):
            if not text or len(text) > 100 or not text.isprintable():
                raise UserError(f"expected names of 1 to 100 printable characters; got {text[:100]!r}.")
        for axis in (self.up, self.front):
            if axis is not None:
                _axis_vector(axis)
        if self.up and self.front and not np.cross(_axis_vector(self.up), _axis_vector(self.front)).any():
            raise UserError(f"expected a front that is level; got {self.front} with {self.up} up.")
        if self.symmetry is not None and self.symmetry not in set(Symmetry):
            raise UserError(f"expected a symmetry among {', '.join(Symmetry)}; got '{self.symmetry}'.")
        if unknown := sorted(set(self.places) - set(ZONE_NAMES)):
            raise UserError(f"expected places among {', '.join(ZONE_NAMES)}; got '{unknown[0]}'.")


@dataclass(frozen=True)
class UprightPoses:
    """The meshes upright in one frame: +X the front, the foot's middle at the origin, of one size.

    Attributes:
        rotations: (N, 3, 3) from each file's axes.
        symmetries: Of the class.
        report: Axes and symmetries, and whether each was estimated or given, one line each.
    """

    rotations: np.ndarray
    symmetries: ClassSymmetry
    report: tuple[str, ...]


@dataclass(frozen=True)
class BuildResult:
    """A built class, and what it was built from.

    Attributes:
        object_class: As saved.
        scans: All meshes that could be read.
        unreadable: Why other files were left out, by name.
        upright: Rotations of the meshes to the class's frame.
        medoid: Number of the mesh that the template was made from.
        qualities: Of each mesh that was not dropped, by its number.
        splits: Of each accepted mesh, by its number.
        components: The shape model.
        sources: Origins of the meshes that come from furniture catalogues.
    """

    object_class: ObjectClass
    scans: list[Scan]
    unreadable: dict[str, str]
    upright: UprightPoses
    medoid: int
    qualities: dict[int, Quality]
    splits: dict[int, Split]
    components: Components
    sources: tuple[Source, ...] = ()

    @property
    def refused(self) -> dict[str, str]:
        """Why each mesh that is not in the class was left out, by its file's name."""
        reasons = dict(self.unreadable)
        for number, scan in enumerate(self.scans):
            if number not in self.splits:
                quality = self.qualities.get(number)
                reasons[scan.name] = "dropped" if quality is None else quality.reason
        return reasons


class Builder:
    """The stages of building a class pack from a folder of meshes or from furniture catalogues.

    Args:
        meshes: A folder of them; what `mesh_folder` takes, such as `catalogue.sh3f:car`; or a single file,
            whose shape is exact.
        out: The pack's folder, made where it is missing.
        settings: What the user states.
        say: Called with a line for each step.
    """

    def __init__(
        self, meshes: str | Path, out: Path, settings: BuildSettings, say: Callable[[str], None] = print
    ):
        self.meshes, self.out, self.settings, self.say = meshes, Path(out), settings, say
        self.cache_folder = self.out / "build" / "kept"
        settings.check()
        begun = (self.out / "build").is_dir()
        if self.out.exists() and not (begun or self.out.is_dir() and not any(self.out.iterdir())):
            raise UserError(
                f"'{self.out}' holds what `vig class build` did not make. Choose a new or an empty folder."
            )

    def build(self) -> BuildResult:
        """Run all stages; return the class as written.

        Raises UserError when the folder holds no usable mesh, or settings do not fit it.
        """
        scans, unreadable = self.scans, self.unreadable
        for name, reason in unreadable.items():
            self.say(f"left out {name}: {reason}")
        self._check_numbers()
        self.say(f"{_counted(len(scans), 'mesh')} from {self.meshes}")
        sheets = self.out / "build"
        pictures.save_mesh_sheet(sheets / "1-as-they-are.png", [(s.vertices, s.faces) for s in scans])
        poses = self.upright
        for line in poses.report:
            self.say(line)
        pictures.save_mesh_sheet(
            sheets / "2-upright.png", [self.mesh_in_frame(n) for n in range(len(scans))], above=True
        )
        medoid, vertices, faces = self.template
        self.say(f"template: {scans[medoid].name}, {len(vertices)} vertices, {len(faces)} faces")
        pictures.save_mesh_sheet(
            sheets / "3-template.png", [self.mesh_in_frame(medoid), (vertices, faces)], side=320
        )
        registered, qualities = self._registered()
        accepted = [n for n, quality in qualities.items() if not quality.reason]
        if not accepted:
            raise UserError(
                f"expected meshes of one kind in '{self.meshes}'; no two are alike. Look at {sheets}."
            )
        return self._write(registered, qualities, accepted)

    # -- stages -------------------------------------------------------------------------------------------

    @cached_property
    def folder(self) -> Path:
        """The folder of the meshes; catalogues are unpacked."""
        folder = mesh_folder(self.meshes)
        return folder.parent if folder.is_file() else folder

    @cached_property
    def _read(self) -> tuple[list[Scan], dict[str, str]]:
        return read_scans(self.meshes)

    @property
    def scans(self) -> list[Scan]:
        """The meshes, in the order of their names; their numbers on the sheets count from 1."""
        return self._read[0]

    @property
    def unreadable(self) -> dict[str, str]:
        """Why files were left out."""
        return self._read[1]

    @cached_property
    def surfaces(self) -> list[SurfaceSample]:
        """The visible surface of each mesh, in its file's axes."""
        surfaces = []
        for scan in self.scans:

            def compute(scan: Scan = scan) -> dict[str, np.ndarray]:
                return vars(visible_surface(scan.vertices, scan.faces))

            arrays = self._cached("surface", [scan.content_hash], compute)
            surfaces.append(SurfaceSample(arrays["points"], arrays["normals"]))
        return surfaces

    @cached_property
    def used(self) -> list[int]:
        """Numbers of the meshes that were not dropped."""
        return [n for n in range(len(self.scans)) if n + 1 not in self.settings.drops]

    @cached_property
    def upright(self) -> UprightPoses:
        """The upright pose of each mesh; dropped ones keep their file's axes."""
        marks = [self.scans[n].content_hash for n in self.used]
        pose = self._cached("pose", marks, self._common_pose)
        rotations = np.tile(np.eye(3), (len(self.scans), 1, 1))
        rotations[self.used] = pose["rotations"]
        rotations_to_common = list(pose["rotations"])
        surfaces = [self.surfaces[n] for n in self.used]
        usual_turn, settings = usual_axes(rotations_to_common), self.settings
        if settings.up is None:
            up = up_axis(surfaces, rotations_to_common)
        else:
            up = usual_turn @ _axis_vector(settings.up)
        report = [f"up: {_axis_name(usual_turn.T @ up)} of most files, {_source(settings.up)}"]
        upright = [cube_turn_to_up(up) @ rotation for rotation in rotations_to_common]
        if settings.symmetry == "any-turn":
            levelled = [
                _upright_by_axis(s, r, usual_turn.T @ up) for s, r in zip(surfaces, upright, strict=True)
            ]
        else:
            levelled = [
                levelling_rotation(s.transformed(r, np.zeros(3))) @ r
                for s, r in zip(surfaces, upright, strict=True)
            ]
        clouds = [
            PointCloud.from_surface(s.transformed(r, np.zeros(3)))
            for s, r in zip(surfaces, levelled, strict=True)
        ]
        symmetries = class_symmetry(clouds)
        if settings.symmetry is not None:
            symmetries = replace(symmetries, symmetry=settings.symmetry)
        if symmetries.symmetry == "any-turn":
            symmetries = replace(symmetries, mirror=True)
        report.append(f"symmetry: {symmetries.symmetry}, {_source(settings.symmetry)}")
        if settings.front is not None:
            ahead = cube_turn_to_up(up) @ usual_turn @ _axis_vector(settings.front)
            if abs(ahead[2]) > 0.5:
                raise UserError(f"expected a front that is level; got {settings.front} with {report[0]}.")
            front = math.atan2(ahead[1], ahead[0])
        elif symmetries.mirror and symmetries.symmetry == "none":
            front = front_angle(clouds, symmetries.mirror_plane)
        else:
            front = 0.0
        ahead = usual_turn.T @ cube_turn_to_up(up).T @ np.array([math.cos(front), math.sin(front), 0.0])
        if symmetries.symmetry != "any-turn":
            report.append(f"front: {_axis_name(ahead)} of most files, {_source(settings.front)}")
            report.append(f"mirror plane: {'yes' if symmetries.mirror else 'none'}")
        for index, number in enumerate(self.used):
            rotation = about_z(-front) @ levelled[index]
            cloud = PointCloud.from_surface(surfaces[index].transformed(rotation, np.zeros(3)))
            if symmetries.mirror and symmetries.symmetry == "none":
                rotation = about_z(straightening_angle(cloud)) @ rotation
            rotation = about_z(math.radians(settings.turns.get(number + 1, 0.0))) @ rotation
            rotations[number] = rotation
        return UprightPoses(rotations, symmetries, tuple(report))

    def _common_pose(self) -> dict[str, np.ndarray]:
        self.say("comparing poses")
        _, rotations, costs = align_clouds([PointCloud.from_surface(self.surfaces[n]) for n in self.used])
        return {"rotations": np.array(rotations), "costs": costs}

    def _frame(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Linear map (3, 3) and offset (3,) from a file's axes to the class's frame, of unit size."""
        points = self.surfaces[number].points @ self.upright.rotations[number].T
        scale = 1 / math.sqrt(((points - points.mean(0)) ** 2).sum(1).mean())
        height = points[:, 2] - points[:, 2].min()
        foot = points[height < 0.02 * height.max()]
        middle = np.append((foot[:, :2].min(0) + foot[:, :2].max(0)) / 2, points[:, 2].min())
        return scale * self.upright.rotations[number], -scale * middle

    def mesh_in_frame(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """A mesh in the class's frame."""
        linear, offset = self._frame(number)
        scan = self.scans[number]
        return scan.vertices @ linear.T + offset, scan.faces

    @cached_property
    def surfaces_in_frame(self) -> list[SurfaceSample]:
        """The surfaces in the class's frame."""
        return [s.transformed(*self._frame(n)) for n, s in enumerate(self.surfaces)]

    @cached_property
    def template(self) -> tuple[int, np.ndarray, np.ndarray]:
        """The medoid's number, and the template's vertices and faces."""
        clouds = [PointCloud.from_surface(self.surfaces_in_frame[n]) for n in self.used]
        identity = np.eye(3)
        costs = np.array([[a.distance(b, identity) for b in clouds] for a in clouds])
        for index in np.argsort(np.median(costs, axis=1), kind="stable"):
            number = self.used[int(index)]

            def compute(number: int = number) -> dict[str, np.ndarray]:
                try:
                    vertices, faces = closed_template(
                        *self.mesh_in_frame(number), self.surfaces_in_frame[number], self.settings.vertices
                    )
                except ValueError:
                    return {"vertices": np.zeros((0, 3)), "faces": np.zeros((0, 3), np.int64)}
                return {"vertices": vertices, "faces": faces}

            marks = [
                self.scans[number].content_hash,
                repr(self.upright.rotations[number]),
                str(self.settings.vertices),
            ]
            arrays = self._cached("template", marks, compute)
            if len(arrays["vertices"]):
                return number, arrays["vertices"], arrays["faces"]
        raise UserError(f"expected a mesh in '{self.meshes}' that can be closed; none can. Mend one of them.")

    def _registered(self) -> tuple[np.ndarray, dict[int, Quality]]:
        """The template carried onto each mesh (N, V, 3), and how well it lies there."""
        medoid, vertices, faces = self.template
        registration: Registration | None = None
        results = np.zeros((len(self.scans), *vertices.shape))
        qualities: dict[int, Quality] = {}
        for number in self.used:
            scan, target = self.scans[number], self.surfaces_in_frame[number]

            def compute(target: SurfaceSample = target) -> dict[str, np.ndarray]:
                nonlocal registration
                registration = registration or Registration(vertices, faces)
                return {"vertices": registration.onto(target)}

            pose = repr(self.upright.rotations[[number, medoid]])
            marks = [scan.content_hash, self.scans[medoid].content_hash, pose, str(self.settings.vertices)]
            results[number] = self._cached("registered", marks, compute)["vertices"]
            quality = quality_of(vertices, results[number], faces, target)
            qualities[number] = quality
            self.say(f"{number + 1:3d} {scan.name}: {quality.mean:.2%} of its size off")
        # What the template's few vertices cannot represent of its own mesh is not held against other meshes.
        unmatched_of_medoid = qualities[medoid].unmatched_mesh
        max_unmatched = (
            MAX_ATTACHMENT_SHARE if self.upright.symmetries.symmetry == "any-turn" else MAX_UNMATCHED_SHARE
        )
        for number in self.used:
            unmatched = max(0.0, qualities[number].unmatched_mesh - unmatched_of_medoid)
            qualities[number] = replace(
                qualities[number], unmatched_mesh=unmatched, max_unmatched_mesh=max_unmatched
            )
        well_registered = [number for number in self.used if not qualities[number].reason]
        for number, ratio in zip(
            well_registered, median_distance_ratios(results[well_registered]), strict=True
        ):
            qualities[number] = replace(qualities[number], median_ratio=float(ratio))
        for number in self.used:
            if reason := qualities[number].reason:
                self.say(f"refused {number + 1} {self.scans[number].name}: {reason}")
        return results, qualities

    # -- the pack -----------------------------------------------------------------------------------------

    def _write(
        self, registered: np.ndarray, qualities: dict[int, Quality], accepted: list[int]
    ) -> BuildResult:
        medoid, template, faces = self.template
        shapes, sheets = registered[accepted], self.out / "build"
        symmetrise: SymmetryProjection | None = None
        exact = len(accepted) == 1
        if exact:
            pass
        elif self.upright.symmetries.symmetry == "any-turn":
            symmetrise = rotation_projection(template, faces)
            shapes = symmetrise(shapes)
        elif self.upright.symmetries.mirror:
            symmetrise = mirror_projection(template)
            mirrored = mirror_map(template, faces)
            shapes = np.stack([(shape + (mirrored @ shape) * MIRROR_Y) / 2 for shape in shapes])
        shapes[:, :, 2] -= shapes[:, :, 2].min(1)[:, None]
        scale = self.length / np.ptp(shapes.mean(0), axis=0).max()
        shapes = shapes * scale
        splits = splits_of(accepted)
        trained = [index for index, number in enumerate(accepted) if splits[number] == "train"]
        areas = vertex_areas(template, faces)
        components = fit_components(shapes[trained], areas / areas.sum(), symmetrise)
        source_meshes = self._source_meshes(registered, accepted, splits, scale)
        of_class = [mesh for mesh in source_meshes if mesh.design >= 0 and mesh.split == "train"]
        dark = dark_part(of_class, components.mean, faces)
        model = ShapeModel(
            components.mean.astype(np.float32),
            components.basis.astype(np.float32),
            faces.astype(np.int32),
            np.zeros(len(template), np.int32) if dark is None else dark[0].astype(np.int32),
            ("body",) if dark is None else ("body", "dark"),
            components.ratio.astype(np.float32),
        )
        families: tuple[Family, ...] = ()
        if self.upright.symmetries.symmetry != "any-turn":  # else what has holes is not of the shape
            kinds = [self._kind(accepted[index]) for index in trained]
            families = families_of(model, shapes[trained].astype(np.float32), kinds)
        mean, covariance = light_prior()
        size = np.ptp(components.mean, axis=0)
        object_class = ObjectClass(
            self.settings.name,
            model,
            float(np.round(size[2] / 2, 4)),
            mean,
            covariance,
            families=families,
            symmetry=Symmetry(self.upright.symmetries.symmetry),
            mirror=self.upright.symmetries.mirror,
            front=self.settings.shows,
            points=named_points(components.mean),
            viewing_distance=float(np.round(VIEWING_LENGTHS * size.max(), 4)),
            places=self.settings.places,
            fit_settings={} if dark is None else {"view_weight": DARK_VIEW_WEIGHT},
            part_reflectance=None if dark is None else (1.0, round(dark[1], 4)),
            object_from_mesh=self._object_from_mesh(accepted[0], registered, scale) if exact else None,
        )
        held_out = len(accepted) - len(trained)
        self.say(
            f"{_counted(len(accepted), 'mesh')} taken"
            + (f", {held_out} of them held out for validation and test" if held_out else "")
            + (
                ": its shape is held"
                if exact
                else f": {_counted(len(components.basis), 'component')},"
                f" {_counted(len(families) or 1, 'family')}"
            )
            + (f"; leave-one-out error {min(components.errors):.2%} of the size" if components.errors else "")
        )
        pictures.save_mesh_sheet(
            sheets / "4-registered.png", [(registered[n], faces) for n in accepted], checks=template
        )
        refused = [n for n in self.used if n not in accepted]
        if refused:
            pairs = [pair for n in refused for pair in (self.mesh_in_frame(n), (registered[n], faces))]
            pictures.save_mesh_sheet(sheets / "5-refused.png", pairs)
        (sheets / SOURCE_MESHES_FILE).unlink(missing_ok=True)
        if source_meshes:
            tell = "" if dark is None else f", and that {dark[0].mean():.0%} of the vertices are dark on most"
            self.say(f"{_counted(len(source_meshes), 'mesh')} with materials, which training shows{tell}")
            save_source_meshes(sheets / SOURCE_MESHES_FILE, source_meshes)
        pictures.save_component_sheet(sheets / "6-components.png", components, faces)
        pictures.save_error_curve(sheets / "7-leave-one-out.png", components)
        result = BuildResult(
            object_class,
            self.scans,
            self.unreadable,
            self.upright,
            medoid,
            qualities,
            splits,
            components,
            read_sources(self.folder).of({scan.name for scan in self.scans}),
        )
        names = tuple(self.scans[n].name for n in accepted)
        with_splits = tuple(splits[n] for n in accepted)
        (self.out / "class.json").unlink(missing_ok=True)  # it comes last: a pack with it is whole
        staged = sheets / "staged"
        object_class.save(staged)
        HeldOutDesigns(names, with_splits, shapes.astype(np.float32)).save(staged)
        write_transfer(object_class, staged)
        with atomic_write(staged / "card.md") as temporary:
            temporary.write_text(card(result, self.length), encoding="utf-8")
        self._put_aside_weights(staged)
        for file in sorted(staged.iterdir(), key=lambda path: path.name == "class.json"):
            file.replace(self.out / file.name)
        shutil.rmtree(staged)
        return result

    @cached_property
    def length(self) -> float:
        """Longest side of the mean shape, metres."""
        if self.settings.length is not None:
            return self.settings.length
        if len(self.scans) == 1 and self.scans[0].name.lower().endswith((".glb", ".gltf")):
            own = float(np.ptp(self.scans[0].vertices, axis=0).max())
            if LENGTHS[0] <= own <= LENGTHS[1]:
                return own
        return USUAL_LENGTH

    def _object_from_mesh(self, number: int, registered: np.ndarray, scale: float) -> np.ndarray:
        """The similarity (4, 4) from a file's coordinates to the class's frame, metres."""
        linear, offset = self._frame(number)
        similarity = np.eye(4)
        similarity[:3, :3] = scale * linear
        similarity[:3, 3] = scale * (offset - [0, 0, registered[number][:, 2].min()])
        return similarity

    def _source_meshes(
        self, registered: np.ndarray, accepted: list[int], splits: dict[int, Split], scale: float
    ) -> list[SourceMesh]:
        """The meshes that have materials, in metres, where these count; refused ones are for training."""
        meshes: list[SourceMesh] = []
        for number in self.used if self.settings.materials else []:
            move = self._object_from_mesh(number, registered, scale)
            loaded = load(self.folder, self.folder / self.scans[number].name)
            pieces = loaded.pieces
            if loaded.missing:
                names = ", ".join(loaded.missing)
                self.say(f"{self.scans[number].name}: {names} missing or unreadable; grey instead")
            if len(pieces) == 1 and pieces[0].texture.size == 3:
                continue  # of one colour, as of a format without any
            meshes.append(
                SourceMesh.of(
                    pieces,
                    move[:3, :3],
                    move[:3, 3],
                    scale * (registered[number] - [0, 0, registered[number][:, 2].min()]),
                    accepted.index(number) if number in accepted else -1,
                    splits.get(number, "train"),
                )
            )
        return meshes

    def _put_aside_weights(self, staged: Path) -> None:
        """Move weights that were trained on other shapes, and their calibration, to build/outdated."""
        shapes = "shape.safetensors"
        before = self.out / shapes
        if not before.exists() or before.read_bytes() == (staged / shapes).read_bytes():
            return
        aside = self.out / "build" / "outdated"
        for name in TRAINED_FILES:
            if (self.out / name).exists():
                aside.mkdir(exist_ok=True)
                (self.out / name).replace(aside / name)
                self.say(f"{name} was trained on other shapes: it lies in {aside}; run vig class train again")

    def _kind(self, number: int) -> str:
        """Return the family of a mesh: the number of holes through it, in words."""
        surface = self.surfaces_in_frame[number]
        arrays = self._cached(
            "holes",
            [self.scans[number].content_hash],
            lambda: {"holes": np.array([genus(*self.mesh_in_frame(number), surface)])},
        )
        count = int(arrays["holes"][0])
        return "no hole" if count == 0 else f"{count} hole{'s' if count > 1 else ''}"

    # -- cache --------------------------------------------------------------------------------------------

    def _cached(
        self, stage: str, inputs: list[str], make: Callable[[], dict[str, Any]]
    ) -> dict[str, np.ndarray]:
        """Return a stage's result for these inputs, from the cache where an earlier run left it there."""
        key = hashlib.sha256(json.dumps([CACHE_VERSION, stage, inputs]).encode()).hexdigest()[:24]
        path = self.cache_folder / f"{stage}-{key}.safetensors"
        if path.exists():
            try:
                return load_file(path)
            except Exception:  # a damaged file is made again
                path.unlink()
        result = {name: np.ascontiguousarray(value) for name, value in make().items()}
        with atomic_write(path) as temporary:
            save_file(result, temporary)
        return result

    def _check_numbers(self) -> None:
        count = len(self.scans)
        for number in (*self.settings.turns, *self.settings.drops):
            if not 1 <= number <= count:
                raise UserError(f"expected numbers of meshes from 1 to {count}; got {number}.")
        if not self.used:
            raise UserError("expected at least one mesh that is not dropped; got none.")


def _axis_vector(name: str) -> np.ndarray:
    """The unit vector (3,) of an axis such as "+x"; UserError for others."""
    axis = AXES.get(name.lower().removeprefix("+"))
    if axis is None:
        raise UserError(f"expected an axis such as +x, -y or z; got '{name}'.")
    return np.array(axis, float)


def _source(setting: str | None) -> str:
    """Where a reported axis or symmetry comes from."""
    return "found" if setting is None else "told"


def _upright_by_axis(surface: SurfaceSample, upright: np.ndarray, usual_up: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) that puts the axis of a surface of revolution upright.

    Which end is up is decided by the up axis `usual_up` (3,) of most files where it is within about 26
    degrees of the axis, else by the rotation `upright` of the common pose.
    """
    own_up = upright[2]
    axis = axis_of_revolution(PointCloud.from_surface(surface), own_up)
    return rotation_to_vertical(axis, usual_up if abs(axis @ usual_up) > 0.9 else own_up)


def _counted(count: int, noun: str) -> str:
    plural = {"mesh": "meshes", "family": "families"}.get(noun, f"{noun}s")
    return f"{count} {noun if count == 1 else plural}"


def _axis_name(axis: np.ndarray) -> str:
    """The axis nearest to a vector (3,), such as "+x"."""
    best = int(np.abs(axis).argmax())
    return f"{'+' if axis[best] > 0 else '-'}{'xyz'[best]}"


def splits_of(accepted: list[int]) -> dict[int, Split]:
    """Return the split of each accepted mesh: with ten or more, a third are held out."""
    order: tuple[Split, ...] = ("train", "train", "validation", "train", "train", "test")
    if len(accepted) < MIN_MESHES_TO_HOLD_OUT:
        return dict.fromkeys(accepted, "train")
    return {number: order[index % 6] for index, number in enumerate(accepted)}


def named_points(mean: np.ndarray) -> dict[str, int]:
    """Return vertices that a user may click: the farthest to the front, the back and the top."""
    return {
        "front": int(mean[:, 0].argmax()),
        "back": int(mean[:, 0].argmin()),
        "top": int(mean[:, 2].argmax()),
    }
