"""Hints of the user of `vig fit` on the objects in the photos; `--K` and `--cameras`: their intrinsics."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vig.hints import Hints
from vig.inference import PixelLabel
from vig.io.checks import MAX_TABLE, read_json, reading
from vig.io.errors import UserError
from vig.photo.checks import refuse
from vig.photo.images import coded_photo
from vig.photo.lens import FIELDS, MATRICES, PARAMETERS
from vig.photo.masks import mask_files
from vig_app.cli.naming import by_photo
from vig_app.cli.options import CameraOptions, HintOptions, changed_options

MARK_CHANNELS = ((0, PixelLabel.IN_FRONT), (1, PixelLabel.SEEN), (2, PixelLabel.BACKGROUND))
"""Labels of a pixel of marks whose red, green or blue stands out."""
CAMERA_KEYS = {*MATRICES, PARAMETERS, *FIELDS[0]}
"""A mapping with one of these is a camera, not cameras by the photos' names."""
REMEDY = 'Write {"photo.jpg": [fx, fy, cx, cy]}, one camera for all, or name BOP\'s scene_camera.json.'


def hints_of(options: HintOptions, photos: Sequence[Path]) -> Hints | None:
    """Return the hints on each photo, but for its mask; UserError where something cannot be used."""
    for name in changed_options(options) if len(photos) > 1 else ():
        if name in ("marks", "points", "azimuth", "pose"):
            raise UserError(f"expected one photo with --{name}; got {len(photos)}. Fit them one by one.")
    hints = Hints(
        marks=None if options.marks is None else read_marks(options.marks),
        visible=options.visible,
        points=dict(map(parse_point, options.points)),
        azimuth_deg=options.azimuth,
        elevation_deg=options.elevation,
        roll_deg=options.roll,
        pose=None if options.pose is None else read_pose(options.pose),
    )
    return hints or None


def mask_of(path: Path | None, photos: Sequence[Path]) -> Callable[[Path], Path | None]:
    """Return the function from a photo to its mask file; UserError for one mask of several photos."""
    if path is None or not path.is_dir():
        if path is not None and len(photos) > 1:
            raise UserError(f"expected --mask FOLDER for {len(photos)} photos; got '{path}'. Name one.")
        return lambda photo: path
    names = mask_files(path, photos)
    owners: dict[Path, Path] = {}
    for photo, name in zip(photos, names, strict=True):
        owner = owners.setdefault(name, photo)
        if owner is not photo and owner.resolve() != photo.resolve():
            raise UserError(
                f"expected a mask for each photo; got '{name}' for {owner} and {photo}."
                " Put the masks into folders named as the photos' folders are."
            )
    return dict(zip(photos, names, strict=True)).__getitem__


def parse_point(text: str) -> tuple[str, tuple[float, float]]:
    """Return "spout=120,80" as a name and a place; UserError when it is not."""
    name, equals, place = text.partition("=")
    try:
        x, y = (float(number) for number in place.split(","))
    except ValueError:
        name = ""
    if not name or not equals:
        raise UserError(f"expected --points NAME=x,y in pixels, such as spout=120,80; got '{text}'") from None
    return name, (x, y)


def read_marks(path: Path) -> np.ndarray:
    """Return marks (H, W) uint8, `PixelLabel`, from a picture."""
    if (picture := coded_photo(path)).dtype != np.uint8:
        refuse(path, "an 8-bit picture without transparency", "another", "Save it so.")
    colours = picture.astype(int)
    marks = np.zeros(colours.shape[:2], np.uint8)
    for channel, kind in MARK_CHANNELS:
        others = np.delete(colours, channel, axis=-1).max(-1)
        # 80: by how much that channel is above the others, of 255
        marks[colours[..., channel] - others > 80] = kind
    if not marks.any():
        refuse(path, "pure red, green or blue marks", "none", "Draw on a black or grey copy of the photo.")
    return marks


def read_pose(path: Path) -> np.ndarray:
    """Return a pose from JSON: lists of four numbers, or an object with them as `camera_from_object`."""
    with reading(path, "a 4 x 4 camera_from_object", "Write four lists of four numbers."):
        content: Any = read_json(path)
        if isinstance(content, dict):
            camera = content.get("camera", {})
            content = content.get("camera_from_object", camera.get("camera_from_object"))
        pose = np.array(content, float)
        if pose.size == 16:
            pose = pose.reshape(4, 4)
        if pose.shape not in ((4, 4), (3, 4)):  # without its last row, which `Hints.check` adds
            raise ValueError(f"its shape is {pose.shape}")
    return pose


def cameras_of(options: CameraOptions, photos: Sequence[Path]) -> list[Any]:
    """Return the camera of each photo as `vig.photo.Intrinsics.of` takes it; None where none is given.

    UserError where a file cannot be used, has no camera for a photo, or options exclude each other.
    """
    if options.intrinsics is None and options.cameras is None:
        return [None] * len(photos)
    if len(changed_options(options)) > 1:
        raise UserError("expected one of --K, --cameras and --focal; got two of them. Give one.")
    if options.intrinsics is not None:
        return [_parse_lens(options.intrinsics)] * len(photos)
    assert options.cameras is not None
    with reading(options.cameras, "cameras by the photos' names", REMEDY):
        content = read_json(options.cameras, MAX_TABLE)
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
    return name.isdecimal() and len(name) < 19


def _parse_lens(text: str) -> tuple[float, ...]:
    """Return "fx,fy,cx,cy" as four numbers; UserError when it is not."""
    try:
        numbers = tuple(float(number) for number in text.replace(" ", "").split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 4:
        raise UserError(f"expected --K fx,fy,cx,cy in pixels, such as 910,910,640,360; got '{text}'")
    return numbers
