"""corrections.json: a photo, the class and a user's hints on the object, with which work is resumed."""

from __future__ import annotations

import math
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vig.hints import Hints
from vig.inference import PixelLabel
from vig.io.checks import decode, read_json, reading
from vig.io.errors import UserError
from vig.output import write_json
from vig.photo import Intrinsics, Window
from vig.scene import ObjectClass
from vig.scene.object_class import PACKAGED

CORRECTIONS = "corrections.json"
FORMAT = 1
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Mark:
    """A disc that a user painted: its middle and radius in pixels of the photo, and a `PixelLabel`."""

    x: float
    y: float
    radius: float
    said: int

    def paint(self, marks: np.ndarray) -> None:
        """Set the pixels of marks (H, W) uint8 whose centres lie within."""
        left, top = (max(math.floor(centre - self.radius), 0) for centre in (self.x, self.y))
        right, bottom = (max(math.ceil(centre + self.radius), 0) for centre in (self.x, self.y))
        part = marks[top:bottom, left:right]
        rows, columns = np.ogrid[: part.shape[0], : part.shape[1]]
        part[np.hypot(columns + left + 0.5 - self.x, rows + top + 0.5 - self.y) <= self.radius] = self.said


@dataclass(frozen=True)
class State:
    """All that a user knows of a photo; places are in its pixels, angles in degrees.

    `camera` is fx, fy, cx, cy of its lens.
    """

    box: Box | None = None
    points: dict[str, tuple[float, float]] = field(default_factory=dict)
    marks: tuple[Mark, ...] = ()
    visible: bool = False
    azimuth_deg: float | None = None
    elevation_deg: float | None = None
    roll_deg: float | None = None
    focal: float | None = None
    camera: tuple[float, float, float, float] | None = None

    @staticmethod
    def of(
        box: Box | None,
        focal: float | None,
        hints: Hints | None,
        camera: tuple[float, float, float, float] | None = None,
    ) -> State | None:
        """What `Explainer.explain` was given; None where a mask, marks or a pose were among it."""
        hints = hints or Hints()
        if any(hint is not None for hint in (hints.mask, hints.marks, hints.pose)):
            return None
        angles = hints.azimuth_deg, hints.elevation_deg, hints.roll_deg
        return State(box, dict(hints.points), (), hints.visible, *angles, focal, camera)

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

    def check(self, width: int, height: int, object_class: ObjectClass) -> None:
        """Raise UserError where something does not suit a photo of this size or the class."""
        if self.box is not None:
            Window.of(width, height, self.box)
        for mark in self.marks:
            reach = mark.radius if 0 < mark.radius <= width + height else math.nan
            inside = -reach < mark.x < width + reach and -reach < mark.y < height + reach
            if not inside or mark.said not in list(PixelLabel):
                raise UserError(
                    f"expected marks on the photo, 0 to {width}, 0 to {height}; got one at {mark.x:g},"
                    f" {mark.y:g}. Choose another place."
                )
        if self.focal is not None and not 0 < self.focal < math.inf:
            raise UserError(f"expected a focal length in pixels, above 0; got {self.focal!r}. Leave it out.")
        if self.camera is not None:
            Intrinsics.of(self.camera, width, height)
        self.hints(width, height).checked(width, height, object_class)

    def write(self, folder: Path, photo: Path, object_class: ObjectClass) -> None:
        """Write what `read` reads into a folder of results, from which the photo is named.

        Raises:
            UserError: It cannot be written.
        """
        pack = object_class.folder
        packaged = pack is None or pack.resolve() == (PACKAGED / object_class.name).resolve()
        content = {
            "format": FORMAT,
            "photo": os.path.relpath(photo.resolve(), folder.resolve()),
            "class": object_class.name if packaged else str(pack and pack.resolve()),
            "state": asdict(self),
        }
        write_json(folder, content, CORRECTIONS)

    @staticmethod
    def read(folder: Path) -> tuple[Path, str, State]:
        """Photo, class and state that `write` wrote; UserError where they cannot be read."""
        path = folder / CORRECTIONS
        if not path.exists():
            inner = sorted(file.parent for file in folder.glob(f"*/{CORRECTIONS}"))
            remedy = f"Name one in it, such as '{inner[0]}'." if inner else "Name the photo itself."
            raise UserError(f"expected a photo or a result; '{folder}' holds no {CORRECTIONS}. {remedy}")
        with reading(path, "corrections of a photo", "Name the photo itself."):
            content = decode(dict[str, Any], read_json(path))
            if content["format"] != FORMAT:
                raise ValueError(f"it is of format {content['format']}, where this vig reads {FORMAT}")
            photo, object_class = (decode(str, content[name]) for name in ("photo", "class"))
            return folder / photo, object_class, decode(State, content["state"])


def result_in(folder: Path) -> Path:
    """The one folder of a result in that of a run; the folder itself where it is one or holds several."""
    inner = [] if (folder / CORRECTIONS).exists() else list(folder.glob(f"*/{CORRECTIONS}"))
    return inner[0].parent if len(inner) == 1 else folder
