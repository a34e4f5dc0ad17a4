"""The files that a mesh file refers to, by the names that programs of any system write."""

import os
import re
import unicodedata
from pathlib import Path
from urllib.parse import unquote

from PIL import Image

from vig.io.checks import name_stand_in, read_bytes
from vig_world.assets.own.surfaces import TooManyPixelsError, open_picture

MAX_BYTES = 512 * 2**20  # bytes of a file that is read, at most


def readings(name: bytes) -> list[str]:
    """Return possible readings of a name, as UTF-8 and in other encodings that allow it, likeliest first.

    Some words in GBK are valid UTF-8, and names may have been decoded wrongly before.
    """
    texts = []
    is_gb2312 = re.fullmatch(rb"([\x00-\x7f]|[\xa1-\xf7][\xa1-\xfe])*", name)
    # Encodings of names that are not UTF-8; unpackers of zip files read others as cp437.
    codecs = ("gb18030", "shift_jis", "euc_kr", "cp1251", "cp1252", "cp437", "latin-1")
    for codec in ("utf-8", *(codecs if is_gb2312 else codecs[::-1])):
        try:
            texts.append(name.decode(codec))
        except UnicodeDecodeError:
            continue
    return list(dict.fromkeys(texts))


def shown(name: bytes) -> str:
    """Return a name for a message and for the list of files read."""
    return re.sub(r"[\x00-\x1f\x7f]", "?", readings(name)[0])[:200]


def name_keys(name: bytes) -> set[str]:
    """Return keys of a name; names are alike where they share one, whatever their encoding and capitals."""
    return {unicodedata.normalize("NFC", text).casefold() for text in readings(name)}


class Siblings:
    """Reader of the files that one mesh file names.

    Names are sought in the mesh file's folder, and if that is a link, in its target's. No name leads out of
    `root`; a link does only where the mesh file is a link itself, as in the caches of model hubs.

    Attributes:
        path: The mesh file.
        read: Bytes of the files read, by name.
        notes: Sentences on files that were not read, and on their substitutes.
        instead: Substitute for an unreadable picture or material.
    """

    def __init__(self, root: Path, path: Path) -> None:
        self.path = path
        self.read: dict[str, bytes] = {}
        self.notes: list[str] = []
        self.instead = "grey"
        self._homes = list(
            dict.fromkeys(
                (
                    os.path.abspath(path.parent),
                    os.path.realpath(path.parent),
                    os.path.dirname(os.path.realpath(path)),
                )
            )
        )
        self._root = os.path.abspath(root)
        self._real_tops = [os.path.realpath(top) for top in (self._root, *self._homes)]
        self._listings: dict[str, dict[str, str]] = {}

    def find(self, name: bytes) -> str | None:
        """Return the path of a file by the name that the mesh has for it; None where it is missing."""
        for text in (os.fsdecode(name), *readings(name)):
            plain = text.strip().replace("\\", "/")
            for candidate in dict.fromkeys((plain, unquote(plain), plain.lstrip("/"), plain.split("/")[-1])):
                for home in self._homes:
                    place = self._descend(home, candidate)
                    if place and os.path.isfile(place) and self._is_allowed(place):
                        return place
        return None

    def get(self, name: bytes) -> bytes:
        """Return a file's bytes. ValueError, whose text begins with its name, where it cannot be read."""
        place = self.find(name)
        if place is None:
            raise ValueError(f"{shown(name)} is missing or unreadable")
        try:
            data = read_bytes(place, MAX_BYTES)
        except (OSError, ValueError) as error:
            raise ValueError(f"{shown(name)} is missing or unreadable ({str(error)[:200]})") from error
        if instead := name_stand_in(data):
            raise ValueError(f"{shown(name)} is {instead}")
        self.read[shown(name).strip().replace("\\", "/")] = data
        return data

    def look_beside(self, name: bytes) -> None:
        """Seek further names also beside this file, as those that an MTL library gives."""
        if place := self.find(name):
            self._homes.append(os.path.dirname(place))

    def note(self, problem: object, instead: str | None = None) -> None:
        self.notes.append(f"{problem}; {instead or self.instead} instead")

    def image(self, name: bytes, instead: str | None = None) -> Image.Image | None:
        """Return a decoded picture; None, with a note, where there is none."""
        try:
            data = self.get(name)
        except ValueError as error:
            self.note(error, instead)
            return None
        return self.decode(data, shown(name), instead)

    def decode(self, data: bytes, name: str, instead: str | None = None) -> Image.Image | None:
        """Return the picture that bytes hold; None, with a note, where they hold none."""
        try:
            return open_picture(data)
        except Exception as error:  # a decoder may raise anything on a damaged file
            too_large = isinstance(error, TooManyPixelsError)
            self.note(f"{name} is {error if too_large else 'missing or unreadable'}", instead)
            return None

    def _descend(self, home: str, name: str) -> str | None:
        """Return the path of a name below a folder; capitals and the composition of letters do not count."""
        if "\0" in name:
            return None
        whole = os.path.normpath(os.path.join(home, name))
        tops = (top for top in (self._root, home) if _is_within(whole, top) and _is_within(home, top))
        if (top := next(tops, None)) is None:
            return None
        place = top
        for part in os.path.relpath(whole, top).split(os.sep):
            entry = os.path.join(place, part)
            if not os.path.lexists(entry):
                if place not in self._listings:
                    self._listings[place] = _list_entries(place)
                keys = name_keys(os.fsencode(part))
                matches = sorted(self._listings[place][key] for key in keys if key in self._listings[place])
                if not matches:
                    return None
                entry = os.path.join(place, matches[0])
            place = entry
        return place

    def _is_allowed(self, place: str) -> bool:
        return self.path.is_symlink() or any(
            _is_within(os.path.realpath(place), top) for top in self._real_tops
        )


def _list_entries(folder: str) -> dict[str, str]:
    try:
        entries = sorted(os.listdir(folder), reverse=True)
    except OSError:
        return {}
    return {key: entry for entry in entries for key in name_keys(os.fsencode(entry))}


def _is_within(path: str, top: str) -> bool:
    return os.path.commonpath([top, path]) == top
