"""A class of objects as a folder of data (a class pack): no code, no pickle."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from vig.errors import UserError
from vig.files import atomic_write
from vig.scene.designs import HeldOutDesigns
from vig.scene.shape_model import ShapeModel

TRANSFER_FILE = "transfer.safetensors"
DESIGNS_FILE = "designs.safetensors"
PACKAGED = Path(__file__).parents[1] / "classes"


@dataclass(frozen=True, eq=False)
class ObjectClass:
    """What is known of a class before any photo.

    target_height: metres above the base at which the camera looks. light_prior_mean (9,) and
    light_prior_covariance (9, 9): a Gaussian over SH lights in the world frame at the paper's exposure.
    folder: where it was read from, None when built in memory. transfer (K + 1, V, 9), or None: how
    self-shadow and light thrown from part to part change the nine lobes of each vertex, for the mean shape
    and per component (`vig_world.packs.transfer`). designs: of test and validation scenes, if the class has
    any held out.
    """

    name: str
    shape_model: ShapeModel
    target_height: float
    light_prior_mean: np.ndarray
    light_prior_covariance: np.ndarray
    folder: Path | None = None
    transfer: np.ndarray | None = None
    designs: HeldOutDesigns | None = None

    def save(self, folder: Path) -> None:
        """Write class.json and shape.safetensors into `folder`; other files there stay."""
        model = self.shape_model
        with atomic_write(Path(folder) / "shape.safetensors") as temporary:
            save_file(
                {
                    "mean": model.mean,
                    "basis": np.ascontiguousarray(model.basis),
                    "faces": model.faces,
                    "parts": model.parts,
                    "explained_variance_ratio": model.explained_variance_ratio,
                },
                temporary,
            )
        description: dict[str, Any] = {
            "format": 1,
            "name": self.name,
            "target_height_m": self.target_height,
            "part_names": list(model.part_names),
            "light_prior": {
                "mean": np.round(self.light_prior_mean, 6).tolist(),
                "covariance": np.round(self.light_prior_covariance, 6).tolist(),
            },
        }
        if self.designs is not None:
            held = zip(self.designs.names, self.designs.splits, strict=True)
            description["held_out_designs"] = [{"name": name, "split": split} for name, split in held]
            with atomic_write(Path(folder) / DESIGNS_FILE) as temporary:
                save_file({"vertices": self.designs.vertices}, temporary)
        with atomic_write(Path(folder) / "class.json") as temporary:
            Path(temporary).write_text(json.dumps(description, indent=1) + "\n")

    @staticmethod
    def load(name_or_folder: str | Path) -> ObjectClass:
        """Read a packaged class by name, or a class pack from a folder. UserError when it is not one."""
        folder = Path(name_or_folder)
        if not (folder / "class.json").is_file() and folder.name == str(name_or_folder):
            folder = PACKAGED / folder
        if not (folder / "class.json").is_file():
            known = sorted(path.parent.name for path in PACKAGED.glob("*/class.json"))
            raise UserError(
                f"expected a class, one of {', '.join(known) or 'none packaged'},"
                " or a folder with class.json;"
                f" got '{name_or_folder}'"
            )
        try:
            description = json.loads((folder / "class.json").read_text())
            arrays = load_file(folder / "shape.safetensors")
            prior = description["light_prior"]
            transfer = None
            if (folder / TRANSFER_FILE).is_file():
                transfer = load_file(folder / TRANSFER_FILE)["transfer"].astype(np.float32)
            designs = None
            if held := description.get("held_out_designs"):
                designs = HeldOutDesigns(
                    tuple(each["name"] for each in held),
                    tuple(each["split"] for each in held),
                    load_file(folder / DESIGNS_FILE)["vertices"],
                )
            return ObjectClass(
                description["name"],
                ShapeModel(
                    arrays["mean"],
                    arrays["basis"],
                    arrays["faces"],
                    arrays["parts"],
                    tuple(description["part_names"]),
                    arrays["explained_variance_ratio"],
                ),
                float(description["target_height_m"]),
                np.array(prior["mean"]),
                np.array(prior["covariance"]),
                folder,
                transfer,
                designs,
            )
        except (OSError, ValueError, KeyError, TypeError, SafetensorError) as error:
            raise UserError(
                f"the class pack '{folder}' is damaged: {error}; build or copy it again"
            ) from error
