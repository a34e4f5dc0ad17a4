"""What the user of `vig fit` says of the objects in the photos."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from vig.hints import Hints
from vig.inference import PixelLabel
from vig.io.checks import read_json, reading
from vig.io.errors import UserError
from vig.photo.checks import refuse
from vig.photo.images import eight_bit_photo
from vig.photo.masks import mask_file
from vig_app.cli.common import FitCommand

CHANNELS = ((0, PixelLabel.IN_FRONT), (1, PixelLabel.SEEN), (2, PixelLabel.NOTHING))
"""What a pixel of marks says whose red, green or blue is far above the others."""
FAR = 80
ONE_PHOTO = ("marks", "points", "azimuth", "pose")


def hints_of(settings: FitCommand, photos: list[Path]) -> Hints | None:
    """What is said of each photo, but for its mask; UserError where something cannot be used."""
    if len(photos) > 1:
        for name in ONE_PHOTO:
            if getattr(settings, name) not in (None, ()):
                raise UserError(f"expected one photo with --{name}; got {len(photos)}. Fit them one by one.")
    said = Hints(
        marks=None if settings.marks is None else read_marks(settings.marks),
        visible=settings.visible,
        points=dict(map(parse_point, settings.points)),
        azimuth_deg=settings.azimuth,
        elevation_deg=settings.elevation,
        roll_deg=settings.roll,
        pose=None if settings.pose is None else read_pose(settings.pose),
    )
    return said or None


def mask_of(settings: FitCommand, photos: list[Path]) -> Callable[[Path], Path | None]:
    """Tells the file of a photo's mask, which is read with the photo; UserError for one mask of several."""
    given = settings.mask
    if given is None or not given.is_dir():
        if given is not None and len(photos) > 1:
            raise UserError(f"expected --mask FOLDER for {len(photos)} photos; got '{given}'. Name one.")
        return lambda photo: given
    names = [mask_file(given, photo) for photo in photos]
    for name in names:
        if names.count(name) > 1 and len({photo.resolve() for photo in photos}) > 1:
            owners = [photo for photo, other in zip(photos, names, strict=True) if other == name]
            if len({photo.resolve() for photo in owners}) > 1:
                raise UserError(
                    f"expected a mask for each photo; got '{name}' for {owners[0]} and {owners[1]}."
                    " Put the masks into folders named as the photos' folders are."
                )
    return dict(zip(photos, names, strict=True)).__getitem__


def parse_point(text: str) -> tuple[str, tuple[float, float]]:
    """ "spout=120,80" as a name and a place; UserError when it is not."""
    name, equals, place = text.partition("=")
    try:
        x, y = (float(number) for number in place.split(","))
    except ValueError:
        name = ""
    if not name or not equals:
        raise UserError(f"expected --points NAME=x,y in pixels, such as spout=120,80; got '{text}'") from None
    return name, (x, y)


def read_marks(path: Path) -> np.ndarray:
    """Marks (H, W) uint8, `PixelLabel`, from a picture."""
    colours = eight_bit_photo(path).astype(int)
    marks = np.zeros(colours.shape[:2], np.uint8)
    for channel, kind in CHANNELS:
        others = np.delete(colours, channel, axis=-1).max(-1)
        marks[colours[..., channel] - others > FAR] = kind
    if not marks.any():
        refuse(path, "pure red, green or blue marks", "none", "Draw on a black or grey copy of the photo.")
    return marks


def read_pose(path: Path) -> np.ndarray:
    """A pose from JSON: four lists of four numbers, or an object that has them as `camera_from_object`."""
    with reading(path, "a 4 x 4 camera_from_object", "Write four lists of four numbers."):
        found: Any = read_json(path)
        if isinstance(found, dict):
            found = found.get("camera_from_object", found.get("camera", {}).get("camera_from_object"))
        pose = np.array(found, float)
        if pose.size == 16:
            pose = pose.reshape(4, 4)
        elif pose.shape == (3, 4):
            pose = np.concatenate([pose, [[0.0, 0, 0, 1]]])
        if pose.shape != (4, 4):
            raise ValueError(f"its shape is {pose.shape}")
    return pose
