"""`vig view`: what a session takes and takes back, and what its server answers."""

import http.client
import json
import math
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vig
from tests.support import run_vig
from tests.vig_app.viewer.conftest import large_photo
from vig.hints import Stroke
from vig.inference import PixelLabel
from vig.io.errors import UserError
from vig_app.corrections import State
from vig_app.examples import example_photos
from vig_app.results import write_table
from vig_app.viewer import Session
from vig_app.viewer.server import Viewer
from vig_app.viewer.session import add_stroke, clear_corrections, dismiss, set_point, set_state
from vig_app.viewer.walk import Walk


@pytest.fixture(scope="module")
def untouched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Viewer]:
    """One for all tests of refusals, which leave it as it is."""
    folder = tmp_path_factory.mktemp("untouched")
    served = Viewer(Walk.of_photo(large_photo(folder / "photo.png"), "teapot", folder / "saved"), port=8451)
    yield served
    served.stop()


def test_a_result_of_vig_fit_can_be_resumed(session: Session, tmp_path: Path) -> None:
    arguments = ["fit", str(session.path), "--box", "100,60,190,180", "--points", "spout=150,140"]
    for further, resumable in (
        (["--focal", "900", "--roll", "3"], True),
        (["--pose", str(tmp_path / "p.json")], False),
    ):
        (tmp_path / "p.json").write_text(json.dumps(np.eye(4).tolist()))
        run_vig(*arguments, *further, "--out", tmp_path / f"out{resumable}")
        folder = tmp_path / f"out{resumable}" / "photo"
        assert (folder / "corrections.json").exists() == resumable
    run_vig(*arguments, "--pose", tmp_path / "p.json", "--out", tmp_path / "outAgain")
    assert not (tmp_path / "outAgain" / "photo" / "corrections.json").exists()
    photo, object_class, state = State.read(tmp_path / "outTrue" / "photo")
    assert photo.samefile(session.path) and object_class == "teapot"
    assert state == State(box=(100, 60, 190, 180), points={"spout": (150, 140)}, roll_deg=3.0, focal=900.0)
    again = Session(session.explainer, photo, state).explanation.to_dict()
    assert again == json.loads((tmp_path / "outTrue" / "photo" / "explanation.json").read_text())


def test_every_correction_is_a_state_that_can_be_taken_back(session: Session) -> None:
    first = session.explanation
    session.correct(set_point("spout", 150.0, 140.0))
    session.correct(add_stroke(PixelLabel.IN_FRONT, 200.0, 150.0, 12.0))
    held = session.correct(set_state(elevation_deg=25.0, roll_deg=None))
    assert held.elevation_deg == pytest.approx(25.0, abs=1e-3)
    assert held.to_dict()["hints"]["points"] == {"spout": [150.0, 140.0]}
    assert held.to_dict()["hints"]["marks"] == pytest.approx(math.pi * 144, rel=0.05)
    assert session.correct(None).to_dict()["hints"].keys() == {"points", "marks"}
    assert session.correct(clear_corrections).to_dict()["hints"] == {}
    assert session.explanation.azimuth_deg == first.azimuth_deg
    for _ in range(9):
        session.correct(None)
    assert session.explanation.to_dict() == first.to_dict() and len(session.states) == 1


def test_an_object_that_is_not_there_is_absent_until_it_is_corrected(
    session: Session, tmp_path: Path
) -> None:
    session.correct(set_point("spout", 150.0, 140.0), dismiss)
    absent = session.explanation
    assert absent.verdict is vig.Verdict.ABSENT and not absent.amodal.any() and not session.state.points
    assert absent.reason == "teapot: marked by hand as not there" and absent.to_dict()["present"] is None
    session.save(tmp_path / "saved")
    again = Session(session.explainer, *(State.read(tmp_path / "saved")[number] for number in (0, 2)))
    assert again.explanation.verdict is vig.Verdict.ABSENT
    for back in (again.set_box(130, 75, 135, 140), set_point("spout", 150.0, 140.0), clear_corrections):
        again.correct(back)
        assert again.explanation.verdict is not vig.Verdict.ABSENT
        again.correct(dismiss)


def test_a_box_is_cut_at_the_photos_edges_and_a_bad_one_loses_nothing(session: Session) -> None:
    session.correct(session.set_box(90.0, -20.0, 200.0, 900.0))
    assert session.state.box == (90.0, 0.0, 200.0, 300.0)
    previous = session.explanation
    with pytest.raises(UserError, match="at least 8 pixels a side"):
        session.correct(session.set_box(10.0, 10.0, 2.0, 2.0))
    with pytest.raises(UserError, match="names"):
        session.correct(set_point("nose", 1.0, 1.0))
    assert session.explanation is previous and len(session.states) == 2


def test_what_is_saved_is_what_vig_fit_saves_and_can_be_resumed(
    session: Session, explainer: vig.Explainer, tmp_path: Path
) -> None:
    session.correct(set_state(visible=True))
    session.correct(session.set_box(100.0, 60.0, 190.0, 180.0))
    session.correct(set_point("spout", 150.0, 140.0))
    session.correct(add_stroke(PixelLabel.IN_FRONT, 200.0, 150.0, 12.0))
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
        (State(strokes=(Stroke(900.0, 10.0, 3.0, 1),)), "expected marks on the photo"),
        (State(strokes=(Stroke(10.0, 10.0, math.inf, 1),)), "expected marks on the photo"),
        (State(strokes=(Stroke(10.0, 10.0, -1.0, 1),)), "expected marks on the photo"),
        (State(strokes=(Stroke(10.0, 10.0, 3.0, 9),)), "expected marks on the photo"),
        (State(focal=-1.0), "focal length"),
        (State(elevation_deg=100.0), "within 90 degrees"),
        (State(roll_deg=math.nan), "roll_deg"),
    ],
)
def test_what_does_not_suit_the_photo_is_refused_before_it_is_a_state(
    untouched: Viewer, state: State, message: str
) -> None:
    session = untouched.walk.session
    previous = session.explanation
    with pytest.raises(UserError, match=message):
        session.correct(lambda _: state, lambda _: State(visible=True))
    assert session.explanation is previous and session.states == [State()]


def test_what_changes_nothing_is_no_step_back(session: Session) -> None:
    for _ in range(3):
        session.correct(set_state(elevation_deg=None, roll_deg=None))
    assert len(session.states) == 1


def test_a_result_in_a_linked_folder_finds_its_photo(session: Session, tmp_path: Path) -> None:
    (tmp_path / "far" / "away").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "far" / "away")
    session.save(tmp_path / "link" / "result")
    photo, object_class, _ = State.read(tmp_path / "link" / "result")
    assert photo.samefile(session.path) and object_class == "teapot"


def asked(viewer: Viewer, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, Any]:
    """Status and content of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=30)
    content = body if body is None or isinstance(body, str) else json.dumps(body)
    connection.request(method, path, content, headers)
    answer = connection.getresponse()
    content = answer.read()
    return answer.status, json.loads(content) if answer.getheader(
        "Content-Type"
    ) == "application/json" else content


def test_a_page_of_another_site_gets_nothing(viewer: Viewer) -> None:
    own = f"127.0.0.1:{viewer.port}"
    box = {"item": 0, "actions": [{"do": "box", "at": [100, 60, 190, 180]}]}
    for host in ("evil.example", f"localhost.evil.example:{viewer.port}", "", "127.0.0.1.evil.example"):
        assert asked(viewer, "GET", "/state", Host=host)[0] == 403, "a name that was made to point here"
    for origin in ("http://evil.example", f"http://localhost:{viewer.port}", "null", f"https://{own}"):
        assert asked(viewer, "POST", "/act", box, Host=own, Origin=origin)[0] == 403
    assert viewer.walk.session.states == [State()]
    for host in (own, "localhost:9999", "[::1]:8080"):  # as over a port that SSH forwards
        assert asked(viewer, "GET", "/", Host=host, Origin=f"http://{host}")[0] == 200
    assert asked(viewer, "POST", "/act", box, Host=own, Origin=f"http://{own}")[0] == 200
    assert viewer.walk.session.state.box == (100, 60, 190, 180)


@pytest.mark.parametrize(
    "body",
    [
        [],
        "[" * 100_000,
        {"item": 0, "actions": [{"do": "delete"}]},
        {"item": 0, "actions": [{"do": "box", "at": [1, 2]}]},
        {"item": 0, "actions": [{"do": "mark", "at": [1, 2], "label": 9, "radius": 3}]},
        {"item": 0, "actions": [{"do": "view", "value": "1"}]},
    ],
    ids=lambda body: str(body)[:40],
)
def test_what_the_page_does_not_send_is_refused(untouched: Viewer, body: Any) -> None:
    status, content = asked(untouched, "POST", "/act", body)
    assert status == 400 and content["error"] and untouched.walk.session.states == [State()]


def test_corrections_that_come_together_are_fitted_once_and_a_bad_one_alone_is_left_out(
    viewer: Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    fits = list[State]()
    explained = State.explain
    monkeypatch.setattr(State, "explain", lambda self, *others: fits.append(self) or explained(self, *others))

    def act(*actions: dict[str, Any], item: int = 0) -> dict[str, Any]:
        status, content = asked(viewer, "POST", "/act", {"item": item, "actions": actions})
        assert status == 200
        return content  # type: ignore[no-any-return]

    spout = {"do": "point", "name": "spout", "at": [150, 140]}
    state = act({"do": "roll", "value": 3}, {"do": "elevation", "value": 20}, spout)
    assert len(fits) == 1 and state["undo"] == 3 and not state["refused"] and state["unsaved"]
    state = act({"do": "box", "at": [1, 1, 2, 2]}, {"do": "undo"}, {"do": "visible", "value": 1})
    assert "at least 8 pixels a side" in state["message"] and state["refused"]
    assert state["hints"]["visible"] and state["hints"]["points"] == {"spout": [150, 140]}
    assert state["undo"] == 4, "what took the bad one back did nothing"
    state = act({"do": "undo"}, {"do": "save"})
    assert state["message"].startswith("Saved in") and not state["unsaved"] and state["corrected"] == [0]
    assert "Another page" in act(spout, item=3)["message"]


def test_a_fault_is_reported_and_the_page_goes_on(
    viewer: Viewer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: Any) -> None:
        raise ZeroDivisionError

    with monkeypatch.context() as patch:
        patch.setattr(State, "explain", broken)
        status, content = asked(viewer, "POST", "/act", {"item": 0, "actions": [{"do": "roll", "value": 3}]})
    assert status == 500 and content["error"] == "That went wrong; the terminal says more."
    assert "ZeroDivisionError" in capsys.readouterr().err
    assert asked(viewer, "GET", "/state")[1]["hints"]["roll_deg"] is None


def test_the_next_free_port_is_taken_and_none_is_reported(viewer: Viewer, tmp_path: Path) -> None:
    walk = Walk.of_photo(viewer.walk.session.path, "teapot", tmp_path / "saved")
    other = Viewer(walk, viewer.port)
    assert viewer.port < other.port < viewer.port + 9
    other.stop()
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 65535))
        taken.listen()
        with pytest.raises(UserError, match="expected a free port from 65535 on; got none"):
            Viewer(walk, 65535)


def test_a_stroke_is_continuous_and_as_wide_as_its_brush(session: Session) -> None:
    marks = np.zeros((300, 400), np.uint8)
    Stroke(50.0, 50.0, 5.0, PixelLabel.SEEN, ((150.0, 50.0), (150.0, 120.0))).paint(marks)
    rows, columns = np.mgrid[:300, :400] + 0.5
    across = np.hypot(columns - columns.clip(50, 150), rows - 50)
    down = np.hypot(columns - 150, rows - rows.clip(50, 120))
    assert np.array_equal(marks == PixelLabel.SEEN, np.minimum(across, down) <= 5)
    session.correct(add_stroke(PixelLabel.IN_FRONT, 200.0, 150.0, 4.0, [(240.0, 150.0)]))
    assert session.explanation.to_dict()["hints"]["marks"] == pytest.approx(40 * 8 + math.pi * 16, rel=0.05)
    with pytest.raises(UserError, match="expected marks on the photo"):
        session.correct(add_stroke(PixelLabel.IN_FRONT, 200.0, 150.0, 4.0, [(240.0, 1e9)]))


def test_vig_view_serves_until_it_is_interrupted(session: Session, tmp_path: Path) -> None:
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
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=tmp_path, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout is not None
        address = next(line for line in process.stdout if line.startswith("http")).strip()
        with urllib.request.urlopen(address, timeout=20) as answer:
            assert b"<html" in answer.read(2000).lower()
        assert address.startswith("http://127.0.0.1:")
        actions = {"item": 0, "actions": [{"do": "roll", "value": 3}]}
        with urllib.request.urlopen(f"{address}/act", json.dumps(actions).encode(), timeout=60) as answer:
            assert json.load(answer)["unsaved"]
        process.send_signal(signal.SIGINT)
        assert process.stderr is not None
        assert "corrections of photo.png were not saved" in process.stderr.read()
        assert process.wait(20) == 0


def test_a_folder_of_results_is_opened_whatever_it_holds(session: Session, tmp_path: Path) -> None:
    for name in ("a", "b"):
        session.save(tmp_path / "run" / name)
        walk = Walk.of_folder(tmp_path / "run")
        assert sorted(item.folder.name for item in walk.items) == ["a", "b"][: len(walk.items)]
    assert len(walk.items) == 2 and [item.name for item in Walk.of_folder(tmp_path / "run" / "a").items] == [
        "a"
    ]
    (tmp_path / "run" / "a" / "explanation.json").write_text("{}")
    with pytest.raises(UserError, match="expected an explanation of `vig fit` at"):
        Walk.of_folder(tmp_path / "run")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.jpg"], "nothing of that name"),
        (["."], "holds no corrections.json or results.csv"),
        (["run"], "has 1 that were not"),
        (["photo.png", "--port", "0"], "a port of 1 to 65535"),
        (["photo.png", "--box", "1,2"], "box"),
        (["result", "--class", "mug"], "has one. Leave it out"),
        (["result", "--out", "other"], "has one. Leave it out"),
    ],
)  # fmt: skip
def test_what_vig_view_refuses(tmp_path, arguments: list[str], message: str, monkeypatch, capsys) -> None:
    monkeypatch.chdir(large_photo(tmp_path / "photo.png").parent)
    Path("result").mkdir()
    write_table(Path("run"), [{"photo": "gone.png", "folder": "gone", "error": "gone"}])
    assert run_vig("view", *arguments) == 2 and message in capsys.readouterr().err


def test_a_box_that_vig_found_is_no_users(explainer: vig.Explainer, tmp_path: Path) -> None:
    """A fit within it is trusted no more than where it was found, until a user says where it is."""
    photo = example_photos()[0].photo
    box = Session(explainer, photo).explanation.box
    found = State(box=box, found=0.6)
    found.write(tmp_path / "1-teapot", photo, explainer.object_class)
    _, _, state = State.read(tmp_path / "1-teapot")
    assert state == found
    ghost = Session(explainer, photo, state)
    explained = ghost.explanation
    assert explained.present == 0.6
    assert explained.verdict is vig.Verdict.AMBIGUOUS and "may be no teapot" in explained.reason
    assert ghost.correct(set_state(azimuth_deg=explained.azimuth_deg)).verdict is vig.Verdict.AMBIGUOUS
    assert ghost.correct(ghost.set_box(*box)).verdict is vig.Verdict.TRUSTED
    assert ghost.state.found is None
