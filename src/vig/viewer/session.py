"""What a user does with one photo: every correction is a state, fitted anew, and can be taken back."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from vig.errors import UserError
from vig.explainer import Box, Explainer
from vig.explanation import Explanation
from vig.files import atomic_write
from vig.hints import Hints
from vig.inference import Said
from vig.photo import focal_of
from vig.photo.images import coded_photo

CORRECTIONS = "corrections.json"
FORMAT = 1
KEPT = 200
"""States that can be gone back to, at most."""


@dataclass(frozen=True)
class Mark:
    """A disc that a user painted: its middle and radius in pixels of the photo, and what it says."""

    x: float
    y: float
    radius: float
    said: Said

    def paint(self, marks: np.ndarray) -> None:
        """Set the pixels of marks (H, W) uint8 whose centres lie within."""
        left, top = (max(math.floor(middle - self.radius), 0) for middle in (self.x, self.y))
        right, bottom = (max(math.ceil(middle + self.radius), 0) for middle in (self.x, self.y))
        part = marks[top:bottom, left:right]
        rows, columns = np.ogrid[: part.shape[0], : part.shape[1]]
        part[np.hypot(columns + left + 0.5 - self.x, rows + top + 0.5 - self.y) <= self.radius] = self.said


@dataclass(frozen=True)
class State:
    """All that a user has said of a photo; places are in its pixels, angles in degrees."""

    box: Box | None = None
    points: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    marks: tuple[Mark, ...] = ()
    visible: bool = False
    azimuth_deg: float | None = None
    elevation_deg: float | None = None
    roll_deg: float | None = None
    focal: float | None = None

    @staticmethod
    def of(box: Box | None, focal: float | None, hints: Hints | None) -> State | None:
        """What was said to `Explainer.explain`; None where a mask, marks or a pose were among it."""
        hints = hints or Hints()
        if any(each is not None for each in (hints.mask, hints.marks, hints.pose)):
            return None
        angles = hints.azimuth_deg, hints.elevation_deg, hints.roll_deg
        return State(box, dict(hints.points), (), hints.visible, *angles, focal)

    def hints(self, width: int, height: int) -> Hints:
        """The same as the library takes it."""
        marks = None
        if self.marks:
            marks = np.zeros((height, width), np.uint8)
            for mark in self.marks:
                mark.paint(marks)
        return Hints(
            marks=marks,
            visible=self.visible,
            points=dict(self.points),
            azimuth_deg=self.azimuth_deg,
            elevation_deg=self.elevation_deg,
            roll_deg=self.roll_deg,
        )

    @staticmethod
    def read(folder: Path) -> tuple[Path, str, State]:
        """Photo, class and state that `write` wrote; UserError where they cannot be read."""
        path = folder / CORRECTIONS
        try:
            told = json.loads(path.read_text())
            photo, object_class, state = folder / told["photo"], str(told["class"]), dict(told["state"])
            box = state.pop("box")
            points = {str(name): (float(x), float(y)) for name, (x, y) in state.pop("points").items()}
            marks = tuple(
                Mark(float(mark["x"]), float(mark["y"]), float(mark["radius"]), Said(mark["said"]))
                for mark in state.pop("marks")
            )
            return photo, object_class, State(box and tuple(box), points, marks, **state)
        except FileNotFoundError:
            raise UserError(
                f"expected a photo or a result; '{folder}' holds no {CORRECTIONS}. Name the photo itself."
            ) from None
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise UserError(f"cannot read {path}: {error!r}; name the photo itself.") from None

    def write(self, folder: Path, photo: Path, object_class: str) -> None:
        """Write what `read` reads into a folder that exists; the photo is named from there.

        Args:
            folder: Of the results.
            photo: A file.
            object_class: What `Explainer` loads the class by.

        Raises:
            UserError: It cannot be written.
        """
        pack = Path(object_class)
        told = {
            "format": FORMAT,
            "photo": os.path.relpath(photo, folder),
            "class": str(pack.resolve()) if pack.is_dir() else object_class,
            "state": asdict(self),
        }
        with atomic_write(folder / CORRECTIONS) as temporary:
            temporary.write_text(json.dumps(told, indent=2) + "\n")


Change = Callable[[State], State]
"""What one correction makes of a state."""


class Session:
    """One photo, its explanation, and the states that led there.

    Every method that says something fits the photo again and returns the new explanation; where that cannot
    be done it raises UserError and leaves all as it was.
    """

    def __init__(
        self,
        explainer: Explainer,
        photo: str | Path,
        state: State | None = None,
        object_class: str = "teapot",
    ) -> None:
        """Open a photo and explain it with what is said of it.

        Args:
            explainer: Of the class.
            photo: A file.
            state: What is said at first.
            object_class: What `Explainer` loads the class by.

        Raises:
            UserError: As `Explainer.explain` does.
        """
        self.explainer, self.path, self.object_class = explainer, Path(photo), object_class
        self.photo, self.focal = coded_photo(photo), focal_of(photo)
        self.states = [state or State()]
        self.explanation = self._explained(self.state)

    @property
    def state(self) -> State:
        """What is said now."""
        return self.states[-1]

    def correct(self, *changes: Change | None) -> Explanation:
        """Make corrections in their order and fit once; None takes the last one back, where there is one.

        Raises:
            UserError: As `Explainer.explain` does; then none of them was made.
        """
        states = [*self.states]
        for change in changes:
            if change is not None:
                states.append(change(states[-1]))
            elif len(states) > 1:
                states.pop()
        if states[-1] != self.state:
            self.explanation = self._explained(states[-1])
        self.states = states[-KEPT:]
        return self.explanation

    def draw_box(self, x: float, y: float, width: float, height: float) -> Explanation:
        """A box round the whole object, cut at the photo's edges; what was found before no longer counts."""
        return self.correct(self.boxed(x, y, width, height))

    def boxed(self, x: float, y: float, width: float, height: float) -> Change:
        """The change that `draw_box` makes."""
        most = self.photo.shape[1], self.photo.shape[0]
        left, top = max(x, 0.0), max(y, 0.0)
        right, bottom = min(x + width, float(most[0])), min(y + height, float(most[1]))
        return lambda state: replace(state, box=(left, top, right - left, bottom - top))

    def place(self, name: str, x: float, y: float) -> Explanation:
        """Where a named point of the class is."""
        return self.correct(placed(name, x, y))

    def mark(self, said: Said, x: float, y: float, radius: float) -> Explanation:
        """What a disc of the photo shows."""
        return self.correct(marked(said, x, y, radius))

    def choose(self, azimuth_deg: float | None) -> Explanation:
        """Which view it is, to some 8 degrees; None leaves it open again."""
        return self.correct(lambda state: replace(state, azimuth_deg=azimuth_deg))

    def hold(self, elevation_deg: float | None, roll_deg: float | None) -> Explanation:
        """Hold the eye's elevation and the photo's roll; None lets them free."""
        return self.correct(lambda state: replace(state, elevation_deg=elevation_deg, roll_deg=roll_deg))

    def say_visible(self, visible: bool) -> Explanation:
        """Whether nothing hides any of the object."""
        return self.correct(lambda state: replace(state, visible=visible))

    def clear(self) -> Explanation:
        """Take all back but the box."""
        return self.correct(cleared)

    def undo(self) -> Explanation:
        """Take the last correction back; nothing happens where there is none."""
        return self.correct(None)

    def save(self, folder: str | Path) -> Path:
        """Write what `vig fit` writes; returns the folder."""
        folder = self.explanation.save(folder, self.path.name)
        self.state.write(folder, self.path, self.object_class)
        return folder

    def _explained(self, state: State) -> Explanation:
        height, width = self.photo.shape[:2]
        focal = self.focal if state.focal is None else state.focal
        given: dict[str, Any] = {"box": state.box, "focal": focal, "hints": state.hints(width, height)}
        try:
            found = self.explainer.explain(self.photo, **given)
            return found if state.focal is not None or focal is None else replace(found, focal_from="exif")
        except UserError as error:
            raise UserError(str(error).replace("the photo", self.path.name, 1)) from None


def placed(name: str, x: float, y: float) -> Change:
    """The change that `Session.place` makes."""
    return lambda state: replace(state, points={**state.points, name: (x, y)})


def marked(said: Said, x: float, y: float, radius: float) -> Change:
    """The change that `Session.mark` makes."""
    return lambda state: replace(state, marks=(*state.marks, Mark(x, y, radius, said)))


def cleared(state: State) -> State:
    """The change that `Session.clear` makes."""
    return State(box=state.box, focal=state.focal)
