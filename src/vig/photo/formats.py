"""A file's format by its content, and its container's statements on colour and pages."""

import re
import warnings
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


def stated_codes(file: IO[bytes]) -> Codes | None:
    """Return the codes that a PNG or AVIF file states; of an AVIF file of several pictures the first ones."""
    file.seek(0)
    data = file.read(8)
    if data.startswith(b"\x89PNG"):
        while len(header := file.read(8)) == 8 and header[4:] != b"IDAT":
            body = file.read(int.from_bytes(header[:4], "big") + 4)
            if header[4:] == b"cICP" and len(body) == 8:
                return Codes(body[0], body[1], body[3] != 0)
        return None
    colour = file.read().partition(b"colrnclx")[2]  # ISO/IEC 14496-12; the decoder expands a limited range
    return Codes(int.from_bytes(colour[:2], "big"), int.from_bytes(colour[2:4], "big")) if colour else None
