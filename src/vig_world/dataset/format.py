"""Layout of a dataset folder, that of BOP, and the descriptions of its files.

A dataset is `D/info.json`, `D/camera.json`, `D/models/` and, for each split, `D/<split>/` with
`latents.parquet`, `specs.jsonl` (one SceneSpec a line), `files.sha256` and the BOP scene `000000/`: `rgb/`,
`depth/` (16 bits, times depth_scale in mm; 0 unknown), `mask/` (the object alone), `mask_visib/`,
`normal/` where it was asked for, `scene_gt.json`, `scene_camera.json`, `scene_gt_info.json`. docs/dataset.md
describes every field.
"""

import os
from pathlib import Path
from typing import Any

from vig.io.checks import decode, read_json, reading
from vig.io.errors import UserError
from vig.scene import IMAGE_SIZE
from vig_world import World
from vig_world.dataset.spec import SPLITS

FORMAT_VERSION = 3
DEPTH_SCALES = (0.1, 0.2, 0.5, 1.0)
"""Millimetres per unit of a depth image: the finest that holds its farthest surface."""
MAX_DEPTH = 65535  # value, in units, of surfaces beyond the range of the coarsest
OBJECT_ID = 1  # identifier of the one object, in BOP's and COCO's files
MAX_SAMPLES = 1_000_000  # files are numbered with six digits
Size = tuple[int, int]  # width and height of pictures, pixels
STANDARD_SIZE: Size = (IMAGE_SIZE, IMAGE_SIZE)
MIN_SIDE, MAX_SIDE, MAX_ASPECT = 32, 4096, 4.0
"""Pixels of a side of pictures; the longer side over the shorter one."""
PICTURE_MODES = {"rgb": "RGB", "depth": "I;16", "mask": "L", "mask_visib": "L", "normal": "RGB"}
REMEDY = "Make the dataset again."
INFO = "info.json"
SCENE = "000000"
MANIFEST = "files.sha256"
"""Lists the hash and the name of every other file of a split, as `sha256sum -c` reads it."""
TABLE = "latents.parquet"
PARTIAL = "partial"  # folder of a split that is not complete: one JSON file per finished sample


def image_paths(folder: Path, index: int, normals: bool = False) -> dict[str, Path]:
    """Return the image files of sample `index` in the split: rgb, depth, mask, mask_visib; normal, if any."""
    scene = folder / SCENE
    paths = {
        "rgb": scene / "rgb" / f"{index:06d}.png",
        "depth": scene / "depth" / f"{index:06d}.png",
        "mask": scene / "mask" / f"{index:06d}_000000.png",
        "mask_visib": scene / "mask_visib" / f"{index:06d}_000000.png",
    }
    return paths | ({"normal": scene / "normal" / f"{index:06d}.png"} if normals else {})


def most_bytes(size: Size) -> int:
    """Return bytes of an image file of that size; one that cannot be compressed at all has less."""
    return max(1 << 20, 4 * size[0] * size[1])


def check_size(size: Size) -> None:
    """Raise UserError for a size of pictures that no dataset has."""
    shorter, longer = sorted(size)
    if not (MIN_SIDE <= shorter and longer <= min(MAX_SIDE, MAX_ASPECT * shorter)):
        raise UserError(
            f"expected a size of {MIN_SIDE} to {MAX_SIDE} pixels a side, at most {MAX_ASPECT:g} times as"
            f" long as wide; got {size[0]}x{size[1]}. Choose another, such as 640x480."
        )


COLUMNS = {
    **dict.fromkeys(("index", "seed", "panorama", "layout", "design"), "int64"),
    **dict.fromkeys(("occlusion", "target_occlusion", "visib_fract", "size", "roll"), "double"),
    **dict.fromkeys(("share_occluder", "share_support", "share_truncation"), "double"),
    **dict.fromkeys(("cause", "zone", "finish", "photo"), "string"),
    **dict.fromkeys(("hidden_by", "assets"), "list"),
    "truncated": "bool",
}
"""Columns of latents.parquet that are no latents, with Arrow's names of their types; lists are of strings."""


def read_info(root: Path) -> dict[str, Any]:
    """Return the contents of D/info.json. Raises UserError when it is missing or not ours."""
    with reading(root, f"a dataset folder with {INFO}", "Make one with `vig dataset make`."):
        info: dict[str, Any] = read_json(root / INFO)
        version = decode(int, info["vig_dataset"])
        if version == FORMAT_VERSION:
            splits = decode(dict[str, dict[str, Any]], info["splits"])
            if not splits.keys() <= set(SPLITS):
                raise ValueError(f"splits are {', '.join(SPLITS)}; it has others")
            info["splits"] = splits
            for settings in splits.values():
                settings.setdefault("size", list(STANDARD_SIZE))  # splits of before there were others
                settings.setdefault("normals", False)
                _check_settings(settings)
    if version != FORMAT_VERSION:
        raise UserError(
            f"'{root}' is a dataset of format {version}; this vig reads {FORMAT_VERSION}. Make it again."
        )
    return info


_SETTINGS = {
    "class": str,
    "class_fingerprint": str,
    "seed": int,
    "count": int,
    "tier": str,
    "options": dict[str, Any],
    "photo": bool,
    "world": World,
    "own_assets": dict[str, str],
    "world_version": int,
    "size": Size,
    "normals": bool,
    "complete": bool,
}
_COMPLETE = {"rejections": dict[str, int], "rejections_per_sample": float, "manifest_sha256": str}


def _check_settings(settings: dict[str, Any]) -> None:
    """Raise ValueError or KeyError unless the settings of a split in info.json are valid."""
    wanted = _SETTINGS | (_COMPLETE if settings["complete"] is True else {})
    for name, kind in wanted.items():
        try:
            decode(kind, settings[name])
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
    if not 1 <= settings["count"] <= MAX_SAMPLES:
        raise ValueError(f"count must be from 1 to {MAX_SAMPLES}; it is {settings['count']}")
    check_size(tuple(settings["size"]))
    if not settings["class"].isprintable() or set(settings["class"]) & set("/\\"):
        raise ValueError("class must be a name without slashes")


def complete_split(root: Path, split: str | None) -> str:
    """Return the split that is meant: `split`, or the only complete one when None.

    Raises UserError when it is not there, not complete, or not clear which one is meant.
    """
    splits = read_info(root)["splits"]
    complete: list[str] = [name for name, held in splits.items() if held["complete"]]
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


def inside(folder: str | Path, name: str | Path) -> Path:
    """Return the path of a file that data name, which must lie in `folder`. ValueError when it does not.

    Absolute names, names with `..` and symbolic links that lead out of the folder are refused.
    """
    named, root = Path(name), os.path.realpath(folder)
    if named.is_absolute() or ".." in named.parts or "\0" in str(name):
        raise ValueError(f"the name '{name}' leads out of its folder")
    if not os.path.realpath(os.path.join(root, named)).startswith(os.path.join(root, "")):
        raise ValueError(f"'{name}' is a link that leads out of its folder")
    return Path(folder) / named
