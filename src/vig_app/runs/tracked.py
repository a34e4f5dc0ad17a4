"""A run over the frames of a video, which are explained together."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vig.explainer import Explainer
from vig.explanation import Explanation
from vig.io.files import atomic_write
from vig.video import Track, TrackedFrame, track
from vig_app.results import POSE, TRACK, TRACK_COLUMNS, write_table
from vig_app.runs.ledger import ledger_of
from vig_app.runs.work import RunSettings, Task, Work, row_of


def run_tracked(
    tasks: list[Task], out: Path, settings: RunSettings, done: Callable[[dict[str, Any]], None]
) -> Track:
    """Explain the frames of a video together into their folders, and write track.csv, .parquet and .json.

    It is done in this process, from the first frame on each time.

    Args:
        tasks: In the frames' order; the box is that of the first.
        out: As in `run`.
        settings: For all frames.
        done: Is called with the row of a frame as it is done, once more where it is fitted again.

    Raises:
        UserError: As `vig.track`, or `out` cannot be written, or another run writes there.
    """
    explainer = Explainer(settings.object_class, settings.explain, settings.device)
    work, began = Work(explainer, settings), [time.monotonic()]

    def seen(number: int, found: Explanation) -> None:
        work.write(tasks[number], found)
        now = time.monotonic()
        done(row_of(tasks[number], found) | {"seconds": round(now - began[0], 3)})
        began[0] = now

    with ledger_of(out):
        first = tasks[0]
        photos = [task.photo for task in tasks]
        found = track(photos, explainer, first.box, first.focal, first.hints, seen)
        rows = [_row_of_track(task, frame) for task, frame in zip(tasks, found.frames, strict=True)]
        write_table(out, rows, TRACK, TRACK_COLUMNS)
        told = {"class": explainer.object_class.name, "shape": found.shape.tolist()}
        with atomic_write(out / f"{TRACK}.json") as temporary:
            temporary.write_text(json.dumps(told | {"albedo": found.albedo.tolist()}, indent=2) + "\n")
    return found


def _row_of_track(task: Task, frame: TrackedFrame) -> dict[str, Any]:
    camera, pose = frame.camera, frame.camera_from_object[:3].ravel().tolist()
    return {
        "photo": str(task.photo),
        "folder": task.folder.name,
        "frame": frame.number,
        "roll_deg": math.degrees(camera.roll),
        "focal_px": camera.focal,
        "center_x": camera.cx,
        "center_y": camera.cy,
        **{name: value for name, value in vars(frame).items() if name in TRACK_COLUMNS},
        **dict(zip(POSE, pose, strict=True)),
    }
