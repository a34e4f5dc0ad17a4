"""Refusals of files and sizes that are no photo's, in one line each."""

import re
from pathlib import Path
from typing import NoReturn

from vig.io.errors import UserError
from vig.io.files import as_stored

MIN_SIDE = 16  # pixels of a photo's shorter side, at least
MAX_PIXELS = 250_000_000
"""Pixels of a photo, at most: phones have 200 megapixels, whose 8-bit RGB takes 2 GB to decode."""
ADDRESS = re.compile(r"[A-Za-z][\w+.-]+:/")
"""Beginning of an address such as http://, from which a path loses a slash."""
MAX_FLOAT_PIXELS = 100_000_000  # pixels of one that is kept as floats, of 16 bits, with transparency or HDR


def existing_file(path: str | Path) -> Path:
    path = as_stored(Path(path))
    wanted = "an image file"
    try:
        if path.is_dir():
            refuse(path, wanted, "a folder", "Name the files in it.")
        if ADDRESS.match(str(path)) and not path.exists():
            refuse(path, wanted, "an address", "Download it; a live stream is for vig fit --track --live.")
        if not path.exists():
            refuse(path, wanted, "nothing of that name", "Check the path.")
        if not path.is_file():
            refuse(path, wanted, "a device or pipe", "Save the image to a file.")
        if not head_of(path):
            refuse(path, wanted, "an empty file", "Save or copy it again.")
    except OSError as error:
        refuse(path, "a readable image file", error.strerror or str(error), "Check the path and its rights.")
    return path


def head_of(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(256)


def check_size(path: Path, width: int, height: int) -> None:
    if min(width, height) < MIN_SIDE:
        received = f"{width} x {height}"
        refuse(path, f"at least {MIN_SIDE} pixels a side", received, "Give a larger picture.")
    check_pixels(path, width, height, MAX_PIXELS)


def check_pixels(path: Path, width: int, height: int, most: int, of_what: str = "") -> None:
    if width * height > most:
        received = f"{width} x {height} = {width * height / 1e6:.0f}"
        refuse(path, f"at most {most / 1e6:.0f} megapixels{of_what}", received, "Make it smaller.")


def refuse(path: Path, expected: str, received: str, remedy: str) -> NoReturn:
    raise UserError(f"{path}: expected {expected}; got {received}. {remedy}")
