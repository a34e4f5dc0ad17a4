"""`vig view`: photos on a page on which their explanations are put right by hand."""

import json
import signal
import threading
import webbrowser
from pathlib import Path

from vig.io.errors import UserError
from vig.io.printing import end, note
from vig_app.cli.boxes import parse_box
from vig_app.cli.common import ViewCommand
from vig_app.cli.photos import result_folders
from vig_app.viewer.server import HOST, Viewer
from vig_app.viewer.walk import Walk


def view(settings: ViewCommand) -> int:
    """Serve the page until interrupted; returns the exit code."""
    photo = settings.photo
    if photo.is_dir():
        for name, option in (("class", settings.object_class), ("out", settings.out)):
            if option is not None:
                raise UserError(f"expected a photo with --{name}; got a result, which has one. Leave it out.")
        walk = Walk.of_folder(photo)
    else:
        (folder,) = result_folders([photo], settings.out or Path("vig-fit"))
        walk = Walk.of_photo(photo, settings.object_class or "teapot", folder)
    if settings.box is not None:
        if len(walk.items) > 1:
            raise UserError(f"expected --box with one photo; got {len(walk.items)}. Draw it on the page.")
        walk.items[0].box = parse_box(settings.box)
    viewer = Viewer(walk, settings.port, settings.host)
    folder = walk.run or walk.items[0].folder
    address = f"{HOST}:{viewer.port}"
    if settings.json:
        print(json.dumps({"address": f"http://{address}", "folder": str(folder)}), flush=True)
    else:
        if viewer.port != settings.port:
            print(f"port {settings.port} is taken; this page has another:", flush=True)
        print(f"http://{address}", flush=True)
        print(f"over SSH: ssh -L {viewer.port}:{address} and this machine's name", flush=True)
        print("open it in a browser, correct what is wrong, save with S; Ctrl-C here ends", flush=True)
    if not settings.no_open:
        webbrowser.open(f"http://{address}")
    # A script's background jobs begin by ignoring it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        try:
            viewer.stop()
        finally:
            if walk.session.unsaved:
                note(f"corrections of {walk.items[walk.place].name} were not saved")
    if not settings.json and walk.saved:
        again = "" if walk.run is None else "; the same `vig fit` again takes it up"
        end(folder, f"saved: open {folder / 'report.html'}{again}")
    elif not settings.json and not walk.session.unsaved:
        note("nothing was saved, as nothing was corrected")
    return 0
