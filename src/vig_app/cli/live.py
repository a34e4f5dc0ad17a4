"""`vig fit --track --live`: the object before a camera."""

from __future__ import annotations

import json
import signal
from functools import partial
from pathlib import Path

from vig.explainer import Explainer
from vig.io.errors import UserError
from vig.io.printing import end, note
from vig.video import Tracker
from vig_app.cli.boxes import boxes_of, check_place, classes_of
from vig_app.cli.cameras import cameras_of
from vig_app.cli.options import FitCommand, given
from vig_app.cli.tasks import explain_settings
from vig_app.runs.live import OVERLAY, run_live

WITHOUT_LIVE = {
    "boxes", "objects", "cameras", "mask", "marks", "visible", "points", "azimuth", "elevation", "roll",
    "pose", "framing", "workers", "cluster", "export", "files", "full_size", "log",
}  # fmt: skip
"""Options that do not go with `--live`."""


def fit_live(command: FitCommand) -> int:
    """Track until the stream ends, or Ctrl-C or SIGTERM end it; returns the exit code, 1 where the object was
    never found or the stream broke off.
    """
    video, options = command.video, command.run
    if command.images or not video.track:
        raise UserError("expected --track --live SOURCE without photos; got others. Name the source alone.")
    for name in given(*command.groups):
        if name in WITHOUT_LIVE:
            raise UserError(f"expected --live without --{name}; got both. Leave one out.")
    assert video.live is not None
    if not video.timeout > 0:
        raise UserError(f"expected --timeout in seconds, above 0; got {video.timeout:g}.")
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    check_place(command.place, command.hints, track=True)
    source, nothing = [Path(video.live)], (lambda line: None)
    ((box, _),), (camera,) = (
        boxes_of(command.place, source, command.hints),
        cameras_of(command.camera, source),
    )
    object_class, *_ = classes_of(command.place, nothing if options.quiet else note)
    explainer = Explainer(object_class, explain_settings(command.model))
    tracker = Tracker(explainer, command.camera.focal if camera is None else camera)
    say = nothing if options.quiet or options.json else partial(print, flush=True)
    ended = run_live(video.live, tracker, options.out, box, say, video.timeout)
    poses, lost = ended.poses, sum(pose.lost for pose in ended.poses)
    if options.json:
        print(json.dumps({"frames": len(poses), "lost": lost, "folder": str(options.out)}))
    elif not options.quiet:
        print(f"{len(poses)} frames, {lost} of them lost: {options.out / 'track.csv'}")
    if ended.problem is not None:
        note(f"{ended.problem} What came before stays.")
    if lost == len(poses):
        note(f"no {explainer.object_class.name} was found before the camera")
    if options.quiet and not options.json:
        print(options.out)
    elif not options.json:
        end(options.out, f"tracked: watch {options.out / OVERLAY}; track.csv beside it has the path")
    if ended.signal is not None:
        return 128 + ended.signal
    return 1 if ended.problem is not None or lost == len(poses) else 0


def _interrupt(number: int, frame: object) -> None:
    """Handle a signal like Ctrl-C."""
    raise KeyboardInterrupt(number)
