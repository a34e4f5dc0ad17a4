"""The page of `vig view`: a viser server on this machine alone."""

from __future__ import annotations

import math
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from vig.explanation import Explanation
from vig.inference import PixelLabel
from vig.io.errors import UserError
from vig.photo.images import coded
from vig.scene import srgb8_from_linear
from vig_app.glb import LOOKS_BACK
from vig_app.viewer.session import Session, cleared, marked, placed
from vig_app.viewer.worker import Worker

HOST = "127.0.0.1"
MOST_PORTS = 100
"""Ports that are tried, from the one that was named."""
MOST_SIDE = 1024
"""Pixels of the longer side of the picture that is sent."""
SIZE = 2.0
"""Longer side of the photo in the scene's units; the object stands to its left."""
OBJECT = 0.6 * SIZE
"""Longest side of the object in the same units."""
GAP = 0.1 * SIZE
"""Between photo and object."""
FIELD_OF_VIEW = 0.6
"""Vertical field of view, radians."""
FACING = (0.0, 1.0, 0.0, 0.0)
"""Half a turn about x: viser's images have y down, the scene has y up and is seen from +Z."""
NARROW_SCREEN = 700
"""Pixels of width below which the controls stand below the scene, not beside it."""
CONTROLS_SHARE = 0.55
"""Share of such a screen's height that they take."""
BRUSH = 2.0
"""Radius of a mark at first, % of the photo's longer side."""
LOOK = "nothing, look around"
BOX = "a box round the object"
MARKS = {
    "here it is seen": PixelLabel.SEEN,
    "something is in front": PixelLabel.IN_FRONT,
    "it is not here": PixelLabel.NOTHING,
}
MARK_COLOURS = {
    PixelLabel.SEEN: (0, 200, 0),
    PixelLabel.IN_FRONT: (220, 0, 0),
    PixelLabel.NOTHING: (0, 0, 220),
}
"""Colours of marks, those of `--marks`."""
AS_FOUND = "as found"
STYLE = """<style>
:root[data-mantine-color-scheme="light"] { --mantine-color-dimmed: #545c64; }
:root[data-mantine-color-scheme="dark"] { --mantine-color-dimmed: #b8bcc2; }
.mantine-Button-root { background: #0b5ed7 !important; color: #fff !important; }
.mantine-Slider-markLabel, .mantine-Notification-description
  { color: var(--mantine-color-dimmed) !important; }
</style>"""
"""viser's own grey and blue are too pale for WCAG's level AA."""
HELP = (
    "Choose what to say, then click the photo there (for a box: drag from corner to corner), or type the"
    " place and press *say it there*. Drag to look around, turn the wheel to come closer."
)
OWN_ORIGINS = [re.compile(r"http://(127\.0\.0\.1|localhost|\[::1\])(:\d+)?")]
"""Pages that may open a connection: those of this machine, on whatever port SSH forwards ours to."""
MARKUP = re.compile(r"[^\w\s]")


def plain(text: str) -> str:
    """Text that the page shows as it is: it renders Markdown and HTML, and a file may have any name."""
    return MARKUP.sub(lambda match: f"&#{ord(match[0])};", " ".join(text.split()))


def free_port(port: int, host: str = HOST) -> int:
    """The port, or the next one of a host that is free; UserError when viser is missing or none is."""
    try:
        import viser  # noqa: F401
    except ImportError:
        raise UserError("vig view needs viser; run pip install 'vig[viewer]'.") from None
    if not 1 <= port <= 65535:
        raise UserError(f"expected a port of 1 to 65535; got {port}. 8080 is usual.")
    for candidate in range(port, min(port + MOST_PORTS, 65536)):
        with socket.socket() as probe, suppress(OSError):
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, candidate))
            return candidate
    raise UserError(f"expected a free port from {port} on; got none. Name another with --port.")


@contextmanager
def _own_pages_only() -> Iterator[None]:
    """Servers started inside refuse connections that a page of another site opens in the user's browser.

    viser passes no origins on to websockets.
    """
    import websockets.asyncio.server as websocket

    serve = websocket.serve
    websocket.serve = partial(serve, origins=OWN_ORIGINS)  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        websocket.serve = serve  # type: ignore[misc]


class Viewer:
    """The page of one session; `stop` ends it."""

    def __init__(self, session: Session, folder: Path, port: int = 8080, host: str = HOST) -> None:
        """Serve a session on the port of a host, by default this machine alone, or on the next free one.

        Args:
            session: What is shown and corrected.
            folder: Where results are saved.
            port: 1 to 65535.
            host: The address that is listened at.

        Raises:
            UserError: viser is missing, or no port can be had.
        """
        port = free_port(port, host)
        import viser

        self.session = session
        self.folder = folder
        self.saved = False
        height, width = session.photo.shape[:2]
        self.unit = SIZE / max(height, width)
        scale = min(1.0, MOST_SIDE / max(height, width))
        self.sent_size = max(1, round(width * scale)), max(1, round(height * scale))
        with _own_pages_only():
            self.server = viser.ViserServer(host=host, port=port, label="vig", verbose=False)
        self.server.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]
        self._theme(dark=False)
        self.worker = Worker(session, self._show, self._message)
        self.image = self.server.scene.add_image(
            "/photo", session.photo[:1, :1], width * self.unit, height * self.unit, wxyz=FACING
        )
        self._controls()
        self.image.on_click(self._clicked)
        self.server.on_client_connect(self._welcome)
        self._show()

    @property
    def port(self) -> int:
        """The port that was free."""
        return int(self.server.get_port())

    def stop(self) -> None:
        """End serving."""
        self.worker.stop()
        self.server.stop()

    def _controls(self) -> None:
        gui: Any = self.server.gui  # viser declares handles' values as read-only, though they are set so
        session = self.session
        gui.add_html(STYLE)
        self.verdict = gui.add_markdown("")
        points = list(session.explainer.object_class.points)
        self.tool = gui.add_dropdown("a click says", [LOOK, BOX, *points, *MARKS], initial_value=LOOK)
        self.brush = gui.add_slider("brush, %", 0.5, 10.0, 0.5, BRUSH)
        self.place = gui.add_text(
            "place", "", hint="x, y in pixels of the photo; for a box x, y, width, height"
        )
        say = gui.add_button("say it there")
        self.views = gui.add_dropdown("view", [AS_FOUND])
        self.choices: dict[str, float | None] = {AS_FOUND: None}
        self.visible = gui.add_checkbox("nothing hides it", initial_value=False)
        self.held, self.angle = {}, {}
        for name, least, most in (("elevation", -10, 90), ("roll", -180, 180)):
            self.held[name] = gui.add_checkbox(f"hold the {name}", initial_value=False)
            self.angle[name] = gui.add_slider(f"{name}, °", least, most, 1, 0)
        self.outline = gui.add_checkbox("outline", initial_value=True)
        self.dark = gui.add_checkbox("dark page", initial_value=False)
        names = ("undo", "take all back", "look straight", "save")
        undo, clear, straight, save = (gui.add_button(name) for name in names)
        self.words = gui.add_markdown(HELP)
        self.tool.on_update(lambda _: self._chosen_tool())
        say.on_click(lambda _: self._typed(self.place.value))
        undo.on_click(lambda _: self.worker.correct(None))
        clear.on_click(lambda _: self.worker.correct(cleared))
        straight.on_click(lambda event: self._look(event.client.camera))
        save.on_click(lambda _: self.worker.do(self._save))
        self.outline.on_update(lambda _: self.worker.do(self._show))
        self.dark.on_update(lambda _: self._theme(self.dark.value))
        self.visible.on_update(self._visible_changed)
        self.views.on_update(self._view_chosen)
        for control in (*self.held.values(), *self.angle.values()):
            control.on_update(self._angles_changed)

    def _theme(self, dark: bool) -> None:
        """Without viser's button that would share the page over a server elsewhere."""
        self.server.gui.configure_theme(show_logo=False, show_share_button=False, dark_mode=dark)

    def _welcome(self, client: Any) -> None:
        """The controls beside the scene, or below it on a narrow screen; all of it in sight at any width."""
        camera, panel = client.camera, client.gui.main_panel
        if camera.image_width < NARROW_SCREEN:
            below = CONTROLS_SHARE * camera.image_height
            panel.float(x=0.0, y=camera.image_height - below, width=camera.image_width, height=below)
        else:
            panel.dock_right()
        aspects: list[float] = []

        def placed() -> None:
            if aspects[-1:] != [camera.aspect]:  # once more when the panel or the user changes the window
                aspects.append(camera.aspect)
                self._look(camera)

        camera.on_update(lambda _: placed())
        placed()

    def _look(self, camera: Any) -> None:
        """Photo and object from the front, above the controls where these cover a part of the screen."""
        below = CONTROLS_SHARE if camera.image_width < NARROW_SCREEN else 0.0
        height, width = (self.unit * side for side in self.session.photo.shape[:2])
        across, tangent = width + GAP + OBJECT, math.tan(FIELD_OF_VIEW / 2)
        far = 1.1 * max(max(height, OBJECT) / (1.0 - below), across / max(camera.aspect, 0.1)) / 2 / tangent
        middle = -(GAP + OBJECT) / 2, -below * far * tangent
        camera.up_direction = (0.0, 1.0, 0.0)
        camera.fov = FIELD_OF_VIEW
        camera.position = (*middle, far)
        camera.look_at = (*middle, 0.0)

    def _chosen_tool(self) -> None:
        """Dragging draws a box while a box is asked for, and turns the scene otherwise."""
        self.server.scene.remove_rect_select_callback()
        if self.tool.value == BOX:
            self.server.scene.on_rect_select()(self._dragged)

    def _dragged(self, event: Any) -> None:
        import viser.transforms

        camera = event.client.camera
        turn = viser.transforms.SO3(camera.wxyz).as_matrix()
        tangent = math.tan(camera.fov / 2)
        corners = []
        for across, down in (event.screen_min, event.screen_max):
            way = turn @ [(2 * across - 1) * tangent * camera.aspect, (2 * down - 1) * tangent, 1.0]
            corners.append(self._pixel(camera.position, way))
        (left, right), (top, bottom) = (sorted(pair) for pair in zip(*corners, strict=True))
        self._correct(BOX, left, top, right - left, bottom - top)

    def _clicked(self, event: Any) -> None:
        if self.tool.value not in (LOOK, BOX):
            self._correct(self.tool.value, *self._pixel(event.ray_origin, event.ray_direction))

    def _pixel(self, start: Any, way: Any) -> tuple[float, float]:
        """Where a ray meets the photo, in its pixels."""
        start, way = np.asarray(start, float), np.asarray(way, float)
        there = start - way * start[2] / way[2]
        height, width = self.session.photo.shape[:2]
        return float(there[0] / self.unit + width / 2), float(height / 2 - there[1] / self.unit)

    def _typed(self, text: str) -> None:
        """What is typed instead of clicked."""
        needed = 4 if self.tool.value == BOX else 2
        try:
            numbers = [float(word) for word in text.replace(",", " ").split()]
        except ValueError:
            numbers = []
        if self.tool.value == LOOK:
            self._message("Choose first what a click says.")
        elif len(numbers) != needed or not np.isfinite(numbers).all():
            self._message("Type x, y, width, height." if needed == 4 else "Type x, y.")
        else:
            self._correct(self.tool.value, *numbers)

    def _correct(self, tool: str, *numbers: float) -> None:
        """Make the correction of a tool at a place, in pixels of the photo."""
        height, width = self.session.photo.shape[:2]
        self.place.value = ", ".join(f"{number:.0f}" for number in numbers)
        if tool == BOX:
            self.worker.correct(self.session.boxed(*numbers))
        elif tool in MARKS:
            radius = self.brush.value / 100 * max(height, width)
            self.worker.correct(marked(MARKS[tool], numbers[0], numbers[1], radius))
        else:
            self.worker.correct(placed(tool, *numbers))

    # Only what a user has changed counts, who comes with a client, not what `_show` has.

    def _visible_changed(self, event: Any) -> None:
        if event.client is not None:
            visible = bool(self.visible.value)
            self.worker.correct(lambda state: replace(state, visible=visible))

    def _view_chosen(self, event: Any) -> None:
        chosen = self.views.value
        if event.client is not None and chosen in self.choices:
            azimuth = self.choices[chosen]
            self.worker.correct(lambda state: replace(state, azimuth_deg=azimuth))

    def _angles_changed(self, event: Any) -> None:
        if event.client is not None:
            elevation, roll = (
                float(self.angle[name].value) if self.held[name].value else None
                for name in ("elevation", "roll")
            )
            self.worker.correct(lambda state: replace(state, elevation_deg=elevation, roll_deg=roll))

    def _save(self) -> None:
        try:
            self._message(f"Saved in {self.session.save(self.folder)}.")
            self.saved = True
        except UserError as error:
            self._message(str(error), refused=True)

    def _message(self, words: str, refused: bool = False) -> None:
        emphasis = "**" if refused else ""
        self.words.content = f"{emphasis}{plain(words)}{emphasis}\n\n{HELP}"

    def _picture(self, explanation: Explanation) -> np.ndarray:
        full = explanation.overlay() if self.outline.value else coded(explanation.picture)
        shown = Image.fromarray(full).resize(self.sent_size, Image.Resampling.LANCZOS, reducing_gap=2.0)
        if self.outline.value:
            self._draw_hints(ImageDraw.Draw(shown, "RGBA"))
        return np.asarray(shown)

    def _draw_hints(self, draw: ImageDraw.ImageDraw) -> None:
        """Box, marks and points of the user."""
        state, scale = self.session.state, self.sent_size[0] / self.session.photo.shape[1]
        if state.box is not None:
            x, y, width, height = (number * scale for number in state.box)
            draw.rectangle((x, y, x + width, y + height), outline=(255, 255, 255, 255), width=2)
        for mark in state.marks:
            place = (mark.x * scale, mark.y * scale)
            draw.circle(
                place, max(mark.radius * scale, 2.0), fill=(*MARK_COLOURS[PixelLabel(mark.said)], 130)
            )
        for name, (x, y) in state.points.items():
            place = (x * scale, y * scale)
            draw.circle(place, 5, fill=(255, 255, 255, 255), outline=(0, 0, 0, 255), width=2)
            draw.text((place[0] + 8, place[1] - 6), name, fill="white", stroke_width=2, stroke_fill="black")

    def _show(self) -> None:
        """Photo, object and controls as the explanation and the state have them.

        The controls only where no correction waits: they are ahead of the state then.
        """
        explanation = self.session.explanation
        self.image.image = self._picture(explanation)
        self._show_object(explanation)
        hidden, mask_confidence = explanation.hidden_fraction, explanation.mask_confidence
        summary = f"azimuth {explanation.azimuth_deg:.0f}°, elevation {explanation.elevation_deg:.0f}°"
        summary += "" if hidden is None else f", {hidden:.0%} hidden"
        summary += "" if math.isnan(mask_confidence) else f"; mask right with {mask_confidence:.0%}"
        self.verdict.content = f"**{explanation.verdict}**: {summary}\n\n{plain(explanation.reason)}"
        if self.worker.corrections_wait:
            return
        state = self.session.state
        for name, held in (("elevation", state.elevation_deg), ("roll", state.roll_deg)):
            self.held[name].value = held is not None
            degrees = getattr(explanation, f"{name}_deg") if held is None else held
            self.angle[name].value = round(np.clip(degrees, self.angle[name].min, self.angle[name].max))
        self.visible.value = state.visible
        choices: dict[str, float | None] = {AS_FOUND: None}
        chosen = AS_FOUND
        if state.azimuth_deg is not None:
            chosen = f"azimuth {state.azimuth_deg:.0f}°, chosen"
            choices[chosen] = state.azimuth_deg
        for probability, azimuth in (
            (explanation.confidence, explanation.azimuth_deg),
            *((other.probability, other.azimuth_deg) for other in explanation.alternatives),
        ):
            percentage = "" if math.isnan(probability) else f", {probability:.0%}"
            choices[f"azimuth {azimuth:.0f}°{percentage}"] = azimuth
        self.choices = choices
        self.views.options = tuple(choices)
        self.views.value = chosen

    def _show_object(self, explanation: Explanation) -> None:
        """The object as the photo's eye sees it, a mesh for each part."""
        width = self.session.photo.shape[1] * self.unit
        centred = explanation.vertices - (explanation.vertices.max(0) + explanation.vertices.min(0)) / 2
        turn = LOOKS_BACK[:3, :3] @ explanation.camera_from_object[:3, :3]
        positions = centred * (OBJECT / np.ptp(centred, axis=0).max()) @ turn.T
        positions -= [width / 2 + GAP + OBJECT / 2, 0.0, 0.0]
        model, colours = explanation.object_class.shape_model, srgb8_from_linear(explanation.part_albedo)
        of_face = model.parts[model.faces[:, 0]]
        for number in range(len(model.part_names)):
            used, faces = np.unique(model.faces[of_face == number], return_inverse=True)
            self.server.scene.add_mesh_simple(
                f"/object/{number}",
                positions[used],
                faces.reshape(-1, 3),
                color=np.asarray(colours[number]),
                side="double",
            )
