"""`vig fit --track`: one object through the frames of a folder or video, or before a camera."""

import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path

from vig.explainer import Explainer
from vig.io.errors import UserError
from vig.io.printing import end, note
from vig.photo.video import is_video
from vig.video import Track, Tracker
from vig_app.cli.boxes import boxes_of, classes_of
from vig_app.cli.fit import Take, where_to_look, write_results
from vig_app.cli.hints import cameras_of
from vig_app.cli.naming import list_names, note_order
from vig_app.cli.options import FitCommand, changed_options
from vig_app.cli.tasks import explain_settings, files_of, plan_of
from vig_app.corrections import CORRECTIONS
from vig_app.results import TRACK
from vig_app.runs.live import OVERLAY, run_live
from vig_app.runs.tracked import run_tracked

WITHOUT_TRACK = {
    "boxes", "labels", "objects", "meshes", "cluster", "mask", "marks", "points", "azimuth", "pose",
    "workers",
}  # fmt: skip
WITHOUT_LIVE = WITHOUT_TRACK | {
    "cameras", "visible", "elevation", "roll", "framing", "export", "files", "full_size", "log",
}  # fmt: skip
"""Options that do not go with `--track`, and with `--live`."""


def track(command: FitCommand) -> int:
    """Track the object through frames, each explained into a folder; returns the exit code."""
    if command.video.live is not None:
        return _track_live(command, command.video.live)
    images, out = command.images, command.run.out
    if len(images) != 1 or not (images[0].is_dir() or is_video(images[0])):
        names = f"{len(images)} names" if len(images) != 1 else f"'{images[0]}'"
        raise UserError(
            f"expected one folder of frames or one video with --track; got {names}. Track one by one."
        )
    _refuse(command, "track", WITHOUT_TRACK)
    plan = plan_of(command)
    note_order([task.photo for task in plan.tasks])
    if len({repr(task.camera) for task in plan.tasks}) > 1:
        file = command.camera.cameras
        raise UserError(f"expected one camera for all frames; got several in '{file}'. Name one.")
    if edited := [task.folder.name for task in plan.tasks if task.corrected]:
        raise UserError(
            f"expected frames that were not corrected by hand with --track, which takes no hints on single"
            f" frames; got {CORRECTIONS} of {list_names(edited)} in '{out}'. Choose another --out."
        )
    tracked: list[Track] = []

    def explain(take: Take, finish: Callable[[], None]) -> None:
        tracked.append(run_tracked(list(plan.tasks), out, plan.settings, take, finish))

    def summarise(explained: int) -> str:
        lost = sum(frame.lost for frame in tracked[0].frames)
        path = f"{lost} of {len(plan.tasks)} frames are lost, the path is {out / TRACK}.csv"
        return f"tracked: {path}; of the frames {where_to_look(out)}"

    return write_results(plan, command.run, explain, summarise)


def _track_live(command: FitCommand, live: str) -> int:
    """Track until the stream ends, or Ctrl-C or SIGTERM end it; returns the exit code, 1 where the object was
    never found or the stream broke off.
    """
    video, options = command.video, command.run
    files_of(options)
    if command.images or not video.track:
        raise UserError("expected --track --live SOURCE without photos; got others. Name the source alone.")
    _refuse(command, "live", WITHOUT_LIVE)
    if not video.timeout > 0:
        raise UserError(f"expected --timeout in seconds, above 0; got {video.timeout:g}.")
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    source, nothing = [Path(live)], (lambda line: None)
    ((box, _),), (camera,) = (
        boxes_of(command.place, source, command.hints),
        cameras_of(command.camera, source),
    )
    object_class, *_ = classes_of(command.place, nothing if options.quiet else note)
    explainer = Explainer(object_class, explain_settings(command.model))
    tracker = Tracker(explainer, command.camera.focal if camera is None else camera)
    say = nothing if options.quiet or options.json else partial(print, flush=True)
    ended = run_live(live, tracker, options.out, box, say, video.timeout)
    poses, lost = ended.poses, sum(pose.lost for pose in ended.poses)
    if ended.problem is not None:
        note(f"{ended.problem} What came before stays.")
    if lost == len(poses):
        note(f"no {explainer.object_class.name} was found before the camera")
    result = {"frames": len(poses), "lost": lost} if options.json else None
    if options.quiet and result is None:
        print(options.out)
    else:
        path = f"{lost} of {len(poses)} frames are lost, the path is {options.out / TRACK}.csv"
        end(options.out, f"tracked: {path}; watch {options.out / OVERLAY}", result)
    if ended.signal is not None:
        return 128 + ended.signal
    return 1 if ended.problem is not None or lost == len(poses) else 0


def _refuse(command: FitCommand, mode: str, others: set[str]) -> None:
    """Raise UserError where an option is given that does not go with a mode."""
    for name in changed_options(*command.groups):
        if name in others:
            raise UserError(f"expected --{mode} without --{name}; got both. Leave one out.")


def _interrupt(number: int, frame: object) -> None:
    """Handle a signal like Ctrl-C."""
    raise KeyboardInterrupt(number)
