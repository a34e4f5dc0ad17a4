"""YOLO as Ultralytics reads it: the folders yolo/segments (visible pixels) and yolo/boxes (whole objects).

Photos are linked, every fifth is for validation. A single explanation has one photo, which is for training.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path

import numpy as np

from vig.io.files import write_bytes
from vig.photo.masks import box_of
from vig_app.exports.annotations import AnnotatedPhoto, Annotation, polygons_of

FILES = tuple(
    f"yolo/{kind}/{file}"
    for kind in ("segments", "boxes")
    for file in ("data.yaml", "labels/train/*.txt", "labels/val/*.txt", "images/train/*", "images/val/*")
)
EVERY = 5  # one photo of so many is for validation


def write_photos(folder: Path, photos: Sequence[AnnotatedPhoto], class_ids: Mapping[str, int]) -> None:
    """Write a folder for polygons and one for boxes, each with data.yaml, labels and linked photos."""
    first = min(class_ids.values(), default=0)
    for old in chain.from_iterable(map(folder.glob, FILES)):
        old.unlink()
    for place, photo in enumerate(photos):
        split = "val" if place % EVERY == EVERY - 1 or place == len(photos) - 1 > 0 else "train"
        lines: dict[str, list[str]] = {"segments": [], "boxes": []}
        for each in photo.read():
            for kind, numbers in (("segments", segment(each)), ("boxes", box(each))):
                if numbers.size:
                    scaled = (numbers / photo.size).clip(0, 1).ravel().tolist()
                    row = " ".join(f"{number:.6g}" for number in scaled)
                    lines[kind].append(f"{class_ids[each.category] - first} {row}\n")
        for kind, rows in lines.items():
            write_bytes(folder / f"yolo/{kind}/labels/{split}/{photo.stem}.txt", "".join(rows).encode())
            if photo.path is not None and photo.path.exists():
                link = folder / f"yolo/{kind}/images/{split}/{photo.stem}{photo.path.suffix}"
                link.parent.mkdir(parents=True, exist_ok=True)
                with suppress(FileExistsError):
                    link.symlink_to(os.path.relpath(photo.path.resolve(), link.parent.resolve()))
    names = "".join(f"  {number - first}: {name}\n" for name, number in class_ids.items())
    described = f"train: images/train\nval: images/val\nnames:\n{names}".encode()
    for kind in ("segments", "boxes"):
        write_bytes(folder / f"yolo/{kind}/data.yaml", described)


def segment(each: Annotation) -> np.ndarray:
    """Return one polygon (N, 2) of the visible pixels, whose pieces are joined by lines there and back."""
    pieces = polygons_of(each.visible)
    closed = [np.concatenate([piece, piece[:1]]) for piece in pieces]
    return np.concatenate([*closed, *(piece[:1] for piece in pieces[-2::-1])]) if pieces else np.empty((0, 2))


def box(each: Annotation) -> np.ndarray:
    """Return the centre and size, (2, 2), of the box of the whole object."""
    x, y, width, height = box_of(each.amodal) or (0, 0, 0, 0)
    return np.array([[x + width / 2, y + height / 2], [width, height]])
