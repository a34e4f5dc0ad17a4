"""A class of objects as a folder of data (a class pack): no code, no pickle."""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from vig.io.checks import check_arrays, check_indices, check_number, decode, read_json, read_tensors, reading
from vig.io.errors import UserError
from vig.io.files import write_arrays, write_json
from vig.scene.camera import DISTANCE, IMAGE_SIZE, Camera
from vig.scene.shape_model import ARRAYS, ShapeModel
from vig.scene.symmetry import Symmetry
from vig_renderer.defaults import with_default_settings

TRANSFER_FILE = "transfer.safetensors"
BUILD_COMMAND = Path("build", "unfinished.txt")
"""File with the command of `vig class build`, in its pack until that is whole."""
PACKAGED = Path(__file__).parents[1] / "classes"
FORMAT = 1


@dataclass(frozen=True)
class Family:
    """Shapes of one kind within a class, such as chairs with arms.

    Attributes:
        name: Name of the kind.
        mean: (K,) coefficients of the mean of its shapes.
        deviation: (K,) their standard deviations about it.
        share: Share of the class's shapes.
    """

    name: str
    mean: tuple[float, ...]
    deviation: tuple[float, ...]
    share: float


class _LightPrior(msgspec.Struct, frozen=True):
    mean: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]


class _Description(msgspec.Struct, frozen=True, kw_only=True):
    """Content of class.json: fields of `ObjectClass` by their names in the file, and those of the file alone.

    `vig_world.assets.held_out` reads the designs.
    """

    format: int
    name: str
    target_height: float = msgspec.field(name="target_height_m")
    part_names: tuple[str, ...]
    light_prior: _LightPrior
    symmetry: Symmetry = Symmetry.NONE
    mirror: bool = True
    front: str = ""
    points: dict[str, int] = {}
    viewing_distance: float = msgspec.field(name="viewing_distance_m", default=DISTANCE)
    places: dict[str, float] = {}
    self_shadow: bool = False
    fit_settings: dict[str, bool | float] = {}
    families: tuple[Family, ...] = ()
    held_out_designs: tuple[Any, ...] = ()
    part_reflectance: tuple[float, ...] | None = None
    object_from_mesh: tuple[tuple[float, ...], ...] | None = None
    size_known: bool = True
    up_known: bool = True


@with_default_settings
@dataclass(frozen=True, eq=False)
class ObjectClass:
    """Prior knowledge of a class before any photo.

    Attributes:
        name: Name of the class; for a packaged class also its folder's.
        shape_model: Metres, the front towards +X.
        target_height: Metres above the base at which the camera looks.
        light_prior_mean: (9,) of a Gaussian over SH lights in the world frame at the paper's exposure.
        light_prior_covariance: (9, 9) of it.
        folder: Folder that it was read from, None when built in memory.
        transfer: (K + 1, V, 9), or None: changes by self-shadowing and interreflection of the nine
            lobes of each vertex, for the mean shape and per component (`vig_train.packs.transfer`).
        families: Kinds of shapes with nothing between them; none where all shapes are of one kind.
        symmetry: Turn about Z under which all shapes look the same.
        mirror: Whether shapes are mirror images of themselves in y = 0.
        front: Side that +X shows, such as "the spout".
        points: Vertices by names that a user may click, such as "spout".
        viewing_distance: Metres from the camera in the standard view; about 1.5 times the greatest extent.
        places: Relative frequency of each zone of the generator's rooms as a place; none takes its own.
        fit_settings: Values of `vig.inference.ExplainSettings`, by name, where a user states none; see
            `vig.inference.resolve`.
        part_reflectance: (parts,) albedo of each part over that of the object, as far as it is known of the
            class: a car's windows are dark. None where nothing is known.
        object_from_mesh: (4, 4) similarity from the coordinates of the file of a class of one mesh to the
            class's frame; None for other classes.
        size_known: Whether its metres are more than assumed: a length was given, or the files are in metres.
        up_known: Whether the axis that points up is more than estimated, for a class of one mesh.
    """

    name: str
    shape_model: ShapeModel
    target_height: float
    light_prior_mean: np.ndarray
    light_prior_covariance: np.ndarray
    folder: Path | None = None
    transfer: np.ndarray | None = None
    families: tuple[Family, ...] = ()
    symmetry: Symmetry = Symmetry.NONE
    mirror: bool = True
    front: str = ""
    points: Mapping[str, int] = field(default_factory=dict)
    viewing_distance: float = DISTANCE
    places: Mapping[str, float] = field(default_factory=dict)
    fit_settings: Mapping[str, bool | float] = field(default_factory=dict)
    part_reflectance: tuple[float, ...] | None = None
    object_from_mesh: np.ndarray | None = None
    size_known: bool = True
    up_known: bool = True

    def __post_init__(self) -> None:
        points = [("name of a point", name) for name in self.points]
        for what, text in [("name", self.name), *points, ("front", self.front or "-")]:
            if not text or len(text) > 100 or not text.isprintable():
                raise ValueError(f"{what} must be 1 to 100 printable characters; it is {text[:100]!r}")
        check_number("target_height", self.target_height, -10.0, 10.0)
        check_number("viewing_distance", self.viewing_distance, 0.01, 100.0)
        check_indices("points", np.array([*self.points.values()], np.int64), len(self.shape_model.mean))
        for name, weight in self.places.items():
            check_number(f"places '{name[:40]}'", weight, 0.0, 1e6)
        if self.places and not any(self.places.values()):
            raise ValueError("places must have a frequency above 0")
        for family in self.families:
            check_number(f"share of family '{family.name[:40]}'", family.share, 1e-6, 1.0)
            mean, spread, modes = np.array(family.mean), np.array(family.deviation), self.shape_model.modes
            fits = len(mean) == len(spread) == modes
            if not fits or not np.isfinite(mean).all() or not ((spread > 1e-3) & (spread < 1e3)).all():
                raise ValueError(f"family '{family.name[:40]}' must have {modes} means and deviations")
        mean, covariance = self.light_prior_mean, self.light_prior_covariance
        prior = {"light prior mean": mean, "light prior covariance": covariance}
        floats = "float64 float32"
        check_arrays(prior, dict(zip(prior, [(floats, (9,)), (floats, (9, 9))], strict=True)))
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all() and mean[0] > 0):
            raise ValueError("light prior must be finite, its mean's first number positive")
        if not np.allclose(covariance, covariance.T) or np.linalg.eigvalsh(covariance)[0] <= 0:
            raise ValueError("light prior covariance must be symmetric and positive definite")
        if self.part_reflectance is not None:
            if len(self.part_reflectance) != len(self.shape_model.part_names):
                raise ValueError(f"part_reflectance must be {len(self.shape_model.part_names)} numbers")
            for number in self.part_reflectance:
                check_number("part_reflectance", number, 0.01, 1.0)
        if self.object_from_mesh is not None:
            given = {"object_from_mesh": self.object_from_mesh}
            check_arrays(given, {"object_from_mesh": ("float64", (4, 4))})
            if not abs(np.linalg.det(self.object_from_mesh[:3, :3])) > 0:
                raise ValueError("object_from_mesh must be a similarity")
        if self.transfer is not None:
            shape = (self.shape_model.modes + 1, len(self.shape_model.mean), 9)
            check_arrays({"transfer": self.transfer}, {"transfer": ("float32 float64", shape)})
            if not math.isfinite(self.transfer.sum(dtype=np.float64)):
                raise ValueError("transfer must be finite")

    @property
    def fingerprint(self) -> str:
        """Return a short hash of shapes and views, so that a dataset is not continued with another class."""
        model, digest = self.shape_model, hashlib.sha256()
        for array in (model.mean, model.basis, model.faces):
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update(str(self.target_height).encode())
        views = (str(self.symmetry), self.mirror, self.viewing_distance, dict(self.places))
        if views != ("none", True, DISTANCE, {}):
            digest.update(repr(views).encode())
        return digest.hexdigest()[:16]

    @cached_property
    def reflectance_of_parts(self) -> np.ndarray:
        """Return (parts,) float32, `part_reflectance`, or 1 where nothing is known."""
        return np.array(self.part_reflectance or [1.0] * len(self.shape_model.part_names), np.float32)

    @cached_property
    def reflectance(self) -> np.ndarray:
        """Return (V,) float32, the reflectance of each vertex's part."""
        return np.asarray(self.reflectance_of_parts[self.shape_model.parts])

    def camera(self, size: int = IMAGE_SIZE, camera_distance_ratio: float = 1.0) -> Camera:
        """Return the class's standard camera for a square image of `size` pixels; see `Camera.standard`."""
        return Camera.standard(size, self.target_height, camera_distance_ratio, self.viewing_distance)

    @property
    def scale(self) -> float:
        """Return the size of the class's things, over that of things that suit the paper's camera."""
        return self.viewing_distance / DISTANCE

    @cached_property
    def at_unit_scale(self) -> "ObjectClass":
        """Return the class in the size that suits the paper's camera: its `scale` is 1."""
        if self.scale == 1:
            return self
        model, size, height = self.shape_model, np.float32(self.scale), self.target_height / self.scale
        model = replace(model, mean=model.mean / size, basis=model.basis / size)
        return replace(self, shape_model=model, target_height=height, viewing_distance=DISTANCE)

    def save(self, folder: Path) -> None:
        """Write class.json and shape.safetensors into `folder`; other files there stay."""
        model = self.shape_model
        write_arrays(Path(folder) / "shape.safetensors", {name: getattr(model, name) for name in ARRAYS})
        mean, covariance = (np.round(p, 6) for p in (self.light_prior_mean, self.light_prior_covariance))
        description = _Description(
            format=FORMAT,
            part_names=model.part_names,
            light_prior=_LightPrior(mean.tolist(), covariance.tolist()),
            self_shadow=(Path(folder) / TRANSFER_FILE).exists(),
            object_from_mesh=None if self.object_from_mesh is None else self.object_from_mesh.tolist(),
            **{name: getattr(self, name) for name in _SHARED},
        )
        written = msgspec.to_builtins(description)
        for name in ("fit_settings", "families", "held_out_designs", "part_reflectance", "object_from_mesh"):
            if not written[name]:
                del written[name]
        for name in ("size_known", "up_known"):
            if written[name]:
                del written[name]
        write_json(Path(folder) / "class.json", written, 1)

    @staticmethod
    def load(name_or_folder: str | Path, unfinished: bool = False) -> "ObjectClass":
        """Read a packaged class by name, or a class pack from a folder. UserError when it is not one.

        unfinished: Whether to read also one whose build was stopped before it had a recognizer.
        """
        if not isinstance(name_or_folder, str | Path):
            kind = type(name_or_folder).__name__
            raise UserError(
                f"expected a class's name or folder; got a {kind}. Pass its name, such as 'teapot'."
            )
        folder = Path(name_or_folder)
        if (folder / BUILD_COMMAND).is_file() and not (unfinished and (folder / "class.json").is_file()):
            command = (folder / BUILD_COMMAND).read_text("utf-8", "replace").strip()
            raise UserError(
                f"expected a class; the build of '{folder}' is unfinished. Run it again: {command}"
            )
        if not (folder / "class.json").is_file() and folder.name == str(name_or_folder):
            folder = PACKAGED / folder
        if not (folder / "class.json").is_file():
            packaged = sorted(path.parent.name for path in PACKAGED.glob("*/class.json"))
            raise UserError(
                f"expected a class, one of {', '.join(packaged) or 'none packaged'},"
                f" or a folder with class.json; got '{name_or_folder}'. Check the name."
            )
        damaged = "Build or copy it again."
        with reading(folder / "class.json", "the description of a class", damaged):
            described: _Description = decode(_Description, read_json(folder / "class.json"))
            if described.format != FORMAT:
                raise ValueError(f"it is of format {described.format}, where this vig reads {FORMAT}")
        with reading(folder / "shape.safetensors", "a class's shapes", damaged):
            arrays, _ = read_tensors(folder / "shape.safetensors")
            check_arrays(arrays, {name: (kinds.split()[0], shape) for name, (kinds, shape) in ARRAYS.items()})
            model = ShapeModel(part_names=described.part_names, **{name: arrays[name] for name in ARRAYS})
        transfer = None
        if described.self_shadow and not (folder / TRANSFER_FILE).exists():
            raise UserError(
                f"{folder}: expected {TRANSFER_FILE}, which class.json tells of; got no such file. Copy the"
                " whole pack again: without it fits are shaded differently."
            )
        if (folder / TRANSFER_FILE).exists():
            with reading(folder / TRANSFER_FILE, "a class's transfer of light", damaged):
                held, _ = read_tensors(folder / TRANSFER_FILE)
                check_arrays(held, {"transfer": ("float16 float32", (model.modes + 1, len(model.mean), 9))})
                transfer = held["transfer"].astype(np.float32)
        with reading(folder, "a class pack", damaged):
            prior = described.light_prior
            mean, covariance = np.array(prior.mean, np.float64), np.array(prior.covariance, np.float64)
            shared, moved = {name: getattr(described, name) for name in _SHARED}, described.object_from_mesh
            return ObjectClass(
                shape_model=model,
                light_prior_mean=mean,
                light_prior_covariance=covariance,
                folder=folder.absolute(),  # usable after another os.chdir
                transfer=transfer,
                object_from_mesh=None if moved is None else np.array(moved, np.float64),
                **shared,
            )


_SHARED = tuple(
    field.name
    for field in fields(ObjectClass)
    if field.name in _Description.__struct_fields__ and field.name != "object_from_mesh"
)
"""Fields that `ObjectClass` and class.json have in common."""


def axis_name(axis: np.ndarray) -> str:
    """Return the axis nearest to a vector (3,), such as "+x"."""
    best = int(np.abs(axis).argmax())
    return f"{'+' if axis[best] > 0 else '-'}{'xyz'[best]}"
