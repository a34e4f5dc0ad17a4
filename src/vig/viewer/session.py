"""What a user does with one photo: every correction is a state, fitted anew, and can be taken back."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
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
        """Photo, class and state that `Session.save` wrote; UserError where they cannot be read."""
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
            raise UserError(f"{folder} holds no {CORRECTIONS} of vig view; name a photo.") from None
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise UserError(f"cannot read {path}: {error!r}; name the photo itself.") from None


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
        folder = Path(object_class)
        self.object_class = str(folder.resolve()) if folder.is_dir() else object_class
        self.explainer, self.path = explainer, Path(photo)
        self.photo, self.focal = coded_photo(photo), focal_of(photo)
        self.states: list[State] = []
        self.explanation = self._taken(state or State())

    @property
    def state(self) -> State:
        """What is said now."""
        return self.states[-1]

    def draw_box(self, x: float, y: float, width: float, height: float) -> Explanation:
        """A box round the whole object, cut at the photo's edges; what was found before no longer counts."""
        most = self.photo.shape[1], self.photo.shape[0]
        left, top = max(x, 0.0), max(y, 0.0)
        right, bottom = min(x + width, float(most[0])), min(y + height, float(most[1]))
        return self._taken(replace(self.state, box=(left, top, right - left, bottom - top)))

    def place(self, name: str, x: float, y: float) -> Explanation:
        """Where a named point of the class is."""
        return self._taken(replace(self.state, points={**self.state.points, name: (x, y)}))

    def mark(self, said: Said, x: float, y: float, radius: float) -> Explanation:
        """What a disc of the photo shows."""
        return self._taken(replace(self.state, marks=(*self.state.marks, Mark(x, y, radius, said))))

    def choose(self, azimuth_deg: float | None) -> Explanation:
        """Which view it is, to some 8 degrees; None leaves it open again."""
        return self._taken(replace(self.state, azimuth_deg=azimuth_deg))

    def hold(self, elevation_deg: float | None, roll_deg: float | None) -> Explanation:
        """Hold the eye's elevation and the photo's roll; None lets them free."""
        return self._taken(replace(self.state, elevation_deg=elevation_deg, roll_deg=roll_deg))

    def say_visible(self, visible: bool) -> Explanation:
        """Whether nothing hides any of the object."""
        return self._taken(replace(self.state, visible=visible))

    def clear(self) -> Explanation:
        """Take all back but the box."""
        return self._taken(State(box=self.state.box))

    def undo(self) -> Explanation:
        """Take the last correction back; nothing happens where there is none."""
        if len(self.states) > 1:
            self.explanation = self._explained(self.states[-2])
            self.states.pop()
        return self.explanation

    def save(self, folder: str | Path) -> Path:
        """Write what `vig fit` writes, and corrections.json, which `State.read` reads; returns the folder."""
        folder = self.explanation.save(folder, self.path.name)
        told = {
            "format": FORMAT,
            "photo": os.path.relpath(self.path, folder),
            "class": self.object_class,
            "state": asdict(self.state),
        }
        with atomic_write(folder / CORRECTIONS) as temporary:
            temporary.write_text(json.dumps(told, indent=2) + "\n")
        return folder

    def _taken(self, state: State) -> Explanation:
        self.explanation = self._explained(state)
        self.states.append(state)
        return self.explanation

    def _explained(self, state: State) -> Explanation:
        height, width = self.photo.shape[:2]
        given: dict[str, Any] = {"box": state.box, "focal": self.focal, "hints": state.hints(width, height)}
        try:
            return self.explainer.explain(self.photo, **given)
        except UserError as error:
            raise UserError(str(error).replace("the photo", self.path.name, 1)) from None
