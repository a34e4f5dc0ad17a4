"""A class of objects as a folder of data (a class pack): no code, no pickle."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import save_file

from vig.checks import check_arrays, check_number, decode, read_json, read_tensors, reading
from vig.errors import UserError
from vig.files import atomic_write
from vig.scene.shape_model import ShapeModel

TRANSFER_FILE = "transfer.safetensors"
PACKAGED = Path(__file__).parents[1] / "classes"
FORMAT = 1
_DAMAGED = "Build or copy it again."
_SHAPE = {
    "mean": ("float32", ("V", 3)),
    "basis": ("float32", ("K", "V", 3)),
    "faces": ("int32", ("F", 3)),
    "parts": ("int32", ("V",)),
    "explained_variance_ratio": ("float32", ("K",)),
}


@dataclass(frozen=True)
class Family:
    """Shapes of one kind within a class, such as teapots with their handle over the lid.

    Attributes:
        name: Of the kind.
        mean: (K,) coefficients of the mean of its shapes.
        deviation: (K,) their standard deviations about it.
        share: Of the class's shapes.
    """

    name: str
    mean: tuple[float, ...]
    deviation: tuple[float, ...]
    share: float


@dataclass(frozen=True)
class _LightPrior:
    """As class.json holds it."""

    mean: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class _Description:
    """What class.json holds; `vig_world.assets.held_out` reads the designs."""

    format: int
    name: str
    target_height_m: float
    part_names: tuple[str, ...]
    light_prior: _LightPrior
    families: tuple[Family, ...] = ()
    held_out_designs: tuple[Any, ...] = ()


@dataclass(frozen=True, eq=False)
class ObjectClass:
    """What is known of a class before any photo.

    target_height: metres above the base at which the camera looks. light_prior_mean (9,) and
    light_prior_covariance (9, 9): a Gaussian over SH lights in the world frame at the paper's exposure.
    folder: where it was read from, None when built in memory. transfer (K + 1, V, 9), or None: how
    self-shadow and light thrown from part to part change the nine lobes of each vertex, for the mean shape
    and per component (`vig_world.packs.transfer`). families: kinds of shapes with nothing between them; none
    where all shapes are of one kind.
    """

    name: str
    shape_model: ShapeModel
    target_height: float
    light_prior_mean: np.ndarray
    light_prior_covariance: np.ndarray
    folder: Path | None = None
    transfer: np.ndarray | None = None
    families: tuple[Family, ...] = ()

    def __post_init__(self) -> None:
        if not self.name or len(self.name) > 100 or not self.name.isprintable():
            raise ValueError(f"name must be 1 to 100 printable characters; it is {self.name[:100]!r}")
        check_number("target_height", self.target_height, -10.0, 10.0)
        for family in self.families:
            check_number(f"share of family '{family.name[:40]}'", family.share, 1e-6, 1.0)
            mean, spread = np.array(family.mean), np.array(family.deviation)
            fits = len(mean) == len(spread) == self.shape_model.modes
            if not fits or not np.isfinite(mean).all() or not ((spread > 1e-3) & (spread < 1e3)).all():
                modes = self.shape_model.modes
                raise ValueError(f"family '{family.name[:40]}' must have {modes} means and deviations")
        mean, covariance = self.light_prior_mean, self.light_prior_covariance
        prior = {"light prior mean": mean, "light prior covariance": covariance}
        floats = "float64 float32"
        check_arrays(prior, dict(zip(prior, [(floats, (9,)), (floats, (9, 9))], strict=True)))
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all() and mean[0] > 0):
            raise ValueError("light prior must be finite, its mean's first number positive")
        if not np.allclose(covariance, covariance.T) or np.linalg.eigvalsh(covariance)[0] <= 0:
            raise ValueError("light prior covariance must be symmetric and positive definite")
        if self.transfer is not None:
            shape = (self.shape_model.modes + 1, len(self.shape_model.mean), 9)
            check_arrays({"transfer": self.transfer}, {"transfer": ("float32 float64", shape)})
            if not math.isfinite(self.transfer.sum(dtype=np.float64)):
                raise ValueError("transfer must be finite")

    @property
    def fingerprint(self) -> str:
        """A short hash of the shapes, so that a dataset is not continued with another class."""
        model, digest = self.shape_model, hashlib.sha256()
        for array in (model.mean, model.basis, model.faces):
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update(str(self.target_height).encode())
        return digest.hexdigest()[:16]

    def save(self, folder: Path) -> None:
        """Write class.json and shape.safetensors into `folder`; other files there stay."""
        model = self.shape_model
        with atomic_write(Path(folder) / "shape.safetensors") as temporary:
            save_file({name: np.ascontiguousarray(getattr(model, name)) for name in _SHAPE}, temporary)
        description: dict[str, Any] = {
            "format": FORMAT,
            "name": self.name,
            "target_height_m": self.target_height,
            "part_names": list(model.part_names),
            "light_prior": {
                "mean": np.round(self.light_prior_mean, 6).tolist(),
                "covariance": np.round(self.light_prior_covariance, 6).tolist(),
            },
        }
        if self.families:
            description["families"] = [asdict(family) for family in self.families]
        with atomic_write(Path(folder) / "class.json") as temporary:
            Path(temporary).write_text(json.dumps(description, indent=1) + "\n")

    @staticmethod
    def load(name_or_folder: str | Path) -> ObjectClass:
        """Read a packaged class by name, or a class pack from a folder. UserError when it is not one."""
        if not isinstance(name_or_folder, str | Path):
            came = type(name_or_folder).__name__
            raise UserError(
                f"expected a class's name or folder; got a {came}. Pass its name, such as 'teapot'."
            )
        folder = Path(name_or_folder)
        if not (folder / "class.json").is_file() and folder.name == str(name_or_folder):
            folder = PACKAGED / folder
        if not (folder / "class.json").is_file():
            known = sorted(path.parent.name for path in PACKAGED.glob("*/class.json"))
            raise UserError(
                f"expected a class, one of {', '.join(known) or 'none packaged'},"
                f" or a folder with class.json; got '{name_or_folder}'. Check the name."
            )
        with reading(folder / "class.json", "the description of a class", _DAMAGED):
            described: _Description = decode(_Description, read_json(folder / "class.json"))
            if described.format != FORMAT:
                raise ValueError(f"it is of format {described.format}, where this vig reads {FORMAT}")
        with reading(folder / "shape.safetensors", "a class's shapes", _DAMAGED):
            arrays, _ = read_tensors(folder / "shape.safetensors")
            check_arrays(arrays, _SHAPE)
            model = ShapeModel(part_names=described.part_names, **{name: arrays[name] for name in _SHAPE})
        transfer = None
        if (folder / TRANSFER_FILE).exists():
            with reading(folder / TRANSFER_FILE, "a class's transfer of light", _DAMAGED):
                held, _ = read_tensors(folder / TRANSFER_FILE)
                shape = (model.modes + 1, len(model.mean), 9)
                check_arrays(held, {"transfer": ("float16 float32", shape)})
                transfer = held["transfer"].astype(np.float32)
        with reading(folder, "a class pack", _DAMAGED):
            prior = described.light_prior
            mean, covariance = np.array(prior.mean, np.float64), np.array(prior.covariance, np.float64)
            height = float(described.target_height_m)
            return ObjectClass(
                described.name, model, height, mean, covariance, folder, transfer, described.families
            )
