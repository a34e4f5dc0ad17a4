"""`vig fit --track --live`: the object before a camera."""

from __future__ import annotations

import json
import signal
from functools import partial
from pathlib import Path

from vig.explainer import Explainer
from vig.inference import ExplainSettings
from vig.io.errors import UserError
from vig.io.printing import end, note
from vig.likelihood import LIKELIHOODS
from vig.video import Tracker
from vig_app.cli.boxes import boxes_of, check_place, classes_of
from vig_app.cli.cameras import cameras_of
from vig_app.cli.common import FitCommand
from vig_app.runs.live import OVERLAY, run_live

WITH_LIVE = {
    "images", "track", "live", "box", "object_class", "mesh", "length", "up", "focal", "intrinsics",
    "likelihood", "no_self_shadow", "out", "quiet", "json", "timeout",
}  # fmt: skip
"""Options that go with `--live`."""


def fit_live(settings: FitCommand) -> int:
    """Track until the stream ends, or Ctrl-C or SIGTERM end it; returns the exit code, 1 where the object was
    never found or the stream broke off.
    """
    if settings.images or not settings.track:
        raise UserError("expected --track --live SOURCE without photos; got others. Name the source alone.")
    for name, value in vars(settings).items():
        if name not in WITH_LIVE and value != getattr(FitCommand, name):
            raise UserError(f"expected --live without --{name}; got both. Leave one out.")
    assert settings.live is not None
    if not settings.timeout > 0:
        raise UserError(f"expected --timeout in seconds, above 0; got {settings.timeout:g}.")
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    check_place(settings)
    source = [Path(settings.live)]
    ((box, _),), (camera,) = boxes_of(settings, source), cameras_of(settings, source)
    explain = ExplainSettings(LIKELIHOODS[settings.likelihood], self_shadow=not settings.no_self_shadow)
    explainer = Explainer(classes_of(settings)[0], explain)
    tracker = Tracker(explainer, settings.focal if camera is None else camera)
    say = (lambda line: None) if settings.quiet or settings.json else partial(print, flush=True)
    ended = run_live(settings.live, tracker, settings.out, box, say, settings.timeout)
    poses, lost = ended.poses, sum(pose.lost for pose in ended.poses)
    if settings.json:
        print(json.dumps({"frames": len(poses), "lost": lost, "folder": str(settings.out)}))
    elif not settings.quiet:
        print(f"{len(poses)} frames, {lost} of them lost: {settings.out / 'track.csv'}")
    if ended.problem is not None:
        note(f"{ended.problem} What came before stays.")
    if lost == len(poses):
        note(f"no {explainer.object_class.name} was found before the camera")
    if settings.quiet and not settings.json:
        print(settings.out)
    elif not settings.json:
        end(settings.out, f"tracked: watch {settings.out / OVERLAY}; track.csv beside it has the path")
    if ended.signal is not None:
        return 128 + ended.signal
    return 1 if ended.problem is not None or lost == len(poses) else 0


def _interrupt(number: int, frame: object) -> None:
    """Take a signal as Ctrl-C."""
    raise KeyboardInterrupt(number)
