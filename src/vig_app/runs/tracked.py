"""A run over the frames of a video, which are explained together."""

import math
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from vig.explainer import Explainer
from vig.explanation import Explanation
from vig.io.files import write_json
from vig.video import Track, track
from vig.video.trajectory import FramePose
from vig_app.results import POSE, TRACK, TRACK_COLUMNS, write_table
from vig_app.runs.ledger import ledger_of
from vig_app.runs.work import RunSettings, Task, Work, row_of


def run_tracked(
    tasks: list[Task],
    out: Path,
    settings: RunSettings,
    take: Callable[[dict[str, Any]], None],
    finish: Callable[[], None] = lambda: None,
) -> Track:
    """Explain the frames of a video together into their folders, and write track.csv, .parquet and .json.

    It is done in this process, from the first frame on each time.

    Args:
        tasks: In the frames' order; the box is that of the first, the camera that of all.
        out: Folder of the run, see `run`.
        settings: Settings for all frames.
        take: Called with the row of a frame as it is done, once more where it is fitted again.
        finish: See `run`.

    Raises:
        UserError: See `vig.track`; also if `out` cannot be written, or another run writes there.
    """
    explainer = Explainer(settings.object_class, settings.explain)
    work, started = Work(explainer, settings), time.monotonic()

    def write_frame(number: int, explanation: Explanation) -> None:
        nonlocal started
        work.write(tasks[number], explanation)
        now = time.monotonic()
        take(row_of(tasks[number], explanation) | {"seconds": round(now - started, 3)})
        started = now

    with ledger_of(out), ExitStack() as stack:
        stack.callback(finish)
        first = tasks[0]
        photos = [task.photo for task in tasks]
        tracked = track(photos, explainer, first.box, first.focal, first.hints, write_frame, first.camera)
        rows = [
            row_of_pose(frame, TRACK_COLUMNS) | {"photo": str(task.photo), "folder": task.folder.name}
            for task, frame in zip(tasks, tracked.frames, strict=True)
        ]
        write_table(out, rows, TRACK, TRACK_COLUMNS)
        content = {
            "class": explainer.object_class.name,
            "shape": tracked.shape.tolist(),
            "albedo": tracked.albedo.tolist(),
        }
        write_json(out / f"{TRACK}.json", content)
    return tracked


def row_of_pose(pose: FramePose, columns: Iterable[str]) -> dict[str, Any]:
    """Return the columns of a table for the object in a frame."""
    camera, matrix = pose.camera, pose.camera_from_object[:3].ravel().tolist()
    row = vars(pose) | {"frame": pose.number, "roll_deg": math.degrees(camera.roll), "focal_px": camera.focal}
    row |= {"center_x": camera.cx, "center_y": camera.cy, **dict(zip(POSE, matrix, strict=True))}
    return {name: row[name] for name in columns if name in row}
