"""A class pack from a folder of meshes, stage by stage; what each stage found is kept for the next run."""

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
from vig_train.building.acceptance import MOST_BESIDE, MOST_FAR, Quality, apart, quality_of
from vig_train.building.card import card
from vig_train.building.families import families_of, holes
from vig_train.building.model import Alike, Components, fitted
from vig_train.building.pose import (
    Cloud,
    Shape,
    aligned,
    axis_of_revolution,
    front_turn,
    levelled,
    shape_of,
    straightened,
    to_up,
    turned_up,
    up_axis,
    usual_axes,
)
from vig_train.building.reading import Scan, read_scans
from vig_train.building.registration import Registration
from vig_train.building.surface import Surface, vertex_areas, visible_surface
from vig_train.building.symmetries import ACROSS, image_map, mirror_map, round_map
from vig_train.building.template import VERTICES, closed_template
from vig_train.packs.lights import light_prior
from vig_train.packs.transfer import write_transfer
from vig_world.assets.held_out import HeldOutDesigns
from vig_world.assets.props.families import ZONE_NAMES
from vig_world.dataset.spec import Split
from vig_world.rotations import about_z

VERSION = 1
"""Of the stages' results: those of another are made again."""
TRAINED = ("recognition.safetensors", "calibration.json", "reliability.png")
"""Files of a pack that `vig class train` writes."""
VIEWING = 1.5
"""Distance of the standard camera, in lengths of the object."""
HOLD_OUT_FROM = 10
"""With so many meshes every sixth is kept for validation and every sixth for the test."""
LEAST_VERTICES, MOST_VERTICES = 200, 20_000
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}


@dataclass(frozen=True)
class BuildSettings:
    """What the user tells of a class.

    Attributes:
        name: Of the class.
        up: The axis that points up in most files, such as "z"; None: found.
        front: The axis that the front faces in most files, such as "+x"; None: found.
        shows: What the front shows, such as "the handle"; for texts.
        symmetry: "none", "half-turn", "any-turn"; None: found.
        length: Longest side of the mean shape, metres.
        turns: Degrees by which meshes, by number, are turned counter-clockwise about the vertical in the end.
        drops: Numbers of meshes that are left out.
        vertices: Of the template, about.
        places: Zones of rooms where such things stand, with relative frequencies.
    """

    name: str
    up: str | None = None
    front: str | None = None
    shows: str = ""
    symmetry: str | None = None
    length: float = 0.2
    turns: dict[int, float] = field(default_factory=dict)
    drops: tuple[int, ...] = ()
    vertices: int = VERTICES
    places: dict[str, float] = field(default_factory=dict)

    def check(self) -> None:
        """Raise UserError for what no class can have."""
        if not 0.001 <= self.length <= 10:
            raise UserError(f"expected a length from 0.001 to 10 metres; got {self.length}.")
        if not LEAST_VERTICES <= self.vertices <= MOST_VERTICES:
            raise UserError(
                f"expected {LEAST_VERTICES} to {MOST_VERTICES} vertices; got {self.vertices}."
                f" Take about {VERTICES}."
            )
        for text in (self.name, self.shows or "-"):
            if not text or len(text) > 100 or not text.isprintable():
                raise UserError(f"expected names of 1 to 100 printable characters; got {text[:100]!r}.")
        for axis in (self.up, self.front):
            if axis is not None:
                _axis(axis)
        if self.symmetry is not None and self.symmetry not in set(Symmetry):
            raise UserError(f"expected a symmetry among {', '.join(Symmetry)}; got '{self.symmetry}'.")
        if unknown := sorted(set(self.places) - set(ZONE_NAMES)):
            raise UserError(f"expected places among {', '.join(ZONE_NAMES)}; got '{unknown[0]}'.")


@dataclass(frozen=True)
class Stood:
    """The meshes upright in one frame: +X the front, the foot's middle at the origin, of one size.

    Attributes:
        rotations: (N, 3, 3) from each file's axes.
        shape: Symmetries.
        said: What was found and what was told, sentence by sentence.
    """

    rotations: np.ndarray
    shape: Shape
    said: tuple[str, ...]


@dataclass(frozen=True)
class Built:
    """A class that was built, and how.

    Attributes:
        object_class: As saved.
        scans: All meshes that could be read.
        unread: Why other files were left out, by name.
        stood: How the meshes stand.
        medoid: Number of the mesh that the template was made from.
        qualities: Of each mesh that was not dropped, by its number.
        splits: Of each accepted mesh, by its number.
        components: The shape model.
    """

    object_class: ObjectClass
    scans: list[Scan]
    unread: dict[str, str]
    stood: Stood
    medoid: int
    qualities: dict[int, Quality]
    splits: dict[int, Split]
    components: Components

    @property
    def refused(self) -> dict[str, str]:
        """Why each mesh that is not in the class was left out, by its file's name."""
        found = dict(self.unread)
        for number, scan in enumerate(self.scans):
            if number not in self.splits:
                quality = self.qualities.get(number)
                found[scan.name] = "dropped" if quality is None else quality.reason
        return found


class Builder:
    """The stages of building a class pack from a folder of meshes.

    Args:
        folder: Of meshes.
        out: The pack's folder, made where it is missing.
        settings: What is told.
        say: Is called with a line for each step.
    """

    def __init__(self, folder: Path, out: Path, settings: BuildSettings, say: Callable[[str], None] = print):
        self.folder, self.out, self.settings, self.say = Path(folder), Path(out), settings, say
        self.kept = self.out / "build" / "kept"
        settings.check()
        begun = (self.out / "build").is_dir()
        if self.out.exists() and not (begun or self.out.is_dir() and not any(self.out.iterdir())):
            raise UserError(
                f"'{self.out}' holds what `vig class build` did not make. Choose a new or an empty folder."
            )

    def build(self) -> Built:
        """All stages; returns what the last one wrote.

        Raises UserError when the folder holds no usable mesh, or settings do not fit it.
        """
        scans, unread = self.scans, self.unread
        for name, why in unread.items():
            self.say(f"left out {name}: {why}")
        self._check_numbers()
        self.say(f"{_counted(len(scans), 'mesh')} from {self.folder}")
        sheets = self.out / "build"
        pictures.meshes(sheets / "1-as-they-are.png", [(s.vertices, s.faces) for s in scans])
        stood = self.stood
        for line in stood.said:
            self.say(line)
        pictures.meshes(sheets / "2-upright.png", [self.placed(n) for n in range(len(scans))], above=True)
        medoid, vertices, faces = self.template
        self.say(f"template: {scans[medoid].name}, {len(vertices)} vertices, {len(faces)} faces")
        pictures.meshes(sheets / "3-template.png", [self.placed(medoid), (vertices, faces)], side=320)
        registered, qualities = self._registered()
        accepted = [n for n, quality in qualities.items() if not quality.reason]
        if not accepted:
            raise UserError(
                f"expected meshes of one kind in '{self.folder}'; no two are alike. Look at {sheets}."
            )
        return self._write(registered, qualities, accepted)

    # -- stages -------------------------------------------------------------------------------------------

    @cached_property
    def _read(self) -> tuple[list[Scan], dict[str, str]]:
        return read_scans(self.folder)

    @property
    def scans(self) -> list[Scan]:
        """The meshes, in the order of their names; their numbers on the sheets count from 1."""
        return self._read[0]

    @property
    def unread(self) -> dict[str, str]:
        """Why files were left out."""
        return self._read[1]

    @cached_property
    def surfaces(self) -> list[Surface]:
        """What is seen of each mesh from outside, in its file's axes."""
        surfaces = []
        for scan in self.scans:

            def made(scan: Scan = scan) -> dict[str, np.ndarray]:
                return vars(visible_surface(scan.vertices, scan.faces))

            held = self._keep("surface", [scan.mark], made)
            surfaces.append(Surface(held["points"], held["normals"]))
        return surfaces

    @cached_property
    def used(self) -> list[int]:
        """Numbers of the meshes that were not dropped."""
        return [n for n in range(len(self.scans)) if n + 1 not in self.settings.drops]

    @cached_property
    def stood(self) -> Stood:
        """How each mesh comes to stand; dropped ones as their files have them."""
        marks = [self.scans[n].mark for n in self.used]
        found = self._keep("pose", marks, self._common_pose)
        rotations = np.tile(np.eye(3), (len(self.scans), 1, 1))
        rotations[self.used] = found["rotations"]
        common = list(found["rotations"])
        some = [self.surfaces[n] for n in self.used]
        usual, told = usual_axes(common), self.settings
        up = up_axis(some, common) if told.up is None else usual @ _axis(told.up)
        said = [f"up: {_named(usual.T @ up)} of most files, {'found' if told.up is None else 'told'}"]
        upright = [to_up(up) @ rotation for rotation in common]
        if told.symmetry == "any-turn":
            level = [_by_axis(s, r, usual.T @ up) for s, r in zip(some, upright, strict=True)]
        else:
            level = [levelled(s.transformed(r, np.zeros(3))) @ r for s, r in zip(some, upright, strict=True)]
        clouds = [Cloud.of(s.transformed(r, np.zeros(3))) for s, r in zip(some, level, strict=True)]
        shape = shape_of(clouds)
        if told.symmetry is not None:
            shape = replace(shape, symmetry=told.symmetry)
        if shape.symmetry == "any-turn":
            shape = replace(shape, mirror=True)
        said.append(f"symmetry: {shape.symmetry}, {'found' if told.symmetry is None else 'told'}")
        if told.front is not None:
            ahead = to_up(up) @ usual @ _axis(told.front)
            if abs(ahead[2]) > 0.5:
                raise UserError(f"expected a front that is level; got {told.front} with {said[0]}.")
            front = math.atan2(ahead[1], ahead[0])
        else:
            front = front_turn(clouds, shape.plane) if shape.mirror and shape.symmetry == "none" else 0.0
        ahead = usual.T @ to_up(up).T @ np.array([math.cos(front), math.sin(front), 0.0])
        if shape.symmetry != "any-turn":
            said.append(f"front: {_named(ahead)} of most files, {'found' if told.front is None else 'told'}")
            said.append(f"mirror plane: {'yes' if shape.mirror else 'none'}")
        for place, number in enumerate(self.used):
            turned = about_z(-front) @ level[place]
            cloud = Cloud.of(some[place].transformed(turned, np.zeros(3)))
            if shape.mirror and shape.symmetry == "none":
                turned = about_z(straightened(cloud)) @ turned
            turned = about_z(math.radians(told.turns.get(number + 1, 0.0))) @ turned
            rotations[number] = turned
        return Stood(rotations, shape, tuple(said))

    def _common_pose(self) -> dict[str, np.ndarray]:
        self.say("comparing poses")
        _, rotations, costs = aligned([Cloud.of(self.surfaces[n]) for n in self.used])
        return {"rotations": np.array(rotations), "costs": costs}

    def _frame(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Linear map (3, 3) and offset (3,) from a file's axes to the class's frame, of unit size."""
        turned = self.surfaces[number].points @ self.stood.rotations[number].T
        scale = 1 / math.sqrt(((turned - turned.mean(0)) ** 2).sum(1).mean())
        height = turned[:, 2] - turned[:, 2].min()
        foot = turned[height < 0.02 * height.max()]
        middle = np.append((foot[:, :2].min(0) + foot[:, :2].max(0)) / 2, turned[:, 2].min())
        return scale * self.stood.rotations[number], -scale * middle

    def placed(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """A mesh in the class's frame."""
        linear, offset = self._frame(number)
        scan = self.scans[number]
        return scan.vertices @ linear.T + offset, scan.faces

    @cached_property
    def placed_surfaces(self) -> list[Surface]:
        """The surfaces in the class's frame."""
        return [s.transformed(*self._frame(n)) for n, s in enumerate(self.surfaces)]

    @cached_property
    def template(self) -> tuple[int, np.ndarray, np.ndarray]:
        """The medoid's number, and the template's vertices and faces."""
        clouds = [Cloud.of(self.placed_surfaces[n]) for n in self.used]
        same = np.eye(3)
        costs = np.array([[a.off(b, same) for b in clouds] for a in clouds])
        for place in np.argsort(np.median(costs, axis=1), kind="stable"):
            number = self.used[int(place)]

            def made(number: int = number) -> dict[str, np.ndarray]:
                try:
                    vertices, faces = closed_template(
                        *self.placed(number), self.placed_surfaces[number], self.settings.vertices
                    )
                except ValueError:
                    return {"vertices": np.zeros((0, 3)), "faces": np.zeros((0, 3), np.int64)}
                return {"vertices": vertices, "faces": faces}

            marks = [self.scans[number].mark, repr(self.stood.rotations[number]), str(self.settings.vertices)]
            held = self._keep("template", marks, made)
            if len(held["vertices"]):
                return number, held["vertices"], held["faces"]
        raise UserError(f"expected a mesh in '{self.folder}' that can be closed; none can. Mend one of them.")

    def _registered(self) -> tuple[np.ndarray, dict[int, Quality]]:
        """The template carried onto each mesh (N, V, 3), and how well it lies there."""
        medoid, vertices, faces = self.template
        registration: Registration | None = None
        results = np.zeros((len(self.scans), *vertices.shape))
        qualities: dict[int, Quality] = {}
        for number in self.used:
            scan, target = self.scans[number], self.placed_surfaces[number]

            def made(target: Surface = target) -> dict[str, np.ndarray]:
                nonlocal registration
                registration = registration or Registration(vertices, faces)
                return {"vertices": registration.onto(target)}

            stands = repr(self.stood.rotations[[number, medoid]])
            marks = [scan.mark, self.scans[medoid].mark, stands, str(self.settings.vertices)]
            results[number] = self._keep("registered", marks, made)["vertices"]
            quality = quality_of(vertices, results[number], faces, target)
            qualities[number] = quality
            self.say(f"{number + 1:3d} {scan.name}: {quality.mean:.2%} of its size off")
        # What a template of so few vertices cannot show of its own mesh it cannot show of others.
        own = qualities[medoid].lacking
        most = MOST_BESIDE if self.stood.shape.symmetry == "any-turn" else MOST_FAR
        for number in self.used:
            lacking = max(0.0, qualities[number].lacking - own)
            qualities[number] = replace(qualities[number], lacking=lacking, most_lacking=most)
        alike = [number for number in self.used if not qualities[number].reason]
        for number, far in zip(alike, apart(results[alike]), strict=True):
            qualities[number] = replace(qualities[number], apart=float(far))
        for number in self.used:
            if why := qualities[number].reason:
                self.say(f"refused {number + 1} {self.scans[number].name}: {why}")
        return results, qualities

    # -- the pack -----------------------------------------------------------------------------------------

    def _write(self, registered: np.ndarray, qualities: dict[int, Quality], accepted: list[int]) -> Built:
        medoid, template, faces = self.template
        shapes, sheets = registered[accepted], self.out / "build"
        alike: Alike | None = None
        if self.stood.shape.symmetry == "any-turn":
            alike = round_map(template, faces)
            shapes = alike(shapes)
        elif self.stood.shape.mirror:
            alike = image_map(template)
            mirrored = mirror_map(template, faces)
            shapes = np.stack([(each + (mirrored @ each) * ACROSS) / 2 for each in shapes])
        shapes[:, :, 2] -= shapes[:, :, 2].min(1)[:, None]
        shapes = shapes * self.settings.length / np.ptp(shapes.mean(0), axis=0).max()
        splits = splits_of(accepted)
        trained = [place for place, number in enumerate(accepted) if splits[number] == "train"]
        areas = vertex_areas(template, faces)
        components = fitted(shapes[trained], areas / areas.sum(), alike)
        model = ShapeModel(
            components.mean.astype(np.float32),
            components.basis.astype(np.float32),
            faces.astype(np.int32),
            np.zeros(len(template), np.int32),
            ("body",),
            components.ratio.astype(np.float32),
        )
        families: tuple[Family, ...] = ()
        if self.stood.shape.symmetry != "any-turn":  # else what has holes is not of the shape
            kinds = [self._kind(accepted[place]) for place in trained]
            families = families_of(model, shapes[trained].astype(np.float32), kinds)
        mean, covariance = light_prior()
        size = np.ptp(components.mean, axis=0)
        built = ObjectClass(
            self.settings.name,
            model,
            float(np.round(size[2] / 2, 4)),
            mean,
            covariance,
            families=families,
            symmetry=Symmetry(self.stood.shape.symmetry),
            mirror=self.stood.shape.mirror,
            front=self.settings.shows,
            points=named_points(components.mean),
            viewing_distance=float(np.round(VIEWING * size.max(), 4)),
            places=self.settings.places,
        )
        held = len(accepted) - len(trained)
        self.say(
            f"{_counted(len(accepted), 'mesh')} taken"
            + (f", {held} of them held out for validation and test" if held else "")
            + f": {_counted(len(components.basis), 'component')},"
            f" {_counted(len(families) or 1, 'family')}"
            + (f"; leave-one-out error {min(components.errors):.2%} of the size" if components.errors else "")
        )
        pictures.meshes(
            sheets / "4-registered.png", [(registered[n], faces) for n in accepted], checks=template
        )
        refused = [n for n in self.used if n not in accepted]
        if refused:
            pairs = [pair for n in refused for pair in (self.placed(n), (registered[n], faces))]
            pictures.meshes(sheets / "5-refused.png", pairs)
        pictures.components(sheets / "6-components.png", components, faces)
        pictures.errors(sheets / "7-leave-one-out.png", components)
        result = Built(built, self.scans, self.unread, self.stood, medoid, qualities, splits, components)
        names = tuple(self.scans[n].name for n in accepted)
        with_splits = tuple(splits[n] for n in accepted)
        (self.out / "class.json").unlink(missing_ok=True)  # it comes last: a pack with it is whole
        staged = sheets / "staged"
        built.save(staged)
        HeldOutDesigns(names, with_splits, shapes.astype(np.float32)).save(staged)
        write_transfer(built, staged)
        with atomic_write(staged / "card.md") as temporary:
            temporary.write_text(card(result, self.settings), encoding="utf-8")
        self._put_aside_weights(staged)
        for file in sorted(staged.iterdir(), key=lambda path: path.name == "class.json"):
            file.replace(self.out / file.name)
        shutil.rmtree(staged)
        return result

    def _put_aside_weights(self, staged: Path) -> None:
        """Weights and their calibration that were trained on other shapes go to build/outdated."""
        shapes = "shape.safetensors"
        before = self.out / shapes
        if not before.exists() or before.read_bytes() == (staged / shapes).read_bytes():
            return
        aside = self.out / "build" / "outdated"
        for name in TRAINED:
            if (self.out / name).exists():
                aside.mkdir(exist_ok=True)
                (self.out / name).replace(aside / name)
                self.say(f"{name} was trained on other shapes: it lies in {aside}; run vig class train again")

    def _kind(self, number: int) -> str:
        """What family a mesh is of: how many holes go through it."""
        target = self.placed_surfaces[number]
        held = self._keep(
            "holes",
            [self.scans[number].mark],
            lambda: {"holes": np.array([holes(*self.placed(number), target)])},
        )
        count = int(held["holes"][0])
        return "no hole" if count == 0 else f"{count} hole{'s' if count > 1 else ''}"

    # -- what is kept -------------------------------------------------------------------------------------

    def _keep(
        self, stage: str, inputs: list[str], make: Callable[[], dict[str, Any]]
    ) -> dict[str, np.ndarray]:
        """The result of a stage for these inputs, from the last run where it has one."""
        key = hashlib.sha256(json.dumps([VERSION, stage, inputs]).encode()).hexdigest()[:24]
        path = self.kept / f"{stage}-{key}.safetensors"
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


def _axis(name: str) -> np.ndarray:
    """The unit vector (3,) of an axis such as "+x"; UserError for others."""
    axis = AXES.get(name.lower().removeprefix("+"))
    if axis is None:
        raise UserError(f"expected an axis such as +x, -y or z; got '{name}'.")
    return np.array(axis, float)


def _by_axis(surface: Surface, upright: np.ndarray, most: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) that puts the axis of what any turn leaves the same upright.

    Which end is up the axis `most` (3,) of most files says, where it is about this one, else the pose found.
    """
    own = upright[2]
    axis = axis_of_revolution(Cloud.of(surface), own)
    return turned_up(axis, most if abs(axis @ most) > 0.9 else own)


def _counted(count: int, noun: str) -> str:
    plural = {"mesh": "meshes", "family": "families"}.get(noun, f"{noun}s")
    return f"{count} {noun if count == 1 else plural}"


def _named(axis: np.ndarray) -> str:
    """The axis nearest to a vector (3,), such as "+x"."""
    best = int(np.abs(axis).argmax())
    return f"{'+' if axis[best] > 0 else '-'}{'xyz'[best]}"


def splits_of(accepted: list[int]) -> dict[int, Split]:
    """Which split's scenes each accepted mesh is for: with ten or more, a third are held out."""
    order: tuple[Split, ...] = ("train", "train", "validation", "train", "train", "test")
    if len(accepted) < HOLD_OUT_FROM:
        return dict.fromkeys(accepted, "train")
    return {number: order[place % 6] for place, number in enumerate(accepted)}


def named_points(mean: np.ndarray) -> dict[str, int]:
    """Vertices that a user may click: the farthest to the front, the back and the top."""
    return {
        "front": int(mean[:, 0].argmax()),
        "back": int(mean[:, 0].argmin()),
        "top": int(mean[:, 2].argmax()),
    }
