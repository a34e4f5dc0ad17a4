"""A run's work on one photo: its folder, complete or not there, and its rows."""

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vig.explainer import Box, Explainer
from vig.explanation import Explanation
from vig.hints import Hints
from vig.inference import ExplainSettings
from vig.io.errors import UserError
from vig.parallel import Lost
from vig.photo.images import coded_photo
from vig.photo.masks import box_of, read_mask
from vig.recognition.object_map import box_overlap
from vig.several import explain_found, explain_together
from vig.several.scene import SceneExplanation
from vig_app.corrections import CORRECTIONS, REMEDY, Correction, State, place_of
from vig_app.exports import export_explanation, remove_exports
from vig_app.labels import Label
from vig_app.report.folder import FILES, OPTIONAL_FILES, save_explanation, save_scene
from vig_app.results import COLUMNS, row_of_record, without_dismissed

PARTIAL = ".partial"  # end of the name of a folder that is not complete
KEY = ".key"  # file within a folder with the key of its results, see `vig_app.runs.ledger.key_of`
RESULTS = (*FILES, *OPTIONAL_FILES, "scene.json", "scene.glb", CORRECTIONS)
"""Files of a photo's results, whether of one object or of several."""


@dataclass(frozen=True)
class Task:
    """One photo, the folder of its results, and the hints on it.

    Attributes:
        photo: Its file.
        folder: Folder of its results within that of the run.
        box: Box of its one object; None to find it.
        focal: Focal length in pixels, where it is known.
        hints: Hints on its one object.
        mask: A file, read with the photo.
        objects: Class and box of each of several objects, which are explained together.
        most: Number of objects, of any of the run's classes, to find and explain together.
        camera: Its intrinsics in place of the focal length, as `vig.photo.Intrinsics.of` takes them.
        corrected: Corrections by hand, see `vig_app.corrections.read_corrections`; in place of box, focal
            length, camera and hints of the one object, or of that of several.
        labels: Labels of its objects by a tool, checked with the photo: one of the run's class, or of up to
            `most`, whose names are then those of classes.
        key: Key of all that the results depend on, written with them; see `vig_app.runs.ledger.key_of`.
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
    corrected: tuple[Correction, ...] = ()
    labels: tuple[Label, ...] = ()
    key: str = ""


Rows = list[dict[str, Any]]  # rows of one photo: one for each object, or one with the error


@dataclass(frozen=True)
class RunSettings:
    """Settings of a run for each photo.

    Attributes:
        object_class: A packaged class or the folder of a pack.
        others: Further classes that objects may be of, where a photo has several.
        explain: Settings of the fit.
        export: Formats that are written, too; see `Explanation.export`.
        files: Files to write; see `Explanation.save`, as for full_size.
        full_size: Whether pictures are as large as the photos.
    """

    object_class: str | Path = "teapot"
    explain: ExplainSettings = ExplainSettings()
    export: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    files: tuple[str, ...] | None = None
    full_size: bool = False


def prepare(settings: RunSettings) -> Callable[[Task], Rows]:
    """Return the work of a worker process."""
    return Work(Explainer(settings.object_class, settings.explain), settings)


class Work:
    """Worker that explains a photo, writes its folder, and returns its rows, one for each object."""

    def __init__(self, explainer: Explainer, settings: RunSettings):
        self.explainer, self.settings = explainer, settings
        self.by_class = {str(settings.object_class): explainer}

    def __call__(self, task: Task) -> Rows:
        started = time.monotonic()
        try:
            for correction in task.corrected:
                if correction.problem:
                    raise UserError(correction.problem)
            task = apply_labels(task) if task.labels and not task.corrected else task
            rows = self.several(task) if task.objects or task.most else [self.one(task)]
        except UserError as error:
            return failure_rows(task, error)
        seconds = round(time.monotonic() - started, 3)
        return [row | {"seconds": seconds} for row in rows]

    def one(self, task: Task) -> dict[str, Any]:
        """Return the row of a photo of one object."""
        state, hints = None, task.hints
        if task.corrected:
            correction = task.corrected[0]
            if correction.name or (state := correction.state) is None:
                raise _of_no_object(task, correction)
            explanation = state.explain(self.explainer, task.photo, coded_photo(task.photo))
        else:
            if task.mask is not None:
                hints = replace(hints or Hints(), mask=read_mask(task.mask))
            explanation = self.explainer.explain(
                task.photo, task.box, focal=task.focal, hints=hints, K=task.camera
            )
        self.write(task, explanation, state)
        return row_of(task, explanation)

    def of_class(self, name: str) -> Explainer:
        """Return the explainer of a class, which is loaded when it is first needed."""
        if name not in self.by_class:
            self.by_class[name] = Explainer(name, self.settings.explain)
        return self.by_class[name]

    def several(self, task: Task) -> Rows:
        """Return the rows of a photo of several objects."""
        if task.objects:
            explainers = [self.of_class(name) for name, _ in task.objects]
            boxes = [box for _, box in task.objects]
            scene = explain_together(task.photo, explainers, boxes, task.focal, task.camera)
        else:
            names = (str(self.settings.object_class), *self.settings.others)
            explainers = [self.of_class(name) for name in names]
            scene = explain_found(task.photo, explainers, task.most, task.focal, task.camera)
        states, places = _states(task, scene), [place_of(each) for each in scene.objects]
        for number, (name, explanation) in enumerate(zip(scene.names, scene.objects, strict=True)):
            if name in states:  # explained with the class in its name
                others = np.any(np.delete(scene.masks, number, axis=0), axis=0, keepdims=True)[0]
                explainer = next(each for each in explainers if each.object_class is explanation.object_class)
                again = states[name].explain(explainer, task.photo, explanation.picture, others)
                objects = (*scene.objects[:number], again, *scene.objects[number + 1 :])
                scene = SceneExplanation(objects, scene.occludes)
        with beside_folder(task) as beside:
            settings = self.settings
            save_scene(scene, beside, task.photo.name, settings.export, settings.files, settings.full_size)
            for name, explanation, place in zip(scene.names, scene.objects, places, strict=True):
                box: Any = explanation.box and tuple(map(float, explanation.box))
                found = None if task.objects else explanation.present
                given = State(box=box, focal=task.focal, camera=_lens(task, explanation), found=found)
                state = states.get(name, given)
                state.write(beside / name, task.photo, explanation.object_class, name in states, place)
        rows = [
            row_of(task, explanation) | {"folder": f"{task.folder.name}/{name}", "object": number}
            for number, (name, explanation) in enumerate(zip(scene.names, scene.objects, strict=True), 1)
        ]
        return without_dismissed(rows)

    def write(self, task: Task, explanation: Explanation, corrected: State | None = None) -> None:
        """Write all files of a photo beside its folder, then in their place; see `beside_folder`."""
        with beside_folder(task) as beside:
            save_explanation(
                explanation, beside, task.photo.name, self.settings.files, self.settings.full_size
            )
            export_explanation(explanation, beside, self.settings.export, task.photo.name)
            hints, state = explanation.hints or Hints(), corrected
            if state is None and all(each is None for each in (hints.mask, hints.marks, hints.pose)):
                lens = _lens(task, explanation)
                state = State(box=task.box, focal=task.focal, camera=lens, **hints.plain)
            if state is not None:  # named from where it will be, which is as deep
                state.write(beside, task.photo, explanation.object_class, corrected is not None)


def apply_labels(task: Task) -> Task:
    """Return the task with what its labels state as its hints; UserError where they do not suit the photo."""
    height, width = coded_photo(task.photo).shape[:2]
    count, most = len(task.labels), task.most or 1
    if count > most:
        raise UserError(
            f"expected labels of {most} object{'s' * (most > 1)} in a photo; got {count}. Join shapes of one"
            f" object by a group, or explain several with --objects {count}."
        )
    hints = [label.hints(width, height) for label in task.labels]
    if not task.most:
        given = task.hints or Hints()
        given = replace(given, mask=hints[0].mask, points={**given.points, **hints[0].points})
        return replace(task, box=task.labels[0].box, hints=given)
    objects = []
    for label, hint in zip(task.labels, hints, strict=True):
        box: Any = label.box or (None if hint.mask is None else box_of(hint.mask))
        if label.name is None or box is None:
            raise UserError(
                "expected a box or mask of each of several objects; got points alone. Draw boxes."
            )
        objects.append((label.name, box))
    return replace(task, objects=tuple(objects))


def _states(task: Task, scene: SceneExplanation) -> dict[str, State]:
    """Return corrections by names of the objects that they were made for, which may have other numbers now.

    Raises:
        UserError: One was made for none of the objects.
    """
    states: dict[str, State] = {}
    for correction in task.corrected:
        overlaps = {
            name: box_overlap(place_of(explanation), correction.box)
            for name, explanation in zip(scene.names, scene.objects, strict=True)
            if correction.box is not None
            and name not in states
            and name.partition("-")[2] == correction.name.partition("-")[2]
        }
        name = max(overlaps, key=overlaps.__getitem__, default="")
        # Intersection over union from which detections are counted as right.
        if correction.state is None or overlaps.get(name, 0.0) < 0.5:
            if correction.state is not None and correction.state.found == 0:
                continue  # it was marked as not there, and is not found any more
            raise _of_no_object(task, correction)
        states[name] = correction.state
    return states


def _of_no_object(task: Task, correction: Correction) -> UserError:
    path = task.folder / correction.name / CORRECTIONS
    return UserError(f"expected an object with the box that '{path}' was made for; got others. {REMEDY}")


def _lens(task: Task, explanation: Explanation) -> tuple[float, float, float, float] | None:
    """Return fx, fy, cx, cy of the camera that was given."""
    lens = None if task.camera is None else explanation.window.lens
    return None if lens is None else (lens.fx, lens.fy, lens.cx, lens.cy)


@contextmanager
def beside_folder(task: Task) -> Iterator[Path]:
    """Yield a folder to write into; when the block ends well it replaces the photo's, else it is removed.

    Where the photo's folder is there its files are replaced one by one, those of earlier results that are not
    made anew are removed, and other files stay. Without `KEY`, which goes first and comes last, a folder is
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
        for name in (KEY, *RESULTS):
            (task.folder / name).unlink(missing_ok=True)
        remove_exports(task.folder)
        for path in task.folder.glob("[0-9]*-*/explanation.json"):  # folders of several objects
            shutil.rmtree(path.parent)
        for path in sorted(beside.iterdir(), key=lambda path: path.name == KEY):
            os.replace(path, task.folder / path.name)
    except OSError as error:
        raise UserError(
            f"cannot write {task.folder}: {error.strerror or error}; choose another --out."
        ) from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def row_of(task: Task, explanation: Explanation) -> dict[str, Any]:
    """Return the row of a photo that was explained."""
    return row_of_record(explanation.to_dict(), photo=str(task.photo), folder=task.folder.name, object=1)


def failure_rows(task: Task, error: object) -> Rows:
    """Return the one row of a photo that was not explained; the reason names the photo."""
    name, reason = str(task.photo), str(error)
    reason = reason if str(UserError(name)) in reason else f"{name}: {reason}"
    return [dict.fromkeys(COLUMNS) | {"photo": name, "folder": task.folder.name, "error": reason}]


def lost_row(task: Task, lost: Lost) -> Rows:
    """Return the one row of a photo whose workers were killed."""
    return failure_rows(
        task,
        f"{task.photo}: a worker process was killed {lost.attempts} times while it explained this photo,"
        " possibly out of memory; try it alone.",
    )
