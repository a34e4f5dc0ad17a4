"""`--K` and `--cameras`: the intrinsics of the photos."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vig.io.checks import MOST_TABLE, read_json, reading
from vig.io.errors import UserError
from vig.photo.lens import FIELDS, MATRICES, PARAMETERS
from vig_app.cli.naming import by_photo
from vig_app.cli.options import CameraOptions, given

CAMERA_KEYS = {*MATRICES, PARAMETERS, *FIELDS[0]}
"""A mapping with one of these is a camera, not cameras by the photos' names."""
MOST_DIGITS = 19
"""Digits of a photo's number."""
REMEDY = 'Write {"photo.jpg": [fx, fy, cx, cy]}, one camera for all, or name BOP\'s scene_camera.json.'


def cameras_of(options: CameraOptions, photos: Sequence[Path]) -> list[Any]:
    """Return the camera of each photo as `vig.photo.Intrinsics.of` takes it; None where none is given.

    UserError where a file cannot be used, has no camera for a photo, or options exclude each other.
    """
    if options.intrinsics is None and options.cameras is None:
        return [None] * len(photos)
    if len(given(options)) > 1:
        raise UserError("expected one of --K, --cameras and --focal; got two of them. Give one.")
    if options.intrinsics is not None:
        return [_parsed(options.intrinsics)] * len(photos)
    assert options.cameras is not None
    with reading(options.cameras, "cameras by the photos' names", REMEDY):
        content = read_json(options.cameras, MOST_TABLE)
        if isinstance(content, list) or (isinstance(content, dict) and content.keys() & CAMERA_KEYS):
            return [content] * len(photos)
        if not isinstance(content, dict) or not content:
            raise ValueError("it holds no camera")
    numbered = all(map(_is_number, content))  # as in BOP's scene_camera.json
    if numbered:
        by_number = {int(name): camera for name, camera in content.items()}
        found = {photo: int(photo.stem) for photo in photos if _is_number(photo.stem)}
        of_photo = {photo: by_number[number] for photo, number in found.items() if number in by_number}
    else:
        of_photo = by_photo(content, photos, "cameras", options.cameras)
    for photo in photos:
        if photo not in of_photo:
            raise UserError(f"expected a camera of '{photo}' in '{options.cameras}'; it has none. {REMEDY}")
    scenes = {folder.resolve().parent for folder in {photo.parent for photo in photos}} if numbered else ()
    if len(scenes) > 1:
        raise UserError(
            f"expected photos of one scene with '{options.cameras}', whose cameras are numbered; got"
            f" {len(scenes)} scenes. Fit them one by one."
        )
    return [of_photo[photo] for photo in photos]


def _is_number(name: str) -> bool:
    return name.isdecimal() and len(name) < MOST_DIGITS


def _parsed(text: str) -> tuple[float, ...]:
    """Return "fx,fy,cx,cy" as four numbers; UserError when it is not."""
    try:
        numbers = tuple(float(number) for number in text.replace(" ", "").split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 4:
        raise UserError(f"expected --K fx,fy,cx,cy in pixels, such as 910,910,640,360; got '{text}'")
    return numbers
