"""Where things lie in a dataset folder, in the BOP layout, and what is said of one sample.

A dataset is `D/info.json`, `D/camera.json`, `D/models/` and, for each split, `D/<split>/` with
`latents.parquet`, `specs.jsonl` (one SceneSpec a line), `files.sha256` and the BOP scene `000000/`: `rgb/`,
`depth/` (16 bits, times depth_scale in mm; 0 unknown), `mask/` (the object alone), `mask_visib/`,
`scene_gt.json`, `scene_camera.json`, `scene_gt_info.json`. docs/dataset.md describes every field.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from vig.dataset import bop
from vig.errors import UserError
from vig.files import atomic_write
from vig.scene import IMAGE_SIZE, Latents, ObjectClass
from vig.synthesis.photo import PhotoSettings
from vig.synthesis.picture import Picture
from vig.synthesis.spec import SceneSpec
from vig.synthesis.target import NO_DESIGN
from vig.synthesis.view import View

FORMAT_VERSION = 2
INFO = "info.json"
SCENE = "000000"
MANIFEST = "files.sha256"
"""Lists the hash and the name of every other file of a split, as `sha256sum -c` reads it."""
TABLE = "latents.parquet"
PARTIAL = "partial"
"""Folder of a split that is not complete: one JSON file per finished sample."""


def image_paths(folder: Path, index: int) -> dict[str, Path]:
    """The image files of sample `index` in the split folder: rgb, depth, mask, mask_visib."""
    scene = folder / SCENE
    return {
        "rgb": scene / "rgb" / f"{index:06d}.png",
        "depth": scene / "depth" / f"{index:06d}.png",
        "mask": scene / "mask" / f"{index:06d}_000000.png",
        "mask_visib": scene / "mask_visib" / f"{index:06d}_000000.png",
    }


def sidecar_path(folder: Path, index: int) -> Path:
    """The file that says that sample `index` of a split that is being made is whole."""
    return folder / PARTIAL / f"{index:06d}.json"


def depth_units(depth: np.ndarray) -> np.ndarray:
    """Depth (H, W) metres, inf = unknown, as a depth image holds it: (H, W) uint16, 0 = unknown."""
    scaled = np.where(np.isfinite(depth), depth * (1000 / bop.DEPTH_SCALE), 0.0)
    return np.round(scaled).clip(0, 65535).astype(np.uint16)


def class_fingerprint(object_class: ObjectClass) -> str:
    """A short hash of the shapes of a class, so that a dataset is not continued with another."""
    digest = hashlib.sha256()
    model = object_class.shape_model
    for array in (model.mean, model.basis, model.faces):
        digest.update(np.ascontiguousarray(array).tobytes())
    digest.update(str(object_class.target_height).encode())
    return digest.hexdigest()[:16]


def describe(
    spec: SceneSpec,
    picture: Picture,
    depth: np.ndarray,
    object_class: ObjectClass,
    photo: PhotoSettings | None = None,
) -> dict[str, Any]:
    """All that the merged files say of a sample: keys camera, gt, gt_info (BOP), row (parquet), spec.

    depth: the depth image as stored, see `depth_units`. photo: how the picture was photographed, if it was.
    """
    view = View.of(object_class, spec.azimuth, spec.elevation, IMAGE_SIZE)
    info = bop.visibility(picture.canvas, picture.amodal, picture.visible, depth)
    shares = picture.shares
    latents = spec.latents()
    latents[-len(picture.light) :] = picture.light  # a path tracer's label differs from the spec's light
    named = dict(zip(Latents.names(len(spec.shape)), latents.tolist(), strict=True))
    return {
        "camera": bop.scene_camera(view),
        "gt": [bop.pose(view)],
        "gt_info": [info],
        "row": {
            "index": spec.index,
            "seed": spec.seed,
            **named,
            "occlusion": picture.occlusion,
            "target_occlusion": spec.target,
            "visib_fract": info["visib_fract"],
            **{f"share_{name}": share for name, share in shares.items()},
            "cause": picture.cause,
            "hidden_by": hidden_by(spec),
            "truncated": shares["truncation"] > 0,
            "size": info["px_count_all"] / picture.amodal.size,
            "panorama": spec.panorama,
            "layout": spec.room.layout,
            "zone": spec.room.zone,
            "design": spec.design,
            "assets": assets_used(spec),
            "photo": None if photo is None else json.dumps(asdict(photo)),
        },
        "rejected": spec.rejected,
        "spec": spec.to_json(),
    }


def hidden_by(spec: SceneSpec) -> list[str]:
    """The props that were placed to hide the object, as `family/number`."""
    return [f"{prop.family}/{prop.asset}" for prop in spec.props if prop.role == "occluder"]


def assets_used(spec: SceneSpec) -> list[str]:
    """The names of all assets of a scene, as `split/catalogue/number`, sorted."""
    names = {f"panorama/{spec.panorama}"}
    names |= {f"prop/{prop.family}/{prop.asset}" for prop in spec.props}
    names |= {f"surface/{each.kind}/{each.asset}" for _, each in spec.room.finishes}
    if spec.design != NO_DESIGN:
        names |= {f"design/{spec.design}"}
    return sorted(f"{spec.split}/{name}" for name in names | {f"layout/{spec.room.layout}"})


COLUMNS = (
    "index",
    "seed",
    "occlusion",
    "target_occlusion",
    "visib_fract",
    "share_occluder",
    "share_support",
    "share_truncation",
    "cause",
    "hidden_by",
    "truncated",
    "size",
    "panorama",
    "layout",
    "zone",
    "design",
    "assets",
    "photo",
)
"""The columns of latents.parquet that are no latents."""


def read_info(root: Path) -> dict[str, Any]:
    """The contents of D/info.json. Raises UserError when it is missing or not ours."""
    try:
        info = json.loads((root / INFO).read_text())
        version = info["vig_dataset"]
        splits = info["splits"]
        whole = all(isinstance(each["count"], int) and "complete" in each for each in splits.values())
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UserError(
            f"expected a dataset folder with {INFO}; '{root}' has none that can be read. "
            "Make one with `vig dataset make`."
        ) from error
    if version != FORMAT_VERSION:
        raise UserError(
            f"'{root}' is a dataset of format {version}; this vig reads {FORMAT_VERSION}. Make it again."
        )
    if not whole:
        raise UserError(f"'{root / INFO}' is damaged: a split lacks its count. Make the dataset again.")
    return info


def complete_split(root: Path, split: str | None) -> str:
    """The split that is meant: `split`, or the only complete one when None.

    Raises UserError when it is not there, not complete, or not clear which one is meant.
    """
    splits = read_info(root)["splits"]
    complete = [name for name, held in splits.items() if held["complete"]]
    if split is None:
        if len(complete) == 1:
            return complete[0]
        split = next(iter(splits), "train") if not complete else "train"
    if split not in splits:
        held = ", ".join(splits) or "none"
        raise UserError(f"'{root}' has no {split} split; it has {held}. Choose it or make it.")
    if split not in complete:
        raise UserError(f"the {split} split of '{root}' is not complete; run the command that made it again.")
    return split


def refuse_used(root: Path, out: Path, there: list[Path]) -> None:
    """Refuse to export a dataset into itself, or into a folder where any of `there` exists."""
    used = next((path for path in there if path.exists()), None)
    if out.resolve() == root.resolve() or used is not None:
        reason = "is the dataset itself" if used is None else f"already holds '{used.relative_to(out)}'"
        raise UserError(f"expected a new folder for the export; '{out}' {reason}. Choose another.")


def write_json(path: Path, data: Any) -> bytes:
    """Write JSON atomically; returns the bytes written."""
    written = json.dumps(data).encode()
    write_bytes(path, written)
    return written


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    with atomic_write(path) as temporary:
        temporary.write_bytes(data)
