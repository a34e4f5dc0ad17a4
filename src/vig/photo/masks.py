"""Masks as files have them: which pixels are meant, whose photo a file is of, the box round them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from vig.io.errors import UserError
from vig.photo.checks import check_size, existing_file, refuse
from vig.photo.decoding import opened

MOST_LABELS = 32
"""Values up to which numbers in a mask are those of objects, not shades."""
MOST_COLOURS = 64
"""Colours beside black up to which they are those of objects, not the shades of an edge."""
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".gif")
REMEDY = "Write 255 where the object is seen, 0 elsewhere."


def box_of(mask: np.ndarray) -> tuple[int, int, int, int] | None:
    """x, y, width, height in pixels round the true ones of a mask (H, W) bool; None for none."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return None
    x, y = int(columns[0]), int(rows[0])
    return x, y, int(columns[-1]) + 1 - x, int(rows[-1]) + 1 - y


def read_mask(path: str | Path) -> np.ndarray:
    """A mask (H, W) bool from a picture.

    Two values mean nothing and the object, whatever they are, the lower one nothing if it is 0; further ones
    are shades, of which those above half are the object. Of colours and of a palette black is nothing. A
    picture that is transparent in places is a cut-out: what is opaque is the object.

    Raises:
        UserError: It cannot be read, marks several objects, or says two things at once.
    """
    path = existing_file(path)
    try:
        with opened(path) as image:
            check_size(path, *image.size)
            image.load()
    except UserError:
        raise
    except (OSError, SyntaxError, ValueError) as error:
        refuse(path, "a mask", f"no readable picture ({error})", "Save it as PNG.")
    return mask_of_picture(path, image)


def mask_of_picture(path: Path, image: Image.Image) -> np.ndarray:
    """`read_mask` of an opened picture; errors name the path."""
    alpha = None
    if image.has_transparency_data:
        image = image.convert("RGBA" if image.mode in ("RGB", "RGBA", "P") else "LA")
        alpha = np.asarray(image.getchannel("A"))
        image = image.convert("RGB" if image.mode == "RGBA" else "L")
    if image.mode in ("P", "CMYK", "YCbCr", "LAB", "HSV"):
        image = image.convert("RGB")
    values = np.asarray(image)
    if values.ndim == 3:
        _check_colours(path, values)
        values = values.max(2)
    by_value = _by_value(path, values) if alpha is None or (alpha == 255).all() else None
    if by_value is not None:
        return by_value
    assert alpha is not None
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
    if not np.issubdtype(values.dtype, np.floating) and shades[-1] <= MOST_LABELS:
        received = (
            f"the numbers {', '.join(map(str, shades[:6].tolist()))}{' ...' if len(shades) > 6 else ''}"
        )
        refuse(path, "a mask of one object", received, REMEDY)
    most = 1.0 if shades[-1] <= 1 else 255 if shades[-1] <= 255 else 65535
    return np.asarray(values > most / 2)


def _check_colours(path: Path, values: np.ndarray) -> None:
    """UserError for a picture of several objects, each in a colour of its own."""
    flat = values[..., :3].reshape(-1, 3)
    packed = flat.astype(np.int64) @ np.array([1 << 16, 1 << 8, 1])
    colours = np.unique(packed[packed > 0])
    grey = (flat == flat[:, :1]).all()
    if 1 < len(colours) <= MOST_COLOURS and not grey:
        refuse(path, "a mask of one object", f"{len(colours)} colours", REMEDY)


def mask_file(folder: Path, photo: Path) -> Path:
    """The file of a photo's mask in a folder.

    Named as the photo is, with any picture's ending or behind the photo's own (COLMAP), with `_mask` or
    `mask_`, in a folder named as the photo's, or with the number of its one object (BOP).

    Raises:
        UserError: There is none, or BOP has several objects in the photo.
    """
    names = [photo.name, *(f"{photo.stem}{suffix}" for suffix in SUFFIXES)]
    names += [f"{photo.name}{suffix}" for suffix in SUFFIXES]
    names += [f"{word}{suffix}" for word in (f"{photo.stem}_mask", f"{photo.stem}-mask", f"mask_{photo.stem}")
              for suffix in SUFFIXES]  # fmt: skip
    parents = photo.resolve().parent.parts
    for depth in (2, 1, 0):
        inner = folder.joinpath(*parents[len(parents) - depth :]) if depth else folder
        for name in names:
            path = inner / name
            if path.exists() and path.resolve() != photo.resolve():
                return path
    of_objects = sorted(folder.glob(f"{glob_escaped(photo.stem)}_[0-9][0-9][0-9][0-9][0-9][0-9].png"))
    if len(of_objects) == 1:
        return of_objects[0]
    if of_objects:
        received = f"{len(of_objects)}, {of_objects[0].name} ... {of_objects[-1].name}"
        refuse(folder, f"one mask of {photo.name}", received, "Name that of the object with --mask.")
    return folder / f"{photo.stem}.png"


def glob_escaped(text: str) -> str:
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in text)
