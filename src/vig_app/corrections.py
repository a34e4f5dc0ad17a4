"""corrections.json: a photo, the class and a user's hints on the object, with which work is resumed."""

import math
import os
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vig.explainer import Box, Explainer, check_focal
from vig.explanation import Explanation
from vig.hints import Hints, PlainHints
from vig.inference import PixelLabel
from vig.inference.presence import judge_presence
from vig.io.checks import decode, read_json, reading
from vig.io.errors import UserError
from vig.io.files import write_json
from vig.photo import Intrinsics, Window, focal_of
from vig.photo.window import BOX_BELOW_CENTRE, WINDOW_OVER_BOX
from vig.scene import ObjectClass
from vig.scene.object_class import PACKAGED

CORRECTIONS = "corrections.json"
REMEDY = "It was corrected by hand and stays; move it away to fit without it."
FORMAT = 1


@dataclass(frozen=True, kw_only=True)
class State(PlainHints):
    """All that a user knows of a photo; places are in its pixels, angles in degrees.

    `camera` is fx, fy, cx, cy of its lens; `found` is the probability of presence
    of an object that vig found, whose box is not the user's; 0 where the user states that there is none.
    """

    box: Box | None = None
    focal: float | None = None
    camera: tuple[float, float, float, float] | None = None
    found: float | None = None

    def hints(self, width: int, height: int, others: np.ndarray | None = None) -> Hints:
        """Return the library's hints; in pixels `others` (H, W) bool other objects are visible."""
        marks = None
        if others is not None:
            marks = np.where(others, np.uint8(PixelLabel.IN_FRONT), np.uint8(0))
        return Hints(marks=marks, **self.plain)

    def check(self, width: int, height: int, object_class: ObjectClass) -> None:
        """Raise UserError where something does not suit a photo of this size or the class."""
        if self.box is not None:
            Window.of(width, height, self.box)
        if self.focal is not None:
            check_focal(self.focal)
        if self.camera is not None:
            Intrinsics.of(self.camera, width, height)
        self.hints(width, height).check(width, height, object_class)

    def to_json(self) -> dict[str, Any]:
        """Return the content of corrections.json and of the page of `vig view`."""
        content = asdict(self)
        first = {"box": content.pop("box"), "points": content.pop("points"), "marks": content.pop("strokes")}
        return first | content

    def explain(
        self, explainer: Explainer, path: Path, photo: np.ndarray, others: np.ndarray | None = None
    ) -> Explanation:
        """Explain the photo (H, W, 3) of a file with these hints; `others` as of `hints`.

        Raises:
            UserError: See `Explainer.explain`.
        """
        height, width = photo.shape[:2]
        given = self.focal is not None or self.camera is not None
        focal = self.focal if given else focal_of(path)
        hints = self.hints(width, height, others)
        try:
            explanation = explainer.explain(photo, self.box, focal=focal, hints=hints, K=self.camera)
        except UserError as error:
            raise UserError(str(error).replace("the photo", path.name, 1)) from None
        exif = not given and focal is not None and explainer.settings.camera_distance_ratio is None
        explanation = replace(explanation, focal_from="exif") if exif else explanation
        if self.found is not None and (explanation.hints or Hints()).clues() is None:
            name = explainer.object_class.name
            fit = judge_presence(explanation.fit, self.found, name)
            if not self.found:
                fit = replace(fit, reason=f"{name}: marked by hand as not there", present=math.nan)
            explanation = replace(explanation, fit=fit)
        return explanation if others is None else replace(explanation, others=others)

    def write(
        self,
        folder: Path,
        photo: Path,
        object_class: ObjectClass,
        corrected: bool = False,
        object_box: Box | None = None,
    ) -> None:
        """Write the file that `read` reads into a folder of results; it names the photo from there.

        Args:
            folder: Folder of the results.
            photo: Its file.
            object_class: Class as which it was explained.
            corrected: Whether by hand, so that `vig fit` takes it in place of its own hints.
            object_box: Box of one of several objects, uncorrected; by default that of the file there.

        Raises:
            UserError: It cannot be written.
        """
        pack = object_class.folder
        packaged = pack is None or pack.resolve() == (PACKAGED / object_class.name).resolve()
        if object_box is None:
            with suppress(OSError, ValueError, KeyError, TypeError):
                object_box = read_json(folder / CORRECTIONS)["object_box"]
        content = {
            "format": FORMAT,
            "photo": os.path.relpath(photo.resolve(), folder.resolve()),
            "class": object_class.name if packaged else str(pack and pack.resolve()),
            "corrected": corrected,
            "object_box": object_box,
            "state": self.to_json(),
        }
        write_json(folder / CORRECTIONS, content)

    @staticmethod
    def read(folder: Path, remedy: str = "Name the photo itself.") -> "tuple[Path, str, State]":
        """Return the photo, class and state from a file of `write`; UserError with a remedy if unreadable."""
        path = folder / CORRECTIONS
        with reading(path, "corrections of a photo", remedy):
            content = decode(dict[str, Any], read_json(path))
            if content["format"] != FORMAT:
                raise ValueError(f"it is of format {content['format']}, where this vig reads {FORMAT}")
            photo, object_class = (decode(str, content[name]) for name in ("photo", "class"))
            state = decode(dict[str, Any], content["state"])
            state["strokes"] = state.pop("marks")
            return folder / photo, object_class, decode(State, state)


@dataclass(frozen=True)
class Correction:
    """A correction by hand of one object.

    Attributes:
        name: Name of the object's folder among those of several; "" for a photo's one object.
        state: The hints; None where they cannot be taken.
        box: Box of the object as it was without corrections; None where that is unknown.
        problem: Why the hints cannot be taken, a line; "" where they can.
    """

    name: str
    state: State | None
    box: Box | None = None
    problem: str = ""


def read_corrections(folder: Path, object_class: str | Path | None = None) -> tuple[Correction, ...]:
    """Return the corrections by hand in the folder of a photo's results: those of its one object, which must
    be of a class, or of several. Files that do not say whether they were corrected (older ones) are skipped.
    """
    names = {str(object_class), str(Path(object_class or "").resolve())}
    corrections = []
    for path in [folder / CORRECTIONS, *sorted(folder.glob(f"[0-9]*-*/{CORRECTIONS}"))]:
        name = "" if path.parent == folder else path.parent.name
        try:
            with reading(path, "corrections of a photo", REMEDY):
                content = decode(dict[str, Any], read_json(path)) if path.exists() else {}
                if not content.get("corrected"):
                    continue
                _, of_class, state = State.read(path.parent, REMEDY)
                if not name and object_class is not None and of_class not in names:
                    raise UserError(
                        f"expected corrections of a {object_class} at '{path}'; got {of_class}. {REMEDY}"
                    )
                box = decode(Box | None, content.get("object_box")) or state.box
                corrections.append(Correction(name, state, box))
        except UserError as error:
            corrections.append(Correction(name, None, problem=str(error)))
    return tuple(corrections)


def place_of(explanation: Explanation) -> Box:
    """Return the box that an explanation was given, else that of its window."""
    if explanation.box is not None:
        x, y, width, height = map(float, explanation.box)
        return x, y, width, height
    return box_of(explanation.window)


def box_of(window: Window) -> Box:
    """Return the inverse of `Window.round_box`, a square."""
    side, (x, y) = window.side / WINDOW_OVER_BOX, window.centre
    return x - side / 2, y + BOX_BELOW_CENTRE * window.side - side / 2, side, side
