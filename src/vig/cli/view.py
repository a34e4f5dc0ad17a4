"""`vig view`: a photo on a page on which its explanation is put right by hand."""

from __future__ import annotations

import threading
import webbrowser

from vig.cli.common import View
from vig.cli.fit import parse_box
from vig.errors import UserError
from vig.explainer import Explainer
from vig.viewer import Session, State
from vig.viewer.server import HOST, Viewer


def view(settings: View) -> int:
    """Serve the page until interrupted; returns the exit code."""
    photo, object_class, state = settings.photo, settings.object_class, State()
    folder = settings.out / photo.stem
    if photo.is_dir():
        folder, (photo, object_class, state) = photo, State.read(photo)
    if settings.box is not None:
        if state.box is not None:
            raise UserError(
                "expected a photo with --box; got a result, whose box is saved. Draw another there."
            )
        state = State(parse_box(settings.box))
    session = Session(Explainer(object_class), photo, state, object_class)
    viewer = Viewer(session, folder, port=settings.port)
    print(f"http://{HOST}:{viewer.port}", flush=True)
    print(
        f"Ctrl-C ends. Over SSH: ssh -L {viewer.port}:{HOST}:{viewer.port} and this machine's name",
        flush=True,
    )
    if not settings.no_open:
        webbrowser.open(f"http://{HOST}:{viewer.port}")
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        viewer.stop()
    if viewer.saved:
        print(folder)
    return 0
