"""The table of a run: written, read, and turned into the result files of BOP and COCO."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path, PurePath
from typing import Any

import numpy as np
from PIL import Image

from vig.io.checks import read_json, reading
from vig.io.files import atomic_write
from vig_app.exports import MILLIMETRES, OBJECT_ID, bop_box, run_lengths

TABLE = "results"
TABLES = (f"{TABLE}.csv", f"{TABLE}.parquet")
COLUMNS = (
    "photo", "folder", "object", "class", "error", "verdict", "view_trusted", "mask_trusted", "confidence",
    "mask_confidence", "azimuth_deg", "elevation_deg", "roll_deg", "azimuth_deviation_deg",
    "elevation_deviation_deg", "hidden_fraction", "family", "albedo_r", "albedo_g", "albedo_b", "box_x",
    "box_y", "box_width", "box_height", "width", "height", "focal_px", "center_x", "center_y", "focal_from",
    *(POSE := [f"camera_from_object_{row}{column}" for row in range(3) for column in range(4)]), "reason",
    "seconds",
)  # fmt: skip
"""Of the table; docs/many.md describes them."""
TRACK = "track"
TRACK_COLUMNS = (
    "photo", "folder", "frame", "lost", "refitted", "alone_azimuth_deg", "azimuth_deg",
    "azimuth_deviation_deg", "alone_elevation_deg", "elevation_deg", "elevation_deviation_deg", "roll_deg",
    "hidden_fraction", "focal_px", "center_x", "center_y", *POSE,
)  # fmt: skip
"""Of the table of a track, likewise."""

TEXTS = {"photo", "folder", "class", "error", "verdict", "family", "focal_from", "reason"}
NUMBERED = (r"([0-9]+)/(?:rgb|gray)/([0-9]+)", r"()(?:^|/)([0-9]+)", r"()(?:^|/|[^0-9])([0-9]{1,18})")
"""Ends of paths that number scene and image: BOP's; files named by a number, or with one at the end."""


def name_of(row: Mapping[str, Any]) -> str:
    """The photo's name, and which of its objects a row is of where it has several."""
    _, several, which = row["folder"].partition("/")
    return PurePath(row["photo"]).name + (f" {which}" if several else "")


def write_table(
    out: Path, rows: Iterable[dict[str, Any]], table: str = TABLE, columns: Sequence[str] = COLUMNS
) -> list[Path]:
    """Write results.csv, and results.parquet where pyarrow is installed; returns what was written."""
    rows = [{name: row.get(name) for name in columns} for row in rows]
    with (
        atomic_write(out / f"{table}.csv") as temporary,
        open(temporary, "w", newline="", encoding="utf-8", errors="replace") as file,
    ):
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)
    written = [out / f"{table}.csv"]
    with suppress(ImportError):
        import pyarrow
        from pyarrow import parquet

        arrays = {name: pyarrow.array([_text(row[name]) for row in rows], _kind(name)) for name in columns}
        with atomic_write(out / f"{table}.parquet") as temporary:
            parquet.write_table(pyarrow.table(arrays), temporary)
        written.append(out / f"{table}.parquet")
    return written


def read_results(folder: str | Path) -> list[dict[str, Any]]:
    """The rows of results.csv with numbers, truth values and None, as `pandas.DataFrame` takes them.

    Args:
        folder: That of `vig fit` of several photos.

    Raises:
        UserError: There is no such table, or it is damaged.
    """
    path = Path(folder) / TABLES[0]
    with reading(path, "the table of `vig fit` of several photos", "Name the folder of its results."):
        with open(path, encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        return [{name: _value(name, row[name]) for name in COLUMNS} for row in rows]


def bop_csv(folder: str | Path, path: str | Path, object_id: int = OBJECT_ID) -> Path:
    """Write the poses of a run as BOP's evaluation reads them: scene_id,im_id,obj_id,score,R,t,time.

    Scene and image are numbered by the photos' paths, `.../000001/rgb/000003.png`, where all have such; else
    by files' names that are numbers; else the scene is 0 and the image the photo's place among the photos.
    Translations are in millimetres, poses those before the camera that took the photo (see
    `Explanation.pinhole_pose`), and the score is the confidence, 1 where none was learned.

    Args:
        folder: Of the run.
        path: Of the file.
        object_id: Of the class in the dataset; where there are several classes that of the first by name,
            the others follow.

    Returns:
        The path.

    Raises:
        UserError: The results cannot be read or the file not be written.
    """
    rows = read_results(folder)
    scenes, number = _numbers([row["photo"] for row in rows]), _of_classes(rows, object_id)
    with atomic_write(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        print("scene_id,im_id,obj_id,score,R,t,time", file=file)
        for row in rows:
            if row["error"] is not None or row["verdict"] == "absent":
                continue
            pose = _pose_of_photo(Path(folder) / row["folder"] / "explanation.json")
            turn = " ".join(f"{number:.8g}" for number in pose[:3, :3].ravel())
            place = " ".join(f"{MILLIMETRES * number:.8g}" for number in pose[:3, 3])
            scene, image = scenes[row["photo"]]
            print(
                f"{scene},{image},{number[row['class']]},{_score(row)},{turn},{place},{row['seconds']}",
                file=file,
            )
    return Path(path)


def coco_json(folder: str | Path, path: str | Path, category_id: int = OBJECT_ID) -> Path:
    """Write the visible masks of a run as a COCO result file, which `COCO.loadRes` reads.

    A list of `{image_id, category_id, segmentation, bbox, score, file_name}`: run lengths of the pixels in
    which the object is seen, and the box round them; photos in which nothing of it is seen are left out.
    Images are numbered by files' names that are numbers, as COCO's are; else by their place.

    Args:
        folder: Of the run.
        path: Of the file.
        category_id: As `object_id` in `bop_csv`.

    Returns:
        The path.

    Raises:
        UserError: The results cannot be read or the file not be written.
    """
    rows = read_results(folder)
    images, number = _numbers([row["photo"] for row in rows], NUMBERED[1:]), _of_classes(rows, category_id)
    with atomic_write(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        before = "["
        for row in rows:
            if row["error"] is not None or row["verdict"] == "absent":
                continue
            picture = Path(folder) / row["folder"] / "mask.png"
            with reading(picture, "a mask of `vig fit`", "Fit the photo again."), Image.open(picture) as mask:
                seen = np.asarray(mask) == 255
            if seen.any():
                found = {
                    "image_id": images[row["photo"]][1],
                    "category_id": number[row["class"]],
                    "segmentation": run_lengths(seen),
                    "bbox": bop_box(seen),
                    "score": _score(row),
                    "file_name": PurePath(row["photo"]).name,
                }
                print(before, json.dumps(found), end="", file=file)
                before = ",\n"
        print("]" if before != "[" else "[]", file=file)
    return Path(path)


def _numbers(photos: Sequence[str], patterns: Sequence[str] = NUMBERED) -> dict[str, tuple[int, int]]:
    """Scene and image of each photo: from the paths where those of all fit and differ, else by place."""
    each = list(dict.fromkeys(photos))
    for pattern in patterns:
        ends = [re.search(rf"{pattern}\.\w+$", PurePath(photo).as_posix()) for photo in each]
        found = [(int(end[1] or 0), int(end[2])) for end in ends if end is not None]
        if len(set(found)) == len(each):
            return dict(zip(each, found, strict=True))
    return {photo: (0, number) for number, photo in enumerate(each)}


def _of_classes(rows: Sequence[dict[str, Any]], first: int) -> dict[str, int]:
    names = sorted({row["class"] for row in rows if row["class"] is not None})
    return {name: first + place for place, name in enumerate(names)}


def _pose_of_photo(path: Path) -> np.ndarray:
    """The pose (4, 4) before the photo's own camera, as `Explanation.pinhole_pose` has it."""
    with reading(path, "an explanation of `vig fit`", "Fit the photo again."):
        pose = np.array(read_json(path)["pinhole"]["camera_from_object"], float)
        if pose.shape != (4, 4):
            raise ValueError(f"its pose has the shape {pose.shape}")
        return pose


def _score(row: dict[str, Any]) -> float:
    return 1.0 if row["confidence"] is None else row["confidence"]


def _value(name: str, text: str) -> Any:
    """What a cell of results.csv stands for."""
    if text == "" or name in TEXTS:
        return text or None
    return text == "True" if name.endswith("_trusted") else float(text)


def _text(value: Any) -> Any:
    """Text as UTF-8 has it: file names may hold other bytes."""
    return value.encode("utf-8", "replace").decode() if isinstance(value, str) else value


def _kind(name: str) -> Any:
    """A column's type, the same whatever the rows are, so that tables of several runs can be joined."""
    import pyarrow

    if name in TEXTS:
        return pyarrow.string()
    return pyarrow.bool_() if _is_truth(name) else pyarrow.float64()


def _is_truth(name: str) -> bool:
    return name.endswith("_trusted") or name in ("lost", "refitted")
