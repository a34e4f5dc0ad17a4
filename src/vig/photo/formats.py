"""A file's format by its content, and its container's statements on colour and pages."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from PIL import TiffImagePlugin
from PIL.ExifTags import Base as Tag

EXR_MAGIC = b"\x76\x2f\x31\x01"
HDR_MAGIC = (b"#?RADIANCE", b"#?RGBE", EXR_MAGIC)
TIFF_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_RAW_MAGIC = (
    b"FUJIFILMCCD-RAW",
    b"IIRO",
    b"IIRS",
    b"MMOR",
    b"IIU\0",
    b"II\x1a\0\0\0HEAPCCDR",
    b"\0MRM",
    b"FOVb",
)
_RAW_ENDINGS = frozenset(
    ".3fr .arw .cr2 .cr3 .crw .dng .erf .fff .gpr .iiq .kdc .mef .mos .mrw .nef .nrw .orf .pef .raf .raw .rw2"
    " .rwl .sr2 .srf .srw .x3f".split()
)
_PHOTO_MAGIC = (
    b"\x89PNG",
    b"\xff\xd8\xff",
    b"GIF8",
    b"BM",
    b"RIFF",
    b"P1",
    b"P2",
    b"P3",
    b"P4",
    b"P5",
    b"P6",
)
_HEIF_BRANDS = b"heic heix heim heis hevc hevx hevm hevs mif1 msf1 mif2 miaf avci avcs jpeg j2ki vvic".split()
_CONVERT = "Convert it to JPEG or PNG."
_VIDEO = "a video", "Give vig fit the file with the ending of a video, such as .mp4."
_OTHERS = (
    (HDR_MAGIC, "an HDR image", "Save it as 8-bit sRGB; HDR is for panoramas."),
    ((b"PF\n", b"Pf\n"), "an HDR image (PFM)", "Save it as 8-bit sRGB."),
    ((b"%PDF",), "a PDF document", "Save its picture as JPEG or PNG."),
    ((b"%!PS", b"\xc5\xd0\xd3\xc6"), "a PostScript drawing", "Save it as PNG."),
    ((b"8BPS",), "a Photoshop document", "Export it as JPEG or PNG."),
    ((b"gimp xcf",), "a GIMP document", "Export it as JPEG or PNG."),
    ((b"\xff\x0a", b"\0\0\0\x0cJXL "), "JPEG XL", _CONVERT),
    ((b"II\xbc\x01",), "JPEG XR", _CONVERT),
    ((b"\0\0\1\0",), "an icon (ICO)", _CONVERT),
    ((b"SIMPLE  =",), "a FITS file", "Save its picture as PNG."),
    ((b"DDS ",), "a texture (DDS)", _CONVERT),
    ((b"\x93NUMPY",), "an array of numpy", "Load it, and pass the array to vig.Explainer.explain."),
    ((b"PK\3\4", b"\x1f\x8b", b"7z\xbc\xaf", b"Rar!"), "an archive", "Unpack it."),
    ((b"\0\5\x16\7",), "a side file of macOS (AppleDouble)", "Name the file beside it, without ._ in front."),
    ((b"\x1aE\xdf\xa3", b"\0\0\1\xba", b"\0\0\1\xb3", b"OggS", b"FLV\1", b"0&\xb2u\x8ef"), *_VIDEO),
)
CFA = 32803


def why_no_photo(path: Path) -> tuple[str, str] | None:
    """Return the name of a format that vig does not read as a photo, and the remedy; None for all others.

    It is recognised by its first bytes, raw files by their tags and ending too. A damaged photo is not.
    """
    with path.open("rb") as file:
        head = file.read(1024)
        raw = (
            f"a camera's raw file ({path.suffix.lstrip('.').upper() or 'no ending'})",
            "Develop it to JPEG or PNG.",
        )
        brand = head[8:12] if head[4:8] == b"ftyp" else b""
        if head.startswith(_RAW_MAGIC) or brand == b"crx ":
            return raw
        if head.startswith(TIFF_MAGIC):
            is_raw = path.suffix.lower() in _RAW_ENDINGS or head[8:10] == b"CR"
            return raw if is_raw or any(_is_raw(tags) for _, tags in tiff_pages(file)) else None
    if is_heif(head):
        return (
            None
            if find_spec("pillow_heif")
            else ("HEIC", "Convert it to JPEG, or run pip install 'vig[heic]'.")
        )
    if (brand and not _is_avif(head)) or (head[:4] == b"RIFF" and head[8:12] == b"AVI "):
        return _VIDEO
    for magic, name, remedy in _OTHERS:
        if head.startswith(magic):
            return name, remedy
    if head[128:132] == b"DICM":
        return "a DICOM file", "Save its picture as PNG."
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if b"<svg" in head.lower() and text.startswith((b"<", b"<?xml")):
        return "a drawing (SVG)", "Save it as PNG."
    if text.startswith((b"<!doctype html", b"<html")):
        return "a web page", "Save the picture in it instead."
    if head.startswith(b"version https://git-lfs"):
        return "a pointer of Git LFS", "Run git lfs pull."
    if path.suffix.lower() in _RAW_ENDINGS and not brand and not head.startswith(_PHOTO_MAGIC):
        return raw
    return None


def is_heif(head: bytes) -> bool:
    """Return whether a file with these first bytes is HEIF, such as HEIC, that is not AVIF."""
    return head[4:8] == b"ftyp" and head[8:12] in _HEIF_BRANDS and not _is_avif(head)


def _is_avif(head: bytes) -> bool:
    size = min(int.from_bytes(head[:4], "big"), len(head))
    return any(head[place : place + 4] in (b"avif", b"avis") for place in (8, *range(16, size, 4)))


def _is_raw(tags: Any) -> bool:
    # 34892: photometric interpretations of TIFF that only raw files have
    return Tag.DNGVersion in tags or tags.get(Tag.PhotometricInterpretation) in (CFA, 34892)


def tiff_pages(file: IO[bytes]) -> list[tuple[int | None, Any]]:
    """Return number and tags of every page of a TIFF file, after each those of the pages below it (SubIFDs).

    The number is None for a page below another. The list ends at unreadable data.
    """
    pages: list[tuple[int | None, Any]] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about damaged tags
        try:
            file.seek(0)
            head = file.read(8)
            head += file.read(8) if head[2] == 43 else b""
            offsets = [(TiffImagePlugin.ImageFileDirectory_v2(head).next, True)]
            visited, number = {0}, 0
            while offsets:
                offset, in_chain = offsets.pop(0)
                if offset in visited:
                    continue
                visited.add(offset)
                tags = TiffImagePlugin.ImageFileDirectory_v2(head)
                file.seek(offset)
                tags.load(file)
                below = tags.get(Tag.SubIFDs, ())
                if in_chain:
                    offsets.append((tags.next, True))
                offsets[:0] = [(place, False) for place in (below if isinstance(below, tuple) else (below,))]
                pages.append((number if in_chain else None, tags))
                number += in_chain
        except Exception:  # a damaged file: its decoder reports so
            pass
    return pages


class TiffPage(NamedTuple):
    """A page of a TIFF file: its number, None for one below another, (width, height) and tags."""

    number: int | None
    size: tuple[int, int]
    tags: Any


def largest_page(path: Path) -> TiffPage | None:
    """Return a TIFF file's largest page, reduced ones and masks left aside; None if it is damaged."""
    with path.open("rb") as file:
        pages = [
            TiffPage(number, (tags[Tag.ImageWidth], tags[Tag.ImageLength]), tags)
            for number, tags in tiff_pages(file)
            if Tag.ImageWidth in tags and Tag.ImageLength in tags
        ]
    whole = [page for page in pages if not page.tags.get(Tag.NewSubfileType, 0) & 5]
    return max(whole or pages, key=lambda page: page.size[0] * page.size[1], default=None)


def unread_samples(path: Path) -> str | None:
    """Return the kind of samples, in words, of a TIFF or JPEG that is not decoded; None for other files."""
    with path.open("rb") as file:
        head = file.read(1 << 16)
        if head.startswith(b"\xff\xd8\xff"):
            frame = re.search(
                rb"\xff([\xc0-\xc3\xc5-\xc7\xc9-\xcb\xcd-\xcf])\0[\x0b\x11\x14](.)", head, re.DOTALL
            )
            if frame and (frame[2] != b"\x08" or frame[1] not in b"\xc0\xc1\xc2"):
                lossless = "" if frame[1] in b"\xc0\xc1\xc2" else " in a rare coding"
                return f"a JPEG of {frame[2][0]} bits{lossless}"
        pages = tiff_pages(file) if head.startswith(TIFF_MAGIC) else []
    return next((f"a TIFF of {samples_of(tags)}" for _, tags in pages if Tag.ImageWidth in tags), None)


def samples_of(tags: Any) -> str:
    """Describe the samples of a page with these TIFF tags."""
    bits = tags.get(Tag.BitsPerSample, (1,))[0]
    kind = {2: "signed ", 3: "floating-point ", 6: "complex "}.get(tags.get(Tag.SampleFormat, (1,))[0], "")
    return f"{kind}samples of {bits} bits" + (
        ", 0 for white" if tags.get(Tag.PhotometricInterpretation) == 0 else ""
    )


def white_level(tags: Any) -> int:
    """Return the 16-bit sample that is white: below 65535 where TIFF tags state fewer bits."""
    if not tags:
        return 65535
    bits = int(tags.get(Tag.BitsPerSample, (16,))[0])
    if 8 < bits < 16:
        return (1 << bits) - 1
    for tag in (Tag.SMaxSampleValue, Tag.MaxSampleValue):
        largest = np.atleast_1d(tags.get(tag, 0))[0]
        # Writers also state the largest sample of the one picture; a power of two less 1 is a depth.
        if bits == 16 and largest in [2**depth - 1 for depth in range(9, 16)]:
            return int(largest)
    return 65535


class Codes(NamedTuple):
    """Codes of colours by ITU-T H.273."""

    primaries: int
    transfer: int
    full_range: bool = True


def stated_colour(file: IO[bytes]) -> Codes | bytes | None:
    """Return the codes that a PNG, AVIF or HEIC file states, or the profile in a JPEG 2000 or BMP file."""
    file.seek(0)
    data = file.read(26)
    if data.startswith(b"\x89PNG"):
        file.seek(8)
        while len(header := file.read(8)) == 8 and header[4:] != b"IDAT":
            body = file.read(int.from_bytes(header[:4], "big") + 4)
            if header[4:] == b"cICP" and len(body) == 8:
                return Codes(body[0], body[1], body[3] != 0)
        return None
    data += file.read()
    if data.startswith(b"BM"):
        start, size = (int.from_bytes(data[place : place + 4], "little") for place in (126, 130))
        return (
            data[14 + start : 14 + start + size]
            if data[14:15] == b"\x7c" and data[70:74] == b"DEBM"
            else None
        )
    boxes = dict(_boxes(data))
    if b"meta" in boxes:
        return _primary_nclx(boxes[b"meta"][4:])
    for kind, body in _boxes(boxes.get(b"jp2h", b"")):
        if kind == b"colr" and body[:1] in (b"\2", b"\3"):
            return body[3:]
    place = data.find(b"colrnclx")  # in a sequence of pictures
    return _nclx(data[place + 4 :]) if place > 0 and data[4:8] == b"ftyp" else None


def _nclx(colour: bytes) -> Codes:
    """Return the codes of a `colr` box's content; the decoder itself expands a limited range."""
    return Codes(int.from_bytes(colour[4:6], "big"), int.from_bytes(colour[6:8], "big"))


def _primary_nclx(meta: bytes) -> Codes | None:
    """Return the nclx colour property of the primary item, of a `meta` box's content (ISO/IEC 23008-12)."""
    boxes = dict(_boxes(meta))
    primary = int.from_bytes(boxes[b"pitm"][4:8] if boxes[b"pitm"][0] else boxes[b"pitm"][4:6], "big")
    inner = dict(_boxes(boxes[b"iprp"]))
    properties = list(_boxes(inner[b"ipco"]))
    table = inner[b"ipma"]
    id_size, index_size = 4 if table[0] else 2, 2 if table[3] & 1 else 1
    place = 8
    for _ in range(int.from_bytes(table[4:8], "big")):
        item, count = int.from_bytes(table[place : place + id_size], "big"), table[place + id_size]
        place += id_size + 1
        for start in range(place, place + count * index_size, index_size):
            index = int.from_bytes(table[start : start + index_size], "big") & (
                0x7FFF if index_size == 2 else 0x7F
            )
            kind, body = properties[index - 1] if index else (b"", b"")
            if item == primary and kind == b"colr" and body[:4] == b"nclx":
                return _nclx(body)
        place += count * index_size
    return None


def _boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield the kinds and contents of the boxes in a row (ISO/IEC 14496-12)."""
    place = 0
    while place + 8 <= len(data):
        size, start = int.from_bytes(data[place : place + 4], "big"), place + 8
        if size == 1:
            size, start = int.from_bytes(data[start : start + 8], "big"), start + 8
        size = size or len(data) - place
        if size < start - place:
            return
        yield data[place + 4 : place + 8], data[start : place + size]
        place += size
