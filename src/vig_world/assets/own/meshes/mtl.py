"""Materials of OBJ files: MTL libraries in any encoding, as programs write them."""

import re

import numpy as np
from PIL import Image

from vig.scene import linear_from_srgb
from vig_world.assets.own.siblings import Siblings, name_keys, shown
from vig_world.assets.own.surfaces import GREY, Surface, linear_picture

Statements = dict[bytes, list[bytes]]
"""Statements of a library on a material: the words after each keyword, the last one first."""
_OPTIONS = {
    b"-s": 3, b"-o": 3, b"-t": 3, b"-mm": 2, b"-blendu": 1, b"-blendv": 1, b"-cc": 1, b"-clamp": 1, b"-bm": 1,
    b"-boost": 1, b"-texres": 1, b"-imfchan": 1, b"-type": 1,
}  # fmt: skip
"""Most values that follow each option before a picture's name."""


def plain_lines(data: bytes) -> list[bytes]:
    """Return the lines of an OBJ or MTL file, continued ones joined; UTF-16 as UTF-8, other text as it is."""
    marks = ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig"))
    encoding = next((encoding for mark, encoding in marks if data.startswith(mark)), None)
    if encoding is None and b"\0" in data[:2]:
        encoding = "utf-16-be" if data[:1] == b"\0" else "utf-16-le"
    if encoding == "utf-8-sig":
        data = data[3:]
    elif encoding is not None:
        data = data.decode(encoding, "replace").encode("utf-8", "replace")
    return re.sub(rb"\\[ \t]*(?:\r\n|\n|\r)", b" ", data).splitlines()


def read_materials(names: list[bytes], libraries: list[bytes], siblings: Siblings) -> list[Surface | None]:
    """Return the surface of each material of an OBJ file; None, with a note, where that is not known.

    Args:
        names: Materials that faces have; empty for faces without (usemtl).
        libraries: Text that follows mtllib in the file.
        siblings: Reads the files.
    """
    if not libraries and not any(names):
        return [None] * len(names)
    contents = _library_data(libraries, siblings)
    stated: dict[bytes, Statements] = {}
    for content in contents:
        stated = {**_parse_library(content), **stated}
    surfaces: list[Surface | None] = []
    for name in names:
        statements = _find_material(name, stated)
        surfaces.append(None if statements is None else _surface(name, statements, siblings))
        if statements is None and contents:
            what = f"material '{shown(name)}' is in no library" if name else "faces without material (usemtl)"
            siblings.note(what)
    return surfaces


def library_names(rest: bytes) -> list[bytes]:
    """Return the names that may follow mtllib: all of the line, which may hold blanks, and its parts."""
    several = re.findall(rb'"[^"]+"|\S(?:.*?\.mtl(?=\s|$)|\S*)', rest, re.IGNORECASE)
    return list(dict.fromkeys(name.strip(b"\"'") for name in (rest, *several)))


def picture_name(rest: bytes) -> tuple[list[bytes], dict[bytes, list[float]]]:
    """Return the names that may follow map_Kd, without options and comments; and the options' numbers."""
    options: dict[bytes, list[float]] = {}
    while (parts := rest.split(None, 1)) and len(parts) == 2 and parts[0].lower() in _OPTIONS:
        option, rest = parts[0].lower(), parts[1]
        options[option] = []
        for _ in range(_OPTIONS[option]):
            value, *after = rest.split(None, 1)
            if not after or (_OPTIONS[option] == 3 and _number(value) is None):
                break
            options[option].append(_number(value) or 0.0)
            rest = after[0]
    rest = rest.strip()
    before = re.split(rb"\s(?:#|-[a-zA-Z]+\s)", rest, maxsplit=1)[0].strip()
    return list(dict.fromkeys(name.strip(b"\"'") for name in (rest, before))), options


def _library_data(libraries: list[bytes], siblings: Siblings) -> list[bytes]:
    """Return the content of the libraries; of one named after the OBJ file where those are missing."""
    contents, problems = [], []
    for rest in libraries:
        whole, *several = library_names(rest)
        for name in [whole] if siblings.find(whole) or not several else several:
            try:
                contents.append(siblings.get(name))
                siblings.look_beside(name)
            except ValueError as error:
                problems.append(str(error))
    instead = None
    if not contents:
        problems = problems or ["faces with materials (usemtl) but no library of them (mtllib)"]
        for own in (siblings.path.with_suffix(".mtl").name, siblings.path.name + ".mtl"):
            if siblings.find(own.encode("utf-8", "surrogateescape")):
                contents.append(siblings.get(own.encode("utf-8", "surrogateescape")))
                instead = own
                break
    for problem in problems:
        siblings.note(problem, instead)
    return contents


def _parse_library(data: bytes) -> dict[bytes, Statements]:
    """Return the materials of a library; of those with one name the last."""
    materials: dict[bytes, Statements] = {}
    current: Statements = {}
    for line in plain_lines(data):
        keyword, *rest = line.split(None, 1) or [b""]
        keyword, value = keyword.lower(), rest[0].strip() if rest else b""
        if keyword == b"newmtl":
            current = materials[value.strip(b"\"'")] = {}
        elif value and not keyword.startswith(b"#"):
            current.setdefault(keyword, []).insert(0, value)
    _settle_opacity(materials)
    return materials


def _settle_opacity(materials: dict[bytes, Statements]) -> None:
    """Replace Tr by d in all materials of a library.

    Tr is the transparency, but MeshLab and many scans (YCB, BigBIRD) write Tr 1 for opaque surfaces: Tr is
    the opacity in a library that has Tr 1 and nowhere Tr 0.
    """
    stated = [_numbers(material[b"tr"][0]) for material in materials.values() if b"tr" in material]
    is_opacity = [1.0] in stated and [0.0] not in stated
    for material in materials.values():
        tr = _numbers(material.pop(b"tr", [b""])[0])
        opacity = tr[0] if tr and is_opacity else 1 - tr[0] if tr else 1.0
        d = _numbers(material.get(b"d", [b""])[0].removeprefix(b"-halo"))
        # A library with d 0 beside Tr 0 means neither by d.
        material[b"d"] = [b"%g" % (d[0] if d and not (d[0] == 0 and tr) else opacity)]


def _find_material(name: bytes, stated: dict[bytes, Statements]) -> Statements | None:
    """Return a material by its name in the OBJ file; in a library of one also for faces without a name."""
    if not name and len(stated) == 1:
        return next(iter(stated.values()))
    for trial in (name, name.strip(b"\"'")):
        if trial in stated:
            return stated[trial]
    keys = name_keys(name) | name_keys(name.split(b"#")[0].strip())
    return next((material for other, material in stated.items() if keys & name_keys(other)), None)


def _surface(name: bytes, stated: Statements, siblings: Siblings) -> Surface:
    (opacity,) = _numbers(stated[b"d"][0]) or [1.0]
    opacity = min(max(opacity, 0.0), 1.0)
    rests = stated.get(b"map_kd", [])
    image, options = _first_picture(rests, siblings)
    if b"map_d" in stated:
        opacity *= _map_opacity(stated[b"map_d"], image, rests, siblings)
    if image is not None:
        # Many programs leave Kd at 0 or 0.8 beside a picture, so the picture alone counts.
        scale = np.array([*options.get(b"-s", []), 1.0, 1.0][:2])
        offset = np.array([*options.get(b"-o", []), 0.0, 0.0][:2])
        return Surface(np.ones(3), linear_picture(image), opacity, scale, offset)
    colour = _numbers(stated.get(b"kd", [b""])[0])
    if rests or len(colour) not in (1, 3, 4) or min(colour) < 0:
        if not rests:
            came = f"Kd {shown(stated[b'kd'][0])[:40]}" if b"kd" in stated else "neither Kd nor map_Kd"
            siblings.note(f"material '{shown(name)}' has {came} for a colour")
        return Surface(np.full(3, GREY), None, opacity)
    srgb = np.broadcast_to(np.array(colour[:3]) / (255 if max(colour) > 2 else 1), 3)
    return Surface(linear_from_srgb(np.clip(srgb, 0, 1)), None, opacity)


def _first_picture(
    rests: list[bytes], siblings: Siblings, instead: str | None = None
) -> tuple[Image.Image | None, dict[bytes, list[float]]]:
    """Return the first picture that can be read, and its options; a note where there is none."""
    notes = len(siblings.notes)
    for rest in rests:
        names, options = picture_name(rest)
        image = siblings.image(next(filter(siblings.find, names), names[0]), instead)
        if image is not None:
            del siblings.notes[notes:]
            return image, options
    return None, {}


def _map_opacity(
    rests: list[bytes], colours: Image.Image | None, colour_rests: list[bytes], siblings: Siblings
) -> float:
    """Return the opacity of glass by map_d, its median without holes; 1 where the map is the colours."""
    is_colour = rests[0] in colour_rests
    image = colours if is_colour else _first_picture(rests, siblings, "an opaque one")[0]
    if image is None or (is_colour and not image.has_transparency_data):
        return 1.0
    band = image.convert("RGBA").getchannel("A") if image.has_transparency_data else image.convert("L")
    band.thumbnail((64, 64))
    opacity = np.asarray(band, np.float64) / 255
    cut_out = 0.05  # opacity below which a texel of map_d is a hole, not glass
    return float(np.median(opacity[opacity > cut_out])) if opacity.max() > cut_out else 0.0


def _numbers(text: bytes) -> list[float]:
    """Return the numbers with which a text begins."""
    numbers = []
    for word in text.split():
        if (number := _number(word)) is None:
            break
        numbers.append(number)
    return numbers


def _number(word: bytes) -> float | None:
    try:
        return float(word) if np.isfinite(float(word)) else None
    except ValueError:
        return None
