"""`vig view`: a photo on a page on which its explanation is put right by hand."""

from __future__ import annotations

import json
import signal
import sys
import threading
import webbrowser
from contextlib import nullcontext, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import TextIO

from vig.explainer import Explainer
from vig.io.errors import UserError
from vig_app.cli.boxes import parse_box
from vig_app.cli.common import ViewCommand
from vig_app.corrections import State, result_in
from vig_app.viewer import Session
from vig_app.viewer.server import HOST, Viewer, free_port


def view(settings: ViewCommand) -> int:
    """Serve the page until interrupted; returns the exit code."""
    out = sys.stdout
    with redirect_stdout(sys.stderr) if settings.json else nullcontext():  # viser prints lines of its own
        return _view(settings, out)


def _view(settings: ViewCommand, out: TextIO) -> int:
    photo, object_class, folder = settings.photo, settings.object_class, settings.out
    state = State()
    if photo.is_dir():
        for name, option in (("class", object_class), ("out", folder)):
            if option is not None:
                raise UserError(f"expected a photo with --{name}; got a result, which has one. Leave it out.")
        folder = result_in(photo)
        photo, object_class, state = State.read(folder)
    else:
        folder = (folder or Path("vig-fit")) / photo.stem
    if settings.box is not None:
        state = replace(state, box=parse_box(settings.box))
    port = free_port(settings.port, settings.host)
    session = Session(Explainer(object_class or "teapot"), photo, state)
    viewer = Viewer(session, folder, port, settings.host)
    address = f"{HOST}:{viewer.port}"
    if settings.json:
        print(json.dumps({"address": f"http://{address}", "folder": str(folder)}), file=out, flush=True)
    else:
        if viewer.port != settings.port:
            print(f"port {settings.port} is taken; this page has another:", flush=True)
        print(f"http://{address}", flush=True)
        print(f"Ctrl-C ends. Over SSH: ssh -L {viewer.port}:{address} and this machine's name", flush=True)
    if not settings.no_open:
        webbrowser.open(f"http://{address}")
    # A script's background jobs begin by ignoring it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        viewer.stop()
    if viewer.saved and not settings.json:
        print(folder)
    return 0
