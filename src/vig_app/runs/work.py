"""What a run does with one photo: its folder, complete or not there, and its rows."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vig.explainer import Box, Explainer
from vig.explanation import Explanation
from vig.hints import Hints
from vig.inference import ExplainSettings
from vig.io.errors import UserError
from vig.parallel import Lost
from vig.photo.masks import read_mask
from vig.several import explain_found, explain_together
from vig_app.corrections import CORRECTIONS, State
from vig_app.exports import remove_exports
from vig_app.results import COLUMNS

PARTIAL, KEY = ".partial", ".key"
FILES = (
    "explanation.json", "scene.json", CORRECTIONS, "mask.png", "object.glb", "overlay.png", "render.png",
    "report.html", "thumbnail.jpg",
)  # fmt: skip
"""Of a photo's results, whether of one object or of several."""


@dataclass(frozen=True)
class Task:
    """One photo, the folder of its results, and what is said of it.

    Attributes:
        photo: Its file.
        folder: Within that of the run.
        box: Round its one object; None where that is to be found.
        focal: In pixels, where it is known.
        hints: On its one object.
        mask: A file, read with the photo.
        objects: Class and box of each of several objects, which are explained together.
        most: So many objects, of any of the run's classes, are to be found and explained together.
        camera: Its intrinsics in place of the focal length, as `vig.photo.Intrinsics.of` takes them.
        key: Tells what the results depend on; it is kept beside them, see `vig_app.runs.ledger`.
    """

    photo: Path
    folder: Path
    box: Box | None = None
    focal: float | None = None
    hints: Hints | None = None
    mask: Path | None = None
    objects: tuple[tuple[str, Box], ...] = ()
    most: int = 0
    camera: Any = None
    key: str = ""


Rows = list[dict[str, Any]]
"""Of one photo: a row for each object, or one with the error."""


@dataclass(frozen=True)
class RunSettings:
    """What a run does with each photo.

    Attributes:
        object_class: A packaged class or the folder of a pack.
        others: Further classes that objects may be of, where a photo has several.
        explain: How to fit.
        device: See `Explainer`.
        export: Formats that are written, too; see `Explanation.export`.
    """

    object_class: str | Path = "teapot"
    explain: ExplainSettings = ExplainSettings()
    device: str = "cpu"
    export: tuple[str, ...] = ()
    others: tuple[str, ...] = ()


def prepare(settings: RunSettings) -> Callable[[Task], Rows]:
    """The work of a worker process."""
    return Work(Explainer(settings.object_class, settings.explain, settings.device), settings)


class Work:
    """Explains a photo, writes its folder, and returns its rows, one for each object."""

    def __init__(self, explainer: Explainer, settings: RunSettings):
        self.explainer, self.settings, self.export = explainer, settings, settings.export
        self.by_class = {str(settings.object_class): explainer}

    def __call__(self, task: Task) -> Rows:
        began = time.monotonic()
        try:
            if task.objects or task.most:
                rows = self.several(task)
                seconds = round(time.monotonic() - began, 3)
                return [row | {"seconds": seconds} for row in rows]
            hints = task.hints
            if task.mask is not None:
                hints = replace(hints or Hints(), mask=read_mask(task.mask))
            found = self.explainer.explain(
                task.photo, task.box, focal=task.focal, hints=hints, camera=task.camera
            )
            self.write(task, found)
        except UserError as error:
            return failed(task, error)
        return [row_of(task, found) | {"seconds": round(time.monotonic() - began, 3)}]

    def of_class(self, name: str) -> Explainer:
        """The explainer of a class, which is loaded when it is first needed."""
        if name not in self.by_class:
            self.by_class[name] = Explainer(name, self.settings.explain, self.settings.device)
        return self.by_class[name]

    def several(self, task: Task) -> Rows:
        """The rows of a photo of several objects."""
        if task.objects:
            explainers = [self.of_class(name) for name, _ in task.objects]
            boxes = [box for _, box in task.objects]
            scene = explain_together(task.photo, explainers, boxes, task.focal, task.camera)
        else:
            names = (str(self.settings.object_class), *self.settings.others)
            explainers = [self.of_class(name) for name in names]
            scene = explain_found(task.photo, explainers, task.most, task.focal, task.camera)
        with beside_folder(task) as beside:
            scene.save(beside, task.photo.name, self.export)
        return [
            row_of(task, found) | {"folder": f"{task.folder.name}/{name}", "object": number}
            for number, (name, found) in enumerate(zip(scene.names, scene.objects, strict=True), 1)
        ]

    def write(self, task: Task, found: Explanation) -> None:
        """All files of a photo beside its folder, then in their place; see `beside_folder`."""
        with beside_folder(task) as beside:
            found.save(beside, task.photo.name)
            found.export(beside, self.export, task.photo.name)
            lens = None if task.camera is None else found.window.lens
            camera = None if lens is None else (lens.fx, lens.fy, lens.cx, lens.cy)
            said = State.of(task.box, task.focal, found.hints, camera)
            if said is not None:  # named from where it will be, which is as deep
                said.write(beside, task.photo, found.object_class)


@contextmanager
def beside_folder(task: Task) -> Iterator[Path]:
    """A folder to write into; when the block ends well it takes the place of the photo's, else it goes.

    Where the photo's folder is there its files are replaced one by one, those of earlier results that are not
    made anew go, and what else is there stays. Without `KEY`, which goes first and comes last, a folder is
    not taken for done.
    """
    beside = task.folder.with_name(f".{task.folder.name}{PARTIAL}")
    shutil.rmtree(beside, ignore_errors=True)
    try:
        yield beside
        if task.key:
            (beside / KEY).write_text(task.key)
        if not os.path.lexists(task.folder):
            os.rename(beside, task.folder)
            return
        for name in (KEY, *FILES):
            (task.folder / name).unlink(missing_ok=True)
        remove_exports(task.folder)
        for path in task.folder.glob("[0-9]*-*/explanation.json"):  # of several objects
            shutil.rmtree(path.parent)
        for path in sorted(beside.iterdir(), key=lambda path: path.name == KEY):
            os.replace(path, task.folder / path.name)
    except OSError as error:
        raise UserError(
            f"cannot write {task.folder}: {error.strerror or error}; choose another --out."
        ) from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def row_of(task: Task, found: Explanation) -> dict[str, Any]:
    """The row of a photo that was explained."""
    said = found.to_dict()
    camera, deviation = said["camera"], said["deviation"]
    pose = {
        f"camera_from_object_{row}{column}": camera["camera_from_object"][row][column]
        for row in range(3)
        for column in range(4)
    }
    box = dict(zip(("box_x", "box_y", "box_width", "box_height"), said["box"] or [None] * 4, strict=True))
    row = {
        "photo": str(task.photo),
        "folder": task.folder.name,
        "object": 1,
        "error": None,
        "view_trusted": "view" in said["trusted"],
        "mask_trusted": "mask" in said["trusted"],
        "azimuth_deviation_deg": deviation["azimuth_deg"],
        "elevation_deviation_deg": deviation["elevation_deg"],
        **dict(zip(("albedo_r", "albedo_g", "albedo_b"), said["albedo"], strict=True)),
        **box,
        "width": camera["width"],
        "height": camera["height"],
        "focal_px": camera["K"][0][0],
        "center_x": camera["K"][0][2],
        "center_y": camera["K"][1][2],
        "focal_from": camera["focal_from"],
        **pose,
    }
    return {name: row[name] if name in row else said.get(name) for name in COLUMNS}


def failed(task: Task, error: object) -> Rows:
    """The one row of a photo that was not explained; the reason names the photo."""
    name, told = str(task.photo), str(error)
    told = told if str(UserError(name)) in told else f"{name}: {told}"
    return [dict.fromkeys(COLUMNS) | {"photo": name, "folder": task.folder.name, "error": told}]


def lost_row(task: Task, lost: Lost) -> Rows:
    return failed(
        task,
        f"{task.photo}: a worker process was killed {lost.attempts} times while it explained this photo,"
        " possibly out of memory; try it alone.",
    )
