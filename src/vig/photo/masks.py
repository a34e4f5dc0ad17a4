"""Masks as files have them: which pixels are meant, whose photo a file is of, the box round them."""

import os
import re
from collections import defaultdict
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from vig.io.checks import reading
from vig.io.files import compose_name
from vig.photo.checks import refuse
from vig.photo.images import read_picture

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".gif")
OF_OBJECT = re.compile(r"(.*)_[0-9]{6}\.png", re.DOTALL)
"""BOP's names of masks: number of the photo, of the object."""
REMEDY = "Write 255 where the object is seen, 0 elsewhere."


def box_of(mask: np.ndarray) -> tuple[int, int, int, int] | None:
    """Return x, y, width, height in pixels round the true ones of a mask (H, W) bool; None for none."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return None
    x, y = int(columns[0]), int(rows[0])
    return x, y, int(columns[-1]) + 1 - x, int(rows[-1]) + 1 - y


def bop_box(mask: np.ndarray, origin: tuple[int, int] = (0, 0)) -> list[int]:
    """Return BOP's x, y, width, height of a mask (H, W) whose first pixel is at `origin`; -1s for none."""
    if (box := box_of(mask)) is None:
        return [-1] * 4
    x, y, width, height = box
    # Last minus first column and row: as bop_toolkit's calc_2d_bbox; its detections have COCO's boxes.
    return [x + origin[0], y + origin[1], width - 1, height - 1]


def coco_region(mask: np.ndarray) -> dict[str, Any]:
    """Return COCO's segmentation, bbox and area of a mask (H, W) bool; the box of an empty one is all 0."""
    box = list(box_of(mask) or (0, 0, 0, 0))
    return {"segmentation": run_lengths(mask), "bbox": box, "area": int(np.count_nonzero(mask))}


def run_lengths(mask: np.ndarray) -> dict[str, list[int]]:
    """Return COCO's uncompressed run lengths of a mask (H, W): size and counts, by column, zeros first."""
    pixels = np.asarray(mask, bool).ravel(order="F")
    changes = np.flatnonzero(pixels[1:] != pixels[:-1]) + 1
    ends = np.concatenate([[0] if pixels.size and pixels[0] else [], changes, [pixels.size]])
    return {"size": list(mask.shape), "counts": np.diff(ends, prepend=0).astype(int).tolist()}


def read_mask(path: str | Path) -> np.ndarray:
    """Return a mask (H, W) bool from a picture.

    Any two values mean nothing and the object, the lower one nothing if it is 0; further ones
    are shades, of which those above half are the object. In colours and palettes black is nothing. A
    picture that is transparent in places is a cut-out: its opaque pixels are the object.

    Raises:
        UserError: It cannot be read, marks several objects, or is ambiguous.
    """
    return read_picture(path, "mask", mask_of_picture)


def mask_of_picture(path: Path, image: Image.Image) -> np.ndarray:
    """Read the mask of an opened picture; errors name the path."""
    image.load()
    alpha = None
    if image.has_transparency_data:
        image = image.convert("RGBA" if image.mode in ("RGB", "RGBA", "P") else "LA")
        alpha = np.asarray(image.getchannel("A"))
        image = image.convert("RGB" if image.mode == "RGBA" else "L")
    if image.mode in ("P", "CMYK", "YCbCr", "LAB", "HSV"):
        image = image.convert("RGB")
    values = np.asarray(image)
    if values.ndim == 3:
        red, green, blue = np.moveaxis(values[..., :3], -1, 0)
        if not ((red == green).all() and (green == blue).all()):  # each of several objects in its colour?
            packed = red.astype(np.uint32) << 16 | green.astype(np.uint16) << 8 | blue
            colours = np.unique(packed[packed > 0])
            # 64: colours besides black up to which they are those of objects, not the shades of an edge
            if 1 < len(colours) <= 64:
                refuse(path, "a mask of one object", f"{len(colours)} colours", REMEDY)
        values = values.max(2)
    if alpha is None or (alpha == 255).all():
        return _by_value(path, values)
    by_alpha: np.ndarray = alpha > 127
    shades = np.unique(values)
    if len(shades) == 2 and shades[0] == 0:  # a mask by its colours, too
        is_object = values > 0
        if by_alpha.any() and (is_object & by_alpha).sum() not in (is_object.sum(), by_alpha.sum()):
            refuse(path, "a mask", "one whose colours and transparency say different things", REMEDY)
        return np.asarray(is_object & by_alpha)
    return by_alpha


def _by_value(path: Path, values: np.ndarray) -> np.ndarray:
    if values.dtype == bool:
        return values
    shades = np.unique(values)
    if len(shades) == 1:
        return np.full(values.shape, bool(shades[0]))
    if shades[0] == 0 and len(shades) == 2:
        return np.asarray(values > 0)
    # 32: values up to which numbers in a mask are those of objects, not shades
    if not np.issubdtype(values.dtype, np.floating) and shades[-1] <= 32:
        received = (
            f"the numbers {', '.join(map(str, shades[:6].tolist()))}{' ...' if len(shades) > 6 else ''}"
        )
        refuse(path, "a mask of one object", received, REMEDY)
    most = 1.0 if shades[-1] <= 1 else 255 if shades[-1] <= 255 else 65535
    return np.asarray(values > most / 2)


def mask_files(folder: Path, photos: Iterable[Path]) -> list[Path]:
    """Return the file of each photo's mask in a folder, of which a listing is made once.

    Named like the photo in any Unicode composition, with any picture's ending or behind the photo's own
    (COLMAP), with `_mask` or `mask_`, in a folder named as the photo's, or with the number of its one object
    (BOP).

    Raises:
        UserError: BOP has several objects in a photo.
    """
    of_objects = defaultdict[str, list[Path]](list)

    @cache
    def listing(parent: Path) -> dict[str, Path]:
        """Return the paths in a folder by `_key` of their names."""
        with reading(parent, "a folder of masks", "Name another."):
            return {_key(path.name): path for path in parent.iterdir()}

    for name, path in listing(folder).items():
        if numbered := OF_OBJECT.fullmatch(name):
            of_objects[numbered[1]].append(path)

    @cache
    def listings(parent: Path) -> list[tuple[dict[str, Path], bool]]:
        """Return folders with masks of the photos in a folder, and whether each is the photos' own."""
        parts = parent.resolve().parts
        inner = [folder.joinpath(*parts[len(parts) - depth :]) for depth in (2, 1)]
        return [(listing(each), each.resolve().parts == parts) for each in (*inner, folder) if each.is_dir()]

    def mask_file(photo: Path) -> Path:
        stem, own = compose_name(photo.stem), _key(photo.name)
        words = (stem, own, f"{stem}_mask", f"{stem}-mask", f"mask_{stem}")
        for files, are_photos in listings(photo.parent):
            for name in (own, *(word + suffix for word in words for suffix in SUFFIXES)):
                if name in files and not (are_photos and files[name].name == photo.name):
                    return files[name]
        numbered = sorted(of_objects[stem])
        if len(numbered) > 1:
            received = f"{len(numbered)}, {numbered[0].name} ... {numbered[-1].name}"
            refuse(folder, f"one mask of {photo.name}", received, "Name that of the object with --mask.")
        return numbered[0] if numbered else folder / f"{photo.stem}.png"

    return [mask_file(photo) for photo in photos]


def _key(name: str) -> str:
    """Return a name whose composition and whose ending's case make no difference."""
    stem, ending = os.path.splitext(compose_name(name))
    return stem + ending.lower()
