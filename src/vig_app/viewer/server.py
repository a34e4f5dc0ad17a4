"""The page of `vig view`: templates/view.html of the reports, and a server on this machine alone.

The page asks for `state` and `photo`, and posts actions to `act`, which answers with the state after them.
"""

import json
import sys
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from ipaddress import ip_address
from itertools import groupby
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit

from vig.inference import PixelLabel
from vig.io.checks import decode, parse_json
from vig.io.errors import UserError
from vig.photo.images import as_srgb, coded_photo
from vig_app.pictures import panels
from vig_app.report import words
from vig_app.report.contents import drawing_data
from vig_app.report.drawing import views_of
from vig_app.report.folder_page import reduce_picture
from vig_app.report.html import fill_template, jpeg_bytes, jpeg_url
from vig_app.viewer.session import Change, add_stroke, clear_corrections, dismiss, set_point, set_state
from vig_app.viewer.walk import Walk

HOST = "127.0.0.1"
SENT_SIDE = 1600  # pixels of the longer side of the photo that is sent
MAX_BYTES = 1 << 22  # bytes of a page's post, at most
COMMANDS = ("save", "find", "step", "open")  # actions that are no corrections


@dataclass(frozen=True)
class Action:
    """A user's action: `at` are pixels of the photo, x, y or x, y, width, height; `value` is an angle in
    degrees, whether nothing hides the object, a step through a run, or the number of an item.
    """

    do: Literal[
        "box", "point", "mark", "view", "elevation", "roll", "visible", "none", "clear", "undo", "save",
        "find", "step", "open",
    ]  # fmt: skip
    at: tuple[float, ...] = ()
    value: float | None = None
    name: str = ""
    label: int = 0
    radius: float = 0.0
    path: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Request:
    """Some actions on the item that a page shows."""

    item: int
    actions: tuple[Action, ...]


class _Server(ThreadingHTTPServer):
    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exception(), ConnectionError):  # a page that was left
            super().handle_error(request, client_address)


def _bind(port: int, host: str, handler: Callable[..., Any]) -> _Server:
    """Return a server at the port, or the next one that is free; UserError when none is."""
    if not 1 <= port <= 65535:
        raise UserError(f"expected a port of 1 to 65535; got {port}. 8080 is usual.")
    # 100: ports that are tried, from the one that was named
    for candidate in range(port, min(port + 100, 65536)):
        with suppress(OSError):
            return _Server((host, candidate), handler)
    raise UserError(f"expected a free port from {port} on; got none. Name another with --port.")


class Viewer:
    """The page of a walk; `stop` ends it."""

    def __init__(self, walk: Walk, port: int = 8080, host: str = HOST) -> None:
        """Open the first photo and serve the page at the port of a host, or at the next free one.

        Args:
            walk: Photos or results to show and correct.
            port: 1 to 65535.
            host: Address to listen at.

        Raises:
            UserError: No port is free, or no photo can be opened.
        """
        self.walk = walk
        self._server = _bind(port, host, partial(_Handler, self))
        self.port = int(self._server.server_address[1])
        self._thread = ThreadPoolExecutor(1)  # all that fits, in its order
        self._found: list[dict[str, Any]] = []
        self._sizes: dict[Path, list[int]] = {}
        try:
            self._message = self.on_thread(partial(walk.step, 1))
        except UserError:
            self._server.server_close()
            raise
        self._refused = bool(self._message)
        self._thread.submit(walk.prepare)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def stop(self) -> None:
        """End serving, after the current action."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.shutdown()
        self.walk.close()

    def on_thread(self, work: Callable[[], Any]) -> Any:
        """Do some work after the previous work; return or raise its outcome."""
        return self._thread.submit(work).result()

    def page(self) -> str:
        """Return the page's HTML."""
        points = list(self.walk.session.explainer.object_class.points)
        names = [item.name for item in self.walk.items]
        return fill_template("view.html", data={"items": names, "points": points}, run=len(names) > 1)

    def photo(self, number: int) -> bytes:
        """Return the photo of an item as a JPEG file; ValueError where there is none."""
        if not 0 <= number < len(self.walk.items):
            raise ValueError(f"expected an item below {len(self.walk.items)}; got {number}")
        path, session = self.walk.items[number].read()[0], self.walk.session
        photo = session.photo if session.path == path else coded_photo(path)
        return jpeg_bytes(reduce_picture(as_srgb(photo), SENT_SIDE))

    def _size_sent(self) -> list[int]:
        """Return the width and height of the photo that is sent."""
        session = self.walk.session
        if session.path not in self._sizes:
            self._sizes[session.path] = [*reduce_picture(as_srgb(session.photo), SENT_SIDE).shape[1::-1]]
        return self._sizes[session.path]

    def state(self) -> dict[str, Any]:
        """Return the page's content."""
        walk, session = self.walk, self.walk.session
        explanation = session.explanation
        described, views = explanation.to_dict(), views_of(explanation)
        (height, width), sent = session.photo.shape[:2], self._size_sent()
        answers = [
            (explanation.azimuth_deg, explanation.elevation_deg, explanation.fit.confidence),
            *((each.azimuth_deg, each.elevation_deg, each.probability) for each in explanation.alternatives),
        ]
        return {
            "item": walk.place,
            "photo": {"width": width, "height": height, "shown": sent},
            "verdict": described["verdict"],
            "badge": words.badge(described),
            "reason": described["reason"],
            "summary": words.summary(described),
            "elevation": explanation.elevation_deg,
            "roll": explanation.roll_deg,
            "hints": session.state.to_json(),
            "undo": len(session.states) - 1,
            "unsaved": session.unsaved,
            "corrected": [number for number, item in enumerate(walk.items) if item.corrected],
            "views": [
                {
                    "azimuth": azimuth,
                    "elevation": elevation,
                    "right": words.likely_right(probability),
                    "words": view.words,
                }
                for (azimuth, elevation, probability), view in zip(answers, views, strict=True)
            ],
            "drawing": drawing_data(explanation, views, [], *sent),
            "panels": jpeg_url(panels(explanation)),
            "objects": walk.objects() or self._found,
            "message": self._message,
            "refused": self._refused,
        }

    def act(self, request: Request) -> dict[str, Any]:
        """Do some actions in their order, corrections that follow each other at once; the state then."""
        self._say("")
        if request.item == self.walk.place:
            self._do_all(request.actions)
        else:
            self._say("Another page went on; this is what is open now.", refused=True)
        return self.state()

    def _do_all(self, actions: tuple[Action, ...]) -> None:
        for are_commands, group in groupby(actions, lambda action: action.do in COMMANDS):
            if not are_commands:
                # Where some of several cannot be made, these alone are reported and left out.
                changes = list(map(self._change, group))
                try:
                    self.walk.session.correct(*changes)
                except UserError as error:
                    self._say(str(error) if len(changes) == 1 else self._one_by_one(changes), refused=True)
                continue
            for action in group:
                try:
                    self._do(action)
                except UserError as error:
                    self._say(str(error), refused=True)

    def _say(self, message: str, refused: bool = False) -> None:
        self._message, self._refused = message, refused

    def _do(self, action: Action) -> None:
        """Do an action that is no correction."""
        walk = self.walk
        if action.do == "find":
            boxes = walk.session.places()
            self._found = [{"box": box, "name": f"place {n}", "item": None} for n, box in enumerate(boxes, 1)]
            frames = f"Click into a frame to take what is there; {len(boxes)} found."
            self._say(frames if boxes else "None was found; draw a box.")
            return
        saved = ""
        if action.do == "save" or (walk.session.unsaved and len(walk.items) > 1):
            saved = f"Saved in {walk.save()}."
        message = ""
        if action.do == "step":
            message = walk.step(1 if (action.value or 1) > 0 else -1)
        elif action.do == "open":
            number = int(action.value or 0)
            walk.open(number if 0 <= number < len(walk.items) else walk.place)
        if action.do != "save":
            self._found = []
            self._thread.submit(walk.prepare)
        self._say(f"{message} {saved}".strip(), refused=bool(message))

    def _change(self, action: Action) -> Change | None:
        """Return the correction of an action; None to undo one."""
        at, value = action.at, action.value
        match action.do:
            case "box":
                x, y, width, height = at
                return self.walk.session.set_box(x, y, width, height)
            case "point":
                x, y = at
                return set_point(action.name, x, y)
            case "mark":
                x, y = at
                return add_stroke(PixelLabel(action.label), x, y, action.radius, action.path)
            case "view":
                return set_state(azimuth_deg=value)
            case "elevation" | "roll":
                return set_state(**{f"{action.do}_deg": value})
            case "visible":
                return set_state(visible=bool(value))
            case "none":
                return dismiss
            case "clear":
                return clear_corrections
        return None

    def _one_by_one(self, changes: list[Change | None]) -> str:
        """Make each correction by itself; return messages of refused ones. Taking these back does nothing."""
        messages: list[str] = []
        refused = 0
        for change in changes:
            if change is None and refused:
                refused -= 1
                continue
            try:
                self.walk.session.correct(change)
                refused = 0
            except UserError as error:
                refused += 1
                messages.append(str(error))
        return " ".join(dict.fromkeys(messages))


class _Handler(BaseHTTPRequestHandler):
    """Answers pages of this machine."""

    def __init__(self, viewer: Viewer, *args: Any) -> None:
        self.viewer = viewer
        super().__init__(*args)

    def log_message(self, *_: Any) -> None:
        """Print no line for each request."""

    def do_GET(self) -> None:
        """Answer with the page, the state or the photo."""
        viewer, url = self.viewer, urlsplit(self.path)
        match url.path:
            case "/":
                self._answer(lambda: viewer.page().encode(errors="replace"), "text/html; charset=utf-8")
            case "/photo":
                self._answer(lambda: viewer.photo(int(url.query.split("-")[0])), "image/jpeg")
            case "/state":
                self._answer(lambda: _json(viewer.on_thread(viewer.state)), "application/json")
            case _:
                self._send(404, b"expected / of vig view", "text/plain")

    def do_POST(self) -> None:
        """Take an action."""
        try:
            length = int(self.headers["Content-Length"])
            if self.path != "/act" or not 0 < length <= MAX_BYTES:
                raise ValueError("expected actions of vig view")
            request: Request = decode(Request, parse_json(self.rfile.read(length)))
        except (TypeError, ValueError) as error:
            self._send(400, _json({"error": str(error)}), "application/json")
            return
        act = partial(self.viewer.act, request)
        self._answer(lambda: _json(self.viewer.on_thread(act)), "application/json")

    def _answer(self, work: Callable[[], bytes], kind: str) -> None:
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        if not is_own_host(host) or origin not in (None, f"http://{host}"):
            self._send(403, b"expected the page of vig view, by address or as localhost", "text/plain")
            return
        try:
            self._send(200, work(), kind)
        except ConnectionError:
            raise
        except ValueError as error:  # an action that our page does not send
            self._send(400, _json({"error": str(error)}), "application/json")
        except Exception:  # a fault of ours must not leave the page without its server
            traceback.print_exc()
            words = "That went wrong; the terminal says more."
            self._send(500, _json({"error": words}), "application/json")

    def _send(self, status: int, content: bytes, kind: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("X-Frame-Options", "DENY")
        self.end_headers()
        self.wfile.write(content)


def is_own_host(host: str) -> bool:
    """Return whether a Host header is an address or localhost: names that a page of another site could
    have made to point here are not.
    """
    with suppress(ValueError):
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or bool(ip_address(name))
    return False


def _json(content: dict[str, Any]) -> bytes:
    return json.dumps(content).encode()
