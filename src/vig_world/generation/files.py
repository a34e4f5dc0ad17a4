"""Files of a dataset that only its maker, its checks and its exports touch."""

import json
from pathlib import Path
from typing import Any

from vig.io.checks import decode, read_json
from vig.io.errors import UserError
from vig.io.files import write_bytes
from vig_world.dataset.format import PARTIAL, SCENE, inside


def sidecar_path(folder: Path, index: int) -> Path:
    """Return the file that marks sample `index` of an unfinished split as complete."""
    return folder / PARTIAL / f"{index:06d}.json"


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


def write_picture(path: Path, data: bytes) -> None:
    """Write a file of a sample, which counts only once its sidecar is there: half of it may stay, until then.

    A new file takes a third of the time of one that is renamed.
    """
    try:
        with open(path, "xb", buffering=0) as file:
            if file.write(data) == len(data):
                return
    except OSError:
        pass
    write_bytes(path, data)  # makes folders, replaces files of a killed run, and reports errors


def read_scene(folder: Path, count: int) -> list[dict[str, Any]]:
    """Return BOP's entries of each of `count` samples: camera, gt and gt_info. ValueError when damaged."""
    tables = {}
    for key in ("camera", "gt", "gt_info"):
        table = read_json(inside(folder, f"{SCENE}/scene_{key}.json"), 4096 * count)  # bytes
        kind = dict[str, dict[str, Any]] if key == "camera" else dict[str, tuple[dict[str, Any], ...]]
        decode(kind, table)
        if len(table) != count:
            raise ValueError(f"scene_{key}.json has {len(table)} entries for {count} samples")
        tables[key] = table
    return [{key: table[str(index)] for key, table in tables.items()} for index in range(count)]
