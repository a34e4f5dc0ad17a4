"""`--box`, `--boxes`, `--labels`, `--objects` and `--class`: places and classes of objects."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from vig.explainer import Box, check_box
from vig.io.checks import MAX_TABLE, read_json, reading
from vig.io.errors import UserError
from vig.io.printing import note
from vig.known_object import Keypoints, Surface
from vig.known_object.packs import SUFFIXES, pack_of_mesh
from vig.scene import ObjectClass
from vig.several import MAX_OBJECTS
from vig_app.cli.naming import by_photo, list_names
from vig_app.cli.options import HintOptions, PlaceOptions, changed_options
from vig_app.labels import Label, read_labels

REMEDY = 'Write {"photo.jpg": [x, y, w, h]}, or a list of these or of {"box": [x, y, w, h], "class": "mug"}.'
Objects = tuple[tuple[str, Box], ...]  # class and box of each object of a photo


def boxes_of(
    place: PlaceOptions, photos: Sequence[Path], hints: HintOptions
) -> list[tuple[Box | None, Objects]]:
    """Return the box of each photo's one object, None where none is named; or its several objects.

    UserError where the file cannot be used, or hints are of a single object.
    """
    if place.objects is not None:
        if place.box is not None or place.boxes is not None:
            raise UserError("expected --objects, --box or --boxes; got two of them. Give one.")
        if not 1 <= place.objects <= MAX_OBJECTS:
            raise UserError(f"expected --objects of 1 to {MAX_OBJECTS}; got {place.objects}. Give fewer.")
    if place.labels is not None and (
        place.box is not None or place.boxes is not None or changed_options(hints)
    ):
        raise UserError("expected --labels without --box, --boxes and hints; got one of them. Give one.")
    if place.boxes is None:
        one = None if place.box is None else parse_box(place.box)
        boxes: list[tuple[Box | None, Objects]] = [(one, ())] * len(photos)
    else:
        if place.box is not None:
            raise UserError("expected --box or --boxes; got both. Give one.")
        with reading(place.boxes, "boxes by the photos' file names", REMEDY):
            if not isinstance(entries := read_json(place.boxes, MAX_TABLE), dict):
                raise ValueError("it is not an object")
            by_name = {name: _read(entry, place.object_class) for name, entry in entries.items()}
        of_photo = by_photo(by_name, photos, "boxes", place.boxes)
        boxes = [of_photo.get(photo, (None, ())) for photo in photos]
    if place.meshes and place.boxes is not None and any(box is not None for box, _ in boxes):
        raise UserError(f"expected --boxes that name meshes; got one without a name. {REMEDY}")
    if place.objects is not None or place.meshes or any(objects for _, objects in boxes):
        for name in changed_options(hints):
            raise UserError(
                f"expected --{name} with one object a photo; got several objects. Fit that object alone."
            )
    return boxes


def labels_of(
    place: PlaceOptions, photos: Sequence[Path], packs: Sequence[str]
) -> dict[Path, tuple[Label, ...]]:
    """Return the labels of each photo that are of the classes, with packs in place of their names.

    Those of other classes, and points that the class does not name, are passed over with a line.
    """
    if place.labels is None:
        return {}
    of_photo = by_photo(read_labels(place.labels, note), photos, "labels", place.labels)
    classes = {pack: ObjectClass.load(pack) for pack in packs}
    known = {each.name.casefold(): pack for pack, each in classes.items()}
    taken, others = dict[Path, tuple[Label, ...]](), dict[str, None]()
    for photo, labels in of_photo.items():
        kept: list[Label] = []
        for label in labels:
            pack = packs[0] if label.name is None else known.get(label.name.strip().casefold())
            if pack is None:
                others[str(label.name)] = None
                continue
            points = {name: at for name, at in label.points.items() if name in classes[pack].points}
            others |= dict.fromkeys(f"the point {name}" for name in label.points.keys() - points.keys())
            if label.name is None and not label.problem and len(kept) == 1:  # those of the one object
                kept[0] = replace(kept[0], points={**kept[0].points, **points})
            elif points or label.problem or label.name is not None:
                kept.append(replace(label, name=pack, points=points))
        taken[photo] = tuple(kept)
    names = list_names(each.name for each in classes.values())
    if others and not any(taken.values()):
        raise UserError(
            f"expected labels of {names} in '{place.labels}'; got {list_names(others)}."
            " Name the class with --class."
        )
    if others:
        note(f"labels of others than {names} passed over: {list_names(others)}")
    return taken


def classes_of(place: PlaceOptions, say: Callable[[str], None]) -> tuple[str, ...]:
    """Return the class, and others that `--class` names beside it; UserError where it names several in vain.

    say: Is called with lines on a mesh that is made ready.
    """
    if place.meshes:
        return _packs_of(place, say)
    if place.mesh is not None:
        if place.object_class != PlaceOptions.object_class or place.objects is not None:
            raise UserError("expected --mesh, --class or --objects; got two of them. Give one.")
        return (str(pack_of_mesh(place.mesh, place.length, say, place.up)),)
    for name in ("length", "up"):
        if getattr(place, name) is not None:
            raise UserError(f"expected --{name} with --mesh, which it describes; got it alone. Give both.")
    several = place.objects is not None and not Path(place.object_class).exists()
    first, *others = place.object_class.split(",") if several else [place.object_class]
    if "," in first and not Path(first).exists():
        raise UserError(
            f"expected one --class, or --objects with several; got '{first}'. Give each box its class."
        )
    return first, *others


def _packs_of(place: PlaceOptions, say: Callable[[str], None]) -> tuple[str, ...]:
    """Return the class packs of --meshes; say which files cannot be used, and leave them out."""
    alone = (place.mesh, place.length, place.up, place.box) == (None,) * 4
    if not alone or place.object_class != PlaceOptions.object_class:
        raise UserError("expected --meshes without --mesh, --length, --up, --box and --class; got one.")
    if missing := [path for path in place.meshes if not path.exists()]:
        raise UserError(f"expected --meshes, {' '.join(SUFFIXES)} or folders; got no '{missing[0]}'.")
    if place.boxes is None and not Keypoints.available():
        raise UserError(
            "expected --boxes with --meshes, or the package opencv-python-headless, which finds them; got"
            ' neither. pip install "vig[match]".'
        )
    files = [
        file
        for path in place.meshes
        for file in (sorted(path.glob("*")) if path.is_dir() else [path])
        if not path.is_dir() or file.suffix.lower() in SUFFIXES
    ]
    packs, known = [], dict[bytes, str]()
    for number, file in enumerate(files, 1):
        try:
            pack = pack_of_mesh(file, None, lambda line: None)
            surface = Surface.load(pack)
            content = surface.vertices.tobytes() + surface.texels.tobytes()
            content = hashlib.sha256(content).digest()
            if content in known:
                raise UserError(f"it is the same as '{known[content]}'")
            if surface.one_colour:
                raise UserError("it has one colour alone")
        except (OSError, UserError) as error:
            say(f"'{file.name}' is left out: {error}")
            continue
        known[content] = file.name
        packs.append(str(pack))
        say(f"{number} of {len(files)}: '{file.name}' is ready")
    if not packs:
        raise UserError(
            f"expected --meshes of {' '.join(SUFFIXES)} files, or folders of them; got none of use."
        )
    return tuple(packs)


def parse_box(text: str) -> Box:
    """Return "x,y,w,h" as four numbers; UserError when it is not."""
    try:
        return check_box(text.replace(" ", "").split(","))
    except UserError:
        raise UserError(f"expected --box x,y,w,h in pixels, such as 40,30,200,160; got '{text}'") from None


def _read(entry: Any, class_name: str) -> tuple[Box | None, Objects]:
    """Return one photo's box or objects from the file."""
    if not isinstance(entry, list) or not entry:
        raise ValueError("what it has for a photo is not a list with something in it")
    if not isinstance(entry[0], list | dict):
        return _box(entry), ()
    objects = tuple(_object(item, class_name) for item in entry)
    if len(objects) > MAX_OBJECTS:
        raise ValueError(f"a photo has {len(objects)} boxes, more than {MAX_OBJECTS}")
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
    return check_box(numbers)
