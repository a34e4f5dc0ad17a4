"""Reads furniture catalogues: a zip with models and a file of properties that lists them."""

import math
import re
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vig.io.checks import reading
from vig.io.errors import UserError

SUFFIX = ".sh3f"
PROPERTIES = "PluginFurnitureCatalog.properties"
MAX_SIDE = 10_000.0  # centimetres of a model's side


@dataclass(frozen=True)
class CatalogueModel:
    """An entry of a catalogue, as it is listed.

    Attributes:
        catalogue: The catalogue's file.
        name: Such as "Coffee cup".
        tags: Search words.
        category: Such as "Kitchen".
        creator: Its author; empty where unknown.
        licence: Its own, or else the catalogue's; empty where unknown.
        path: Path of the model's file within the zip.
        fields: All that is listed of it, by key.
    """

    catalogue: Path
    name: str
    tags: tuple[str, ...]
    category: str
    creator: str
    licence: str
    path: str
    fields: dict[str, str]

    @property
    def is_mounted(self) -> bool:
        """Return whether it hangs on a wall or from a ceiling, or is a part of the house."""
        is_of_house = self.fields.get("doorOrWindow") == "true" or "staircaseCutOutShape" in self.fields
        return is_of_house or _number(self.fields.get("elevation", "0")) > 0

    def size(self) -> np.ndarray:
        """Return the width, height, depth: (3,) metres. UserError when one is missing or out of range."""
        sides = [self.fields.get(key, "nothing") for key in ("width", "height", "depth")]
        size = np.array([_number(side) for side in sides])
        if not ((size > 0) & (size <= MAX_SIDE)).all():
            raise UserError(
                f"expected a width, height and depth of up to {MAX_SIDE:g} cm; got {', '.join(sides)[:60]}."
            )
        return size / 100

    def rotation(self) -> np.ndarray:
        """Return the rotation (3, 3) from the file's axes to the catalogue's. UserError when it is none."""
        text = self.fields.get("modelRotation", "1 0 0 0 1 0 0 0 1")
        matrix = np.array([_number(word) for word in text.split()])
        if len(matrix) == 9:
            matrix = matrix.reshape(3, 3)
            if np.abs(matrix @ matrix.T - np.eye(3)).max() < 0.01 and np.linalg.det(matrix) > 0:
                return matrix
        raise UserError(f"expected nine numbers of a rotation as its modelRotation; got '{text[:60]}'.")


def read_catalogue(path: Path) -> list[CatalogueModel]:
    """Read the models that a catalogue lists, in its order.

    Raises:
        UserError: The file is missing, is no zip, or has no list of models.
    """
    remedy = "Export it anew from Sweet Home 3D's Furniture Library Editor."
    with reading(path, "a furniture catalogue (a zip)", remedy), zipfile.ZipFile(path) as archive:
        try:
            data = read_entry(archive, PROPERTIES, 16 << 20)
        except KeyError:
            raise ValueError(f"without its list {PROPERTIES}") from None
        properties = parse_properties(data)
    entries: dict[int, dict[str, str]] = {}
    for key, value in properties.items():
        name, _, number = key.partition("#")
        if number.isascii() and number.isdigit() and len(number) < 10:
            entries.setdefault(int(number), {})[name] = value
    return [
        CatalogueModel(
            path,
            fields.get("name", "").strip() or f"model {number}",
            tuple(tag.strip() for tag in fields.get("tags", "").split(",") if tag.strip()),
            fields.get("category", "").strip(),
            fields.get("creator", "").strip(),
            (fields.get("license") or properties.get("license", "")).strip(),
            fields.get("model", "").strip(),
            fields,
        )
        for number, fields in sorted(entries.items())
    ]


def read_entry(archive: zipfile.ZipFile, name: str, most: int) -> bytes:
    """Unpack one file of a zip.

    Raises:
        KeyError: There is no such file.
        ValueError: It has more than `most` bytes when unpacked.
        zipfile.BadZipFile, OSError, RuntimeError, zlib.error: It is damaged or encrypted.
    """
    entry = archive.getinfo(name)
    if entry.file_size > most:
        raise ValueError(f"{name} unpacks to {entry.file_size:,} bytes where at most {most:,} are read")
    with archive.open(entry) as file:
        data = file.read(most + 1)  # the size in the zip's directory may be wrong
    if len(data) > most:
        raise ValueError(f"{name} unpacks to more than the {most:,} bytes that are read")
    return data


def parse_properties(data: bytes) -> dict[str, str]:
    """Parse a file of Java properties: Latin-1 with `\\uXXXX` for other characters."""
    properties: dict[str, str] = {}
    logical = ""
    for line in re.split(r"\r\n|\r|\n", data.decode("latin-1")):
        line = line.lstrip(" \t\f")
        if not logical and line[:1] in ("", "#", "!"):
            continue
        logical += line
        if (len(logical) - len(logical.rstrip("\\"))) % 2:
            logical = logical[:-1]  # a single backslash at the end: the next line goes on
            continue
        match = re.match(r"((?:\\.|[^\\=:\s])*)[ \t\f]*[=:]?[ \t\f]*(.*)", logical)
        if match:
            properties[_unescape(match[1])] = _unescape(match[2])
        logical = ""
    return properties


def _unescape(text: str) -> str:
    def character(match: re.Match[str]) -> str:
        word = match[1]
        return chr(int(word[1:], 16)) if len(word) > 1 else {"t": "\t", "n": "\n", "r": "\r"}.get(word, word)

    text = re.sub(r"\\(u[0-9a-fA-F]{4}|.)", character, text)
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")


def _number(text: str) -> float:
    """Return a number, or NaN for other text."""
    try:
        number = float(text)
    except ValueError:
        return math.nan
    return number if math.isfinite(number) else math.nan
