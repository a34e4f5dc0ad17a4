"""`vig view`: what a session takes and takes back, and the page in a browser."""

from __future__ import annotations

import json
import math
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import vig
from tests.support import LOW_CONTRAST
from vig.inference import PixelLabel
from vig.io.errors import UserError
from vig_app.cli.main import main
from vig_app.corrections import Mark, State, result_in
from vig_app.examples import example_photos
from vig_app.viewer import Session

SPOKEN: Any = ["viser-v1.1.1"]


@pytest.fixture(scope="module")
def explainer() -> vig.Explainer:
    return vig.Explainer("teapot")


@pytest.fixture
def session(explainer: vig.Explainer, tmp_path: Path) -> Session:
    """An example in the middle of a larger photo."""
    large = Image.new("RGB", (400, 300), (120, 120, 120))
    with Image.open(example_photos()[3].photo) as small:
        large.paste(small, (120, 70))
    large.save(tmp_path / "photo.png")
    return Session(explainer, tmp_path / "photo.png")


def test_a_result_of_vig_fit_can_be_resumed(session: Session, tmp_path: Path) -> None:
    arguments = ["fit", str(session.path), "--box", "100,60,190,180", "--points", "spout=150,140"]
    for further, resumable in (
        (["--focal", "900", "--roll", "3"], True),
        (["--pose", str(tmp_path / "p.json")], False),
    ):
        (tmp_path / "p.json").write_text(json.dumps(np.eye(4).tolist()))
        with pytest.raises(SystemExit):
            main([*arguments, *further, "--out", str(tmp_path / f"out{resumable}")])
        folder = tmp_path / f"out{resumable}" / "photo"
        assert (folder / "corrections.json").exists() == resumable
    with pytest.raises(SystemExit):  # into the folder of the first
        main([*arguments, "--pose", str(tmp_path / "p.json"), "--out", str(tmp_path / "outAgain")])
    assert not (tmp_path / "outAgain" / "photo" / "corrections.json").exists()
    photo, object_class, state = State.read(tmp_path / "outTrue" / "photo")
    assert photo.samefile(session.path) and object_class == "teapot"
    assert state == State((100, 60, 190, 180), {"spout": (150, 140)}, roll_deg=3.0, focal=900.0)
    again = Session(session.explainer, photo, state).explanation.to_dict()
    assert again == json.loads((tmp_path / "outTrue" / "photo" / "explanation.json").read_text())


def test_every_correction_is_a_state_that_can_be_taken_back(session: Session) -> None:
    first = session.explanation
    session.place("spout", 150.0, 140.0)
    session.mark(PixelLabel.IN_FRONT, 200.0, 150.0, 12.0)
    held = session.hold(25.0, None)
    assert held.elevation_deg == pytest.approx(25.0, abs=1e-3)
    assert held.to_dict()["hints"]["points"] == {"spout": [150.0, 140.0]}
    assert held.to_dict()["hints"]["marks"] == pytest.approx(math.pi * 144, rel=0.05)
    assert session.undo().to_dict()["hints"].keys() == {"points", "marks"}
    assert session.clear().to_dict()["hints"] == {}
    assert session.explanation.azimuth_deg == first.azimuth_deg
    for _ in range(9):
        session.undo()
    assert session.explanation.to_dict() == first.to_dict() and len(session.states) == 1


def test_a_box_is_cut_at_the_photos_edges_and_a_bad_one_loses_nothing(session: Session) -> None:
    session.draw_box(90.0, -20.0, 200.0, 900.0)
    assert session.state.box == (90.0, 0.0, 200.0, 300.0)
    previous = session.explanation
    with pytest.raises(UserError, match="at least 8 pixels a side"):
        session.draw_box(10.0, 10.0, 2.0, 2.0)
    with pytest.raises(UserError, match="names"):
        session.place("nose", 1.0, 1.0)
    assert session.explanation is previous and len(session.states) == 2


def test_what_is_saved_is_what_vig_fit_saves_and_can_be_resumed(
    session: Session, explainer: vig.Explainer, tmp_path: Path
) -> None:
    session.say_visible(True)
    session.draw_box(100.0, 60.0, 190.0, 180.0)
    session.place("spout", 150.0, 140.0)
    session.mark(PixelLabel.IN_FRONT, 200.0, 150.0, 12.0)
    folder = session.save(tmp_path / "out")
    assert {path.name for path in folder.iterdir()} >= {"explanation.json", "object.glb", "report.html"}
    assert json.loads((folder / "explanation.json").read_text())["hints"].keys() == {
        "visible",
        "points",
        "marks",
    }
    photo, object_class, state = State.read(folder)
    assert state == session.state and object_class == "teapot" and photo.samefile(session.path)
    again = Session(explainer, photo, state)
    assert again.explanation.to_dict() == session.explanation.to_dict()


WRITTEN = {"format": 1, "photo": "photo.png", "class": "teapot", "state": {"box": [100, 60, 190, 180]}}


@pytest.mark.parametrize(
    "content",
    [
        "{",
        "[]",
        "{}",
        "[" * 5000,
        {"format": 2},
        {"photo": 3},
        {"state": {"box": "9999"}},
        {"state": {"box": [1, 2, 3]}},
        {"state": {"roll_deg": "3"}},
        {"state": {"visible": "no"}},
        {"state": {"azimuth_deg": 10**400}},
        {"state": {"points": {"spout": [1e400, 1]}}},
        {"state": {"marks": [{"x": 1, "y": 1, "radius": 2}]}},
        {"state": {"nose": 1}},
    ],
    ids=str,
)
def test_corrections_of_other_types_are_refused(tmp_path: Path, content: Any) -> None:
    text = content if isinstance(content, str) else json.dumps(WRITTEN | content)
    (tmp_path / "corrections.json").write_text(text)
    with pytest.raises(UserError, match="expected corrections of a photo at .*Name the photo itself"):
        State.read(tmp_path)


@pytest.mark.parametrize(
    ("state", "message"),
    [
        (State(box=(10, 10, 2, 2)), "at least 8 pixels a side"),
        (State(points={"spout": (1e300, 1)}), "on the photo or near it"),
        (State(points={"nose": (1, 1)}), "names"),
        (State(marks=(Mark(900.0, 10.0, 3.0, 1),)), "expected marks on the photo"),
        (State(marks=(Mark(10.0, 10.0, math.inf, 1),)), "expected marks on the photo"),
        (State(marks=(Mark(10.0, 10.0, -1.0, 1),)), "expected marks on the photo"),
        (State(marks=(Mark(10.0, 10.0, 3.0, 9),)), "expected marks on the photo"),
        (State(focal=-1.0), "focal length"),
        (State(elevation_deg=100.0), "within 90 degrees"),
        (State(roll_deg=math.nan), "roll_deg"),
    ],
)
def test_what_does_not_suit_the_photo_is_refused_before_it_is_a_state(
    session: Session, state: State, message: str
) -> None:
    previous = session.explanation
    with pytest.raises(UserError, match=message):
        session.correct(lambda _: state, lambda _: State(visible=True))
    assert session.explanation is previous and session.states == [State()]


def test_what_changes_nothing_is_no_step_back(session: Session) -> None:
    for _ in range(3):
        session.hold(None, None)
    assert len(session.states) == 1


def test_a_result_in_a_linked_folder_finds_its_photo(session: Session, tmp_path: Path) -> None:
    (tmp_path / "far" / "away").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "far" / "away")
    session.save(tmp_path / "link" / "result")
    photo, object_class, _ = State.read(tmp_path / "link" / "result")
    assert photo.samefile(session.path) and object_class == "teapot"


def waited(page: Any, what: Callable[[], bool]) -> None:
    """Until it holds; fails after half a minute."""
    ends = time.monotonic() + 30
    while not what():
        assert time.monotonic() < ends, "it did not come about"
        page.wait_for_timeout(200)


@pytest.fixture
def viewer(session: Session, tmp_path: Path) -> Iterator[Any]:
    pytest.importorskip("viser")
    from vig_app.viewer.server import Viewer

    served = Viewer(session, tmp_path / "saved", port=8431)
    yield served
    served.stop()


class Page:
    """The viewer's page in a browser, as a user has it."""

    def __init__(self, browser: Any, viewer: Any, width: int, height: int) -> None:
        self.viewer, self.width, self.height = viewer, width, height
        self.asked: list[str] = []
        self.errors: list[str] = []
        self.page = browser.new_page(viewport={"width": width, "height": height})
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(f"http://127.0.0.1:{viewer.port}")
        self.page.get_by_text("azimuth").first.wait_for()
        waited(self.page, lambda: len(viewer.server.get_clients()) == 1)
        self.page.wait_for_timeout(2000)
        # Newer browsers without a GPU are warned of it, over the photo on a small screen.
        for button in self.page.locator(".mantine-Notification-closeButton").all():
            button.click()
        self.page.wait_for_timeout(500)

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Where a pixel of the photo is on the screen, by the camera that the page has."""
        (client,) = self.viewer.server.get_clients().values()
        height, width = self.viewer.session.photo.shape[:2]
        camera, unit = client.camera, self.viewer.unit
        from viser.transforms import SO3

        place = np.array([(x - width / 2) * unit, (height / 2 - y) * unit, 0.0])
        across, down, away = SO3(np.asarray(camera.wxyz)).inverse().as_matrix() @ (place - camera.position)
        scale = camera.image_height / 2 / math.tan(camera.fov / 2)
        return camera.image_width / 2 + scale * across / away, camera.image_height / 2 + scale * down / away

    def choose(self, label: str, option: str) -> None:
        """One of a drop-down's, by the keyboard alone."""
        number = ("a click says", "view").index(label)
        field = self.page.get_by_role("combobox").filter(visible=True).nth(number)
        field.focus()
        field.fill(option)
        self.page.wait_for_timeout(500)
        if self.page.get_by_role("option").filter(visible=True).count() == 1:  # the list was narrowed
            field.press("ArrowDown")
        field.press("Enter")
        handle = self.viewer.tool if label == "a click says" else self.viewer.views
        waited(self.page, lambda: handle.value.startswith(option.partition(",")[0]))
        self.page.wait_for_timeout(1500)  # the page then takes the mouse's drags otherwise

    def drag(self, start: tuple[float, float], end: tuple[float, float], done: Callable[[], bool]) -> None:
        """From pixel to pixel of the photo; again where a busy page turned the scene instead."""
        mouse = self.page.mouse
        for _ in range(5):
            mouse.move(*self.at(*start))
            mouse.down()
            mouse.move(*self.at((start[0] + end[0]) / 2, (start[1] + end[1]) / 2))
            mouse.move(*self.at(*end))
            mouse.up()
            for _ in range(40):
                if done():
                    return
                self.page.wait_for_timeout(200)
            self.page.get_by_role("button", name="look straight").click()
            self.page.wait_for_timeout(2000)
        raise AssertionError("dragging did nothing")


SCREENS = {"phone": (390, 844), "laptop": (1300, 800)}


@pytest.mark.parametrize("screen", SCREENS)
def test_a_box_two_points_another_view_and_saving_in_a_browser(
    browser: Any, viewer: Any, tmp_path: Path, screen: str
) -> None:
    shown, session = Page(browser, viewer, *SCREENS[screen]), viewer.session
    mouse = shown.page.mouse
    try:
        shown.choose("a click says", "a box round the object")
        shown.drag((130, 75), (265, 215), lambda: session.state.box is not None and not viewer.worker.busy)
        assert session.state.box == pytest.approx((130, 75, 135, 140), abs=3)
        for name, place in (("spout", (150.0, 140.0)), ("handle", (250.0, 150.0))):
            shown.choose("a click says", name)
            mouse.click(*shown.at(*place))
            waited(shown.page, lambda name=name: name in session.state.points and not viewer.worker.busy)  # type: ignore[misc]
            assert session.state.points[name] == pytest.approx(place, abs=3)
        shown.choose("view", next(words for words in viewer.choices if words != "as found"))
        waited(shown.page, lambda: session.state.azimuth_deg is not None and not viewer.worker.busy)
        mouse.move(300, 200)
        mouse.down()
        mouse.move(330, 260, steps=3)
        mouse.up()
        shown.page.get_by_role("button", name="look straight").click()
        shown.page.get_by_role("button", name="save").click()
        waited(shown.page, lambda: viewer.saved)
        described = json.loads((tmp_path / "saved" / "explanation.json").read_text())
        assert described["hints"].keys() == {"points", "azimuth_deg"}
        shown.page.get_by_role("button", name="undo").click()
        waited(shown.page, lambda: session.state.azimuth_deg is None)
        for dark in (True, False):
            shown.page.get_by_role("checkbox").last.set_checked(dark)
            waited(shown.page, lambda dark=dark: viewer.dark.value == dark)  # type: ignore[misc]
            shown.page.wait_for_timeout(500)
            assert shown.page.evaluate(LOW_CONTRAST) == []
        own = (f"http://127.0.0.1:{viewer.port}", f"ws://127.0.0.1:{viewer.port}", "data:", "blob:")
        assert not shown.errors and [url for url in shown.asked if not url.startswith(own)] == []
    finally:
        shown.page.close()


HOSTILE = (
    'p<iframe srcdoc="<script>parent.document.title=\'PWN\'<&#47;script>"><img src=x onerror="alert(1)">'
    "{alert(1)}**[a](javascript:alert(1)).png"
)


def test_a_photos_name_is_shown_as_it_is(
    browser: Any, session: Session, explainer: vig.Explainer, tmp_path: Path
) -> None:
    pytest.importorskip("viser")
    from vig_app.viewer.server import Viewer

    path = tmp_path / HOSTILE
    shutil.copy(session.path, path)
    served = Viewer(Session(explainer, path), tmp_path / HOSTILE.replace(".png", ""), port=8431)
    shown = Page(browser, served, *SCREENS["laptop"])
    try:
        served.worker.correct(lambda state: replace(state, box=(10.0, 10.0, 2.0, 2.0)))
        waited(shown.page, lambda: not served.worker.busy)
        served._message(f"Saved in {HOSTILE}", refused=True)
        shown.page.get_by_text(f"Saved in {HOSTILE}").wait_for()
        assert "PWN" not in shown.page.title() and shown.page.locator("iframe").count() == 0
        assert not shown.errors
    finally:
        shown.page.close()
        served.stop()


def test_a_page_of_another_site_cannot_connect(viewer: Any) -> None:
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect
    from websockets.typing import Origin

    address = f"ws://127.0.0.1:{viewer.port}"
    with connect(address, origin=Origin(f"http://localhost:{viewer.port + 1}"), subprotocols=SPOKEN):
        pass  # as over a port that SSH forwards
    for origin in ("http://evil.example", "http://127.0.0.1.evil.example", "https://localhost:1", "null"):
        with pytest.raises(InvalidStatus, match="403"):
            connect(address, origin=Origin(origin), subprotocols=SPOKEN)
    assert viewer.server.request_share_url() is None


def test_the_next_free_port_is_taken_and_none_is_told() -> None:
    pytest.importorskip("viser")
    from vig_app.viewer.server import free_port

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 65535))
        taken.listen()
        with pytest.raises(UserError, match="expected a free port from 65535 on; got none"):
            free_port(65535)
        assert free_port(65400) < 65535


def test_the_keyboard_alone(browser: Any, viewer: Any) -> None:
    """A place can be typed; what cannot be used is told, and loses nothing."""
    shown, session = Page(browser, viewer, *SCREENS["laptop"]), viewer.session
    place = shown.page.locator(".mantine-TextInput-input").filter(visible=True).first
    say = shown.page.get_by_role("button", name="say it there")

    def typed(text: str) -> None:
        place.fill(text)
        waited(shown.page, lambda: viewer.place.value == text)
        say.press("Enter")

    try:
        typed("150, 140")
        shown.page.get_by_text("Choose first what a click says").wait_for()
        shown.choose("a click says", "spout")
        typed("150")
        shown.page.get_by_text("Type x, y.").wait_for()
        typed("150, 140")
        waited(shown.page, lambda: session.state.points == {"spout": (150.0, 140.0)})
        shown.choose("a click says", "a box round the object")
        typed("10 10 2 2")
        shown.page.get_by_text("at least 8 pixels a side").wait_for()
        typed("100 60 190 180")
        waited(shown.page, lambda: session.state.box == (100.0, 60.0, 190.0, 180.0))
        assert session.state.points == {"spout": (150.0, 140.0)} and not shown.errors
    finally:
        shown.page.close()


def test_vig_view_serves_until_it_is_interrupted(session: Session, tmp_path: Path) -> None:
    pytest.importorskip("viser")
    command = [
        sys.executable,
        "-c",
        "from vig_app.cli.main import main; main()",
        "view",
        str(session.path),
        "--no-open",
        "--port",
        "8467",
    ]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = next(line for line in process.stdout if line.startswith("http")).strip()
        with urllib.request.urlopen(address, timeout=20) as answer:
            assert b"<html" in answer.read(2000).lower()
        assert address.startswith("http://127.0.0.1:")
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0


def test_the_folder_of_a_run_of_one_photo_is_that_of_its_result(session: Session, tmp_path: Path) -> None:
    for name in ("a", "b"):
        result = tmp_path / "run" / name
        session.save(result)
        assert result_in(result) == result
        if name == "a":
            assert result_in(tmp_path / "run") == result
    with pytest.raises(UserError, match=r"holds no corrections.json. Name one in it, such as '.*/run/a'"):
        State.read(result_in(tmp_path / "run"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.jpg"], "nothing of that name"),
        (["."], "holds no corrections.json"),
        (["photo.png", "--port", "0"], "a port of 1 to 65535"),
        (["photo.png", "--box", "1,2"], "box"),
        (["result", "--class", "mug"], "has one. Leave it out"),
        (["result", "--out", "other"], "has one. Leave it out"),
    ],
)
def test_what_vig_view_refuses(
    session: Session,
    arguments: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(session.path.parent)
    Path("result").mkdir()
    with pytest.raises(SystemExit) as ended:
        main(["view", *arguments])
    assert ended.value.code == 2 and message in capsys.readouterr().err
