"""Datasets as Ultralytics' networks read them: boxes and keypoints in text files, one beside each image."""

import json
from pathlib import Path

from vig.io.errors import UserError
from vig.io.files import write_bytes
from vig.photo.masks import box_of
from vig.scene import ObjectClass
from vig_world.dataset.read import read_dataset
from vig_world.dataset.spec import SPLITS
from vig_world.generation.coco import copy_image
from vig_world.generation.files import refuse_used
from vig_world.generation.keypoints import class_of_keypoints, keypoints, mirror_order, names_of

DESCRIPTION = "data.yaml"
USES = {"train": ("train", "validation", "test"), "val": ("validation", "test", "train"), "test": ("test",)}
"""Ultralytics' names of splits, and the splits that serve: the first that exists."""


def export_yolo_pose(
    root: str | Path, out: str | Path, split: str | None = None, object_class: ObjectClass | None = None
) -> Path:
    """Write `out/images/<split>/*.png`, `out/labels/<split>/*.txt` and `out/data.yaml`.

    A line of a label is: class 0; x and y of the middle, width and height of the visible part's box; x, y
    and visibility (0, 1 or 2) of each keypoint. All are shares of the image's width or height. An unseen
    object has an empty file. Splits exported into one folder share `data.yaml`.

    Returns `out`. Raises UserError when there is no such dataset, its class is another, `out` is the dataset
    or holds an export of that split, or a file cannot be read or written.
    """
    root, out = Path(root), Path(out)
    dataset = read_dataset(root, split)
    split = dataset.folder.name
    object_class = class_of_keypoints(root, split, object_class)
    refuse_used(root, out, [out / "images" / split, out / "labels" / split])
    _description(out, object_class)  # refuses a folder of another class
    width, height = dataset.size
    for index, located in enumerate(keypoints(dataset, object_class, range(len(dataset)))):
        x, y, w, h = box_of(dataset.read("mask_visib", [index])[0]) or (0, 0, 0, 0)
        box = [(x + w / 2) / width, (y + h / 2) / height, w / width, h / height]
        points = [f"{px / width:.6f} {py / height:.6f} {seen}" for px, py, seen in located.rows()]
        line = " ".join(["0", *(f"{number:.6f}" for number in box), *points]) + "\n"
        write_bytes(out / "labels" / split / f"{index:06d}.txt", (line if w else "").encode())
        copy_image(dataset, index, out / "images" / split / f"{index:06d}.png")
    write_bytes(out / DESCRIPTION, _description(out, object_class).encode())
    return out


def _description(out: Path, object_class: ObjectClass) -> str:
    """Return data.yaml for the splits that are in `out`, whose paths are relative to the file.

    Raises UserError when the one that is there is of another class.
    """
    names = names_of(object_class)
    flipped = mirror_order(object_class)
    body = "".join(
        f"{key}: {json.dumps(value)}\n"
        for key, value in {
            "kpt_shape": [len(names), 3],
            "flip_idx": flipped,
            "names": [object_class.name],
            "kpt_names": {"0": list(names)},
        }.items()
        if value is not None
    )
    path = out / DESCRIPTION
    if path.exists() and not path.read_bytes().endswith(body.encode()):
        raise UserError(f"expected a new folder for the export; '{out}' holds one of another class.")
    there = [split for split in SPLITS if (out / "labels" / split).is_dir()]
    lines = []
    for use, splits in USES.items():
        serving = next((split for split in splits if split in there), None)
        if serving is not None:
            stands_in = "" if serving == splits[0] else f" # in place of {splits[0]}, which is not here"
            lines.append(f"{use}: images/{serving}{stands_in}\n")
    return "".join(lines) + body
