"""`--box`, `--boxes`, `--objects` and `--class`: where objects are, and what they are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vig.explainer import Box, checked_box
from vig.io.checks import MOST_TABLE, read_json, reading
from vig.io.errors import UserError
from vig.io.printing import note
from vig.several import MOST_OBJECTS
from vig_app.cli.common import FitCommand, pack_of_mesh
from vig_app.cli.naming import by_photo
from vig_app.corrections import corrected_in

REMEDY = 'Write {"photo.jpg": [x, y, w, h]}, or a list of these or of {"box": [x, y, w, h], "class": "mug"}.'
Objects = tuple[tuple[str, Box], ...]
"""Class and box of each object of a photo."""
OF_ONE_OBJECT = ("mask", "marks", "visible", "points", "azimuth", "elevation", "roll", "pose")
"""Options that say something of a single object."""
PLACES = ("box", "boxes", "mask", "marks", "objects")
"""Options that tell where objects are."""


def boxes_of(settings: FitCommand, photos: list[Path]) -> list[tuple[Box | None, Objects]]:
    """The box of each photo's one object, None where none is named; or its several objects.

    UserError where the file cannot be used, or an option is of a single object.
    """
    if settings.objects is not None:
        if settings.box is not None or settings.boxes is not None:
            raise UserError("expected --objects, --box or --boxes; got two of them. Give one.")
        if not 1 <= settings.objects <= MOST_OBJECTS:
            raise UserError(f"expected --objects of 1 to {MOST_OBJECTS}; got {settings.objects}. Give fewer.")
        _check_several(settings)
    if settings.boxes is None:
        return [(None if settings.box is None else parse_box(settings.box), ())] * len(photos)
    if settings.box is not None:
        raise UserError("expected --box or --boxes; got both. Give one.")
    with reading(settings.boxes, "boxes by the photos' file names", REMEDY):
        if not isinstance(entries := read_json(settings.boxes, MOST_TABLE), dict):
            raise ValueError("it is not an object")
        by_name = {name: _read(entry, settings) for name, entry in entries.items()}
    of_photo = by_photo(by_name, photos, "boxes", settings.boxes)
    if any(objects for _, objects in of_photo.values()):
        _check_several(settings)
    return [of_photo.get(photo, (None, ())) for photo in photos]


def check_place(settings: FitCommand, folders: Sequence[Path] = ()) -> None:
    """UserError where nothing tells where the object of --mesh is, before the mesh is made ready; corrections
    by hand in folders of earlier results do.
    """
    known = any(getattr(settings, name) is not None for name in PLACES)
    if settings.mesh is None or known or any(map(corrected_in, folders)):
        return
    box = "x,y,w,h in pixels round the whole object, such as --box 120,80,300,240"
    if settings.track:
        raise UserError(
            "expected --box with --mesh, as no network knows this object to find it; got none. Give that of"
            f" the first frame, {box}."
        )
    raise UserError(
        "expected --box or --mask with --mesh, as no network knows this object to find it; got neither. Give"
        f" --box {box}, or --mask m.png, white where it is seen; of many --boxes FILE or --mask FOLDER."
    )


def classes_of(settings: FitCommand) -> tuple[str, tuple[str, ...]]:
    """The class, and others that `--class` names beside it; UserError where it names several in vain."""
    if settings.mesh is not None:
        if settings.object_class != FitCommand.object_class or settings.objects is not None:
            raise UserError("expected --mesh, --class or --objects; got two of them. Give one.")
        say = (lambda line: None) if settings.quiet else note
        return str(pack_of_mesh(settings.mesh, settings.length, say, settings.up)), ()
    for name in ("length", "up"):
        if getattr(settings, name) is not None:
            raise UserError(f"expected --{name} with --mesh, which it describes; got it alone. Give both.")
    whole = [settings.object_class]
    several = settings.objects is not None and not Path(settings.object_class).exists()
    first, *others = settings.object_class.split(",") if several else whole
    if "," in first and not Path(first).exists():
        raise UserError(
            f"expected one --class, or --objects with several; got '{first}'. Give each box its class."
        )
    return first, tuple(others)


def parse_box(text: str) -> Box:
    """ "x,y,w,h" as four numbers; UserError when it is not."""
    try:
        return checked_box(text.replace(" ", "").split(","))
    except UserError:
        raise UserError(f"expected --box x,y,w,h in pixels, such as 40,30,200,160; got '{text}'") from None


def _read(entry: Any, settings: FitCommand) -> tuple[Box | None, Objects]:
    """One photo's box or objects from the file."""
    if not isinstance(entry, list) or not entry:
        raise ValueError("what it has for a photo is not a list with something in it")
    if not isinstance(entry[0], list | dict):
        return _box(entry), ()
    objects = tuple(_object(item, settings.object_class) for item in entry)
    if len(objects) > MOST_OBJECTS:
        raise ValueError(f"a photo has {len(objects)} boxes, more than {MOST_OBJECTS}")
    return None, objects


def _object(item: Any, class_name: str) -> tuple[str, Box]:
    if not isinstance(item, dict):
        return class_name, _box(item)
    if unknown := sorted(item.keys() - {"box", "class"}):
        raise ValueError(f"an object has '{unknown[0]}', where it may have 'box' and 'class'")
    if not isinstance(name := item.get("class", class_name), str):
        raise ValueError("an object's class is not a text")
    return name, _box(item.get("box"))


def _box(numbers: Any) -> Box:
    if not isinstance(numbers, list) or len(numbers) != 4:
        raise ValueError(f"a box is not a list of four numbers; it is {str(numbers)[:60]}")
    if any(isinstance(number, str) for number in numbers):  # which is --box's own form
        raise ValueError(f"a box has a text among its numbers; it is {str(numbers)[:60]}")
    return checked_box(numbers)


def _check_several(settings: FitCommand) -> None:
    for name in OF_ONE_OBJECT:
        value = getattr(settings, name)
        if not (value is None or value is False or value == ()):
            raise UserError(
                f"expected --{name} with one object a photo; got several objects. Fit that object alone."
            )
