"""Pictures read as linear RGB arrays, and written.

A photo is decoded once, here, and is linear from then on. Unusable files are refused with one line
(UserError) before anything is computed.
"""

import struct
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from isal import isal_zlib
from PIL import Image, UnidentifiedImageError

from vig.io.errors import UserError
from vig.io.files import write_bytes
from vig.photo.checks import check_size, existing_file, refuse
from vig.photo.decoding import LINEAR, PHOTO, decode_picture, open_picture
from vig.photo.formats import unread_samples
from vig.scene.functions import numpy_of_tensor
from vig.scene.light import srgb8_from_linear

if TYPE_CHECKING:
    import torch

    Photo = str | Path | Image.Image | np.ndarray | torch.Tensor
else:  # a tensor is one of numpy's where it is used
    Photo = str | Path | Image.Image | np.ndarray
Picture = TypeVar("Picture")
ROUNDING = 1e-6  # excess of floats beyond [0, 1] that is allowed: resampling rounds


def read_photo(path: str | Path) -> np.ndarray:
    """Read a photo as linear RGB, (H, W, 3) float32 in [0, 1]; see `coded_photo`."""
    return linear_photo(coded_photo(path))


def read_picture(path: str | Path, what: str, decode: Callable[[Path, Image.Image], Picture]) -> Picture:
    """Open a picture's file and decode it.

    Args:
        path: Path of the file.
        what: Expected kind of picture, such as "photo".
        decode: Takes the path, which errors name, and the opened picture.

    Raises:
        UserError: The file is missing, unreadable, damaged, tiny (a side under `MIN_SIDE`), huge (over
            `MAX_PIXELS`, judged by its header), or another kind of file (`why_no_photo`).
    """
    path = existing_file(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about damaged parts that a decoder passes over
        try:
            with open_picture(path) as image:
                return decode(path, image)
        except UserError:
            raise
        except MemoryError:
            refuse(path, f"a {what} that fits into memory", "too large a one", "Make it smaller.")
        except UnidentifiedImageError:
            expected = PHOTO.replace("photo", what)
            refuse(path, expected, unread_samples(path) or "something else", "Convert it to JPEG or PNG.")
        except Exception as error:  # a decoder may raise anything on a damaged file
            refuse(path, f"a whole {what}", f"a damaged one ({error})", "Save or copy it again.")


def as_photo(photo: "Photo") -> np.ndarray:
    """Return a photo in any form as linear RGB, (H, W, 3) float32 in [0, 1]."""
    return linear_photo(coded_photo(photo))


def as_srgb(picture: np.ndarray) -> np.ndarray:
    """Return a photo (H, W, 3), uint8 sRGB or float linear RGB, as uint8 sRGB."""
    return picture if picture.dtype == np.uint8 else srgb8_from_linear(picture)


def linear_photo(coded: np.ndarray) -> np.ndarray:
    """Return linear RGB float32 of pixels (..., 3) as `coded_photo` returns them."""
    return coded if coded.dtype == np.float32 else LINEAR[coded]


def linear_planes(coded: np.ndarray) -> list[Image.Image]:
    """Return `linear_photo` of pixels (H, W, 3) as a float picture of each channel."""
    if coded.dtype == np.float32:
        return [Image.fromarray(np.ascontiguousarray(plane)) for plane in np.moveaxis(coded, 2, 0)]
    planes = Image.fromarray(np.ascontiguousarray(coded)).split()
    return [plane.point(LINEAR.tolist(), "F") for plane in planes]


def coded_photo(photo: "Photo") -> np.ndarray:
    """Return a photo (H, W, 3) as it is kept: uint8 sRGB where it has no more, else float32 linear RGB.

    Samples count by their true range (`vig.photo.formats.white_level`) and by the colour encoding that the
    file states: H.273's codes (PNG, AVIF, HEIC), else its colour profile, else a PNG's sRGB, gamma and
    primaries; without any as sRGB (16-bit colour then keeps its upper 8 bits). HDR is mapped into [0, 1]
    (`vig.photo.colour.tone_mapped`). An unreadable profile is ignored. Grey and palette images become RGB,
    CMYK and Lab are converted, the orientation applied; of several pages or pictures the largest is taken, of
    an animation the first frame. Transparent pixels are laid over mid-grey (`MID_GREY`) in linear light:
    white or black would look like a bright or dark object.

    Args:
        photo: A file, a PIL image, or an array or tensor (H, W, 3) or grey (H, W): uint8
            is taken as sRGB, floating point as linear RGB in [0, 1].

    Raises:
        UserError: The photo is none of these, has another shape, type or range, or is tiny or huge.
    """
    if isinstance(photo, str | Path):
        return read_picture(photo, "photo", decode_picture)
    name = Path("the photo")
    if isinstance(photo, Image.Image):
        check_size(name, *photo.size)
        return decode_picture(name, photo)
    array: Any = numpy_of_tensor(photo)
    if not isinstance(array, np.ndarray):
        refuse(name, "a path, a PIL image or an array", f"a {type(photo).__name__}", "Convert it to one.")
    if array.ndim == 2:
        array = np.repeat(array[:, :, None], 3, axis=2)
    if array.ndim != 3 or array.shape[2] != 3:
        batch = array.ndim == 4 or (array.ndim == 3 and array.shape[0] in (1, 3))
        remedy = "Pass one photo with channels last." if batch else "Convert it to RGB."
        refuse(name, "(H, W, 3) or (H, W)", f"shape {tuple(array.shape)}", remedy)
    check_size(name, array.shape[1], array.shape[0])
    if array.dtype == np.uint8:
        return np.array(array, order="C")
    if not np.issubdtype(array.dtype, np.floating):
        refuse(name, "uint8 sRGB or floating-point linear RGB", str(array.dtype), "Convert it to uint8.")
    least, most = float(array.min()), float(array.max())
    if not (least >= -ROUNDING and most <= 1 + ROUNDING):  # NaN fails both
        remedy = "Are these 8-bit values? Pass them as uint8." if most > 1 else "Clip or clean it."
        refuse(name, "linear RGB in [0, 1]", f"values from {least:g} to {most:g}", remedy)
    return np.asarray(np.clip(array, 0, 1).astype(np.float32, order="C"))


def write_png(path: str | Path, array: np.ndarray) -> None:
    """Write a picture as an 8-bit PNG, whole or not at all.

    Args:
        path: See `vig.io.files.atomic_write`.
        array: (H, W), (H, W, 3) or (H, W, 4). uint8 is written as it is; bool becomes 0 and 255; floats are
            linear light, encoded as sRGB with values outside [0, 1] clipped (at most 3 channels).

    Raises:
        ValueError: Another type or shape, or floats that are not finite.
        UserError: The file cannot be written.
    """
    array = np.asarray(array)
    if array.ndim not in (2, 3) or array.shape[2:] not in ((), (3,), (4,)) or array.size == 0:
        raise ValueError(
            f"a picture must be (H, W), (H, W, 3) or (H, W, 4); got {array.shape}. Pass one picture."
        )
    if array.dtype == bool:
        array = array.astype(np.uint8) * np.uint8(255)
    elif np.issubdtype(array.dtype, np.floating):
        if array.shape[2:] == (4,):
            raise ValueError(
                "a picture in linear light must have 1 or 3 channels; got 4. Is the last one alpha?"
            )
        if not np.isfinite(array).all():
            raise ValueError("a picture in linear light must be finite; got NaN or infinity. Clean it.")
        array = srgb8_from_linear(array)
    elif array.dtype != np.uint8:
        raise ValueError(f"a picture must be uint8, bool or floating; got {array.dtype}. Convert it.")
    write_bytes(path, png_bytes(array))


def png_bytes(picture: np.ndarray) -> bytes:
    """Return a picture (H, W), (H, W, 3) or (H, W, 4), uint8 or uint16, as a PNG file.

    Each row is stored as its difference from the one above: Pillow tries five filters on each, which takes
    as long as to compress all of it.
    """
    if picture.dtype not in (np.uint8, np.uint16) or picture.size == 0:
        described = f"{picture.dtype} {picture.shape}"
        raise ValueError(f"a PNG must be uint8 or uint16 and not empty; got {described}. Convert it.")
    height, width = picture.shape[:2]
    rows = np.ascontiguousarray(picture, picture.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)
    lines = np.empty((height, rows.shape[1] + 1), np.uint8)
    # 2: number of PNG's filter that a row is the difference from the one above
    lines[:, 0], lines[0, 1:] = 2, rows[0]
    np.subtract(rows[1:], rows[:-1], out=lines[1:, 1:])
    colour = {(): 0, (3,): 2, (4,): 6}[picture.shape[2:]]
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8 * picture.itemsize, colour, 0, 0, 0)),
        (b"IDAT", isal_zlib.compress(lines.data, 1)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )
