"""The page of `vig view` in a browser: what is drawn on it becomes hints, at every size, light and dark."""

import json
import re
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import vig
from tests.support import LOW_CONTRAST, run_vig
from tests.vig_app.viewer.conftest import large_photo
from vig.inference import PixelLabel
from vig.io.errors import UserError
from vig_app.corrections import State
from vig_app.examples import example_photos
from vig_app.results import read_results, write_table
from vig_app.viewer.server import Viewer
from vig_app.viewer.session import add_stroke, dismiss, set_point, set_state
from vig_app.viewer.walk import Walk

SCREENS = {"phone": (390, 844), "laptop": (1280, 800), "wide": (1920, 1080)}
HOSTILE = (
    'p<iframe srcdoc="<script>parent.document.title=\'PWN\'<&#47;script>"><img src=x onerror="alert(1)">'
    "{alert(1)}**[a](javascript:alert(1)).png"
)


def two_pots(path: Path) -> Path:
    photo = Image.new("RGB", (560, 300), (120, 120, 120))
    for number, left in ((3, 60), (0, 330)):
        with Image.open(example_photos()[number].photo) as small:
            photo.paste(small, (left, 70))
    photo.save(path)
    return path


def fit(*arguments: str | Path, code: int = 0) -> None:
    assert run_vig("fit", *arguments) == code


def fitted(folder: Path) -> Path:
    (folder / "photos").mkdir()
    for number in range(3):
        large_photo(folder / "photos" / f"{number}.png", number)
    fit(folder / "photos", "--out", folder / "run", "--quiet")
    return folder


@pytest.fixture(scope="module")
def made_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three photos and the results of `vig fit` of them."""
    return fitted(tmp_path_factory.mktemp("made"))


@pytest.fixture
def run(made_run: Path, tmp_path: Path) -> Path:
    """A copy of that run with its photos."""
    shutil.copytree(made_run / "photos", tmp_path / "photos", copy_function=shutil.copy2)
    shutil.copytree(made_run / "run", tmp_path / "run")
    return tmp_path / "run"


class Page:
    """The page in a browser, as a user has it."""

    def __init__(self, browser: Any, viewer: Viewer, screen: str = "laptop") -> None:
        width, height = SCREENS[screen]
        touch = screen == "phone"
        self.viewer, self.errors, self.asked = viewer, list[str](), list[str]()
        self.context = browser.new_context(
            viewport={"width": width, "height": height}, has_touch=touch, is_mobile=touch
        )
        self.page = self.context.new_page()
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("dialog", lambda dialog: dialog.accept())
        self.page.goto(f"http://127.0.0.1:{viewer.port}")
        self.page.locator("#verdict:not(:empty)").wait_for()

    @property
    def state(self) -> State:
        return self.viewer.walk.session.state

    def until(self, what: Callable[[], bool]) -> None:
        """Wait until it holds; fails after half a minute."""
        ends = time.monotonic() + 30
        while not what() or self.page.evaluate("busy"):
            assert time.monotonic() < ends, "it did not come about"
            self.page.wait_for_timeout(100)

    def layout(self) -> tuple[float, ...]:
        """Left, top, width and height of the photo on the screen."""
        box = self.page.locator("#photo").bounding_box()
        return box["x"], box["y"], box["width"], box["height"]

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Where a pixel of the photo is on the screen."""
        height, width = self.viewer.walk.session.photo.shape[:2]
        left, top, across, down = self.layout()
        return left + x * across / width, top + y * down / height

    def drag(self, *places: tuple[float, float], steps: int = 3) -> None:
        """Through pixels of the photo, in events far from each other."""
        mouse = self.page.mouse
        mouse.move(*self.at(*places[0]))
        mouse.down()
        for place in places[1:]:
            mouse.move(*self.at(*place), steps=steps)
        mouse.up()

    def close(self) -> None:
        """Nothing went wrong, and no other place was asked for anything."""
        own = (f"http://127.0.0.1:{self.viewer.port}", "data:")
        assert not self.errors and [url for url in self.asked if not url.startswith(own)] == []
        self.context.close()


@pytest.mark.parametrize("screen", SCREENS)
def test_a_box_a_stroke_another_view_saving_and_the_next_photo(browser: Any, run: Path, screen: str) -> None:
    viewer = Viewer(Walk.of_folder(run), 8431)
    shown = Page(browser, viewer, screen)
    page, name = shown.page, viewer.walk.items[0].folder.name
    try:
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        before = shown.layout()
        assert before[2] / before[3] == pytest.approx(400 / 300, rel=0.01), "flat"
        assert min(before[:2]) >= 0 and before[0] + before[2] <= SCREENS[screen][0] + 1
        assert before[1] + before[3] <= SCREENS[screen][1] + 1
        shown.drag((130, 75), (265, 215))
        shown.until(lambda: shown.state.box is not None)
        assert shown.state.box == pytest.approx((130, 75, 135, 140), abs=2)
        assert shown.layout() == before, "dragging does not move the photo"
        shown.drag((265, 215), (275, 225))
        shown.until(lambda: shown.state.box != pytest.approx((130, 75, 135, 140), abs=2))
        assert shown.state.box == pytest.approx((130, 75, 145, 150), abs=2), "by its corner"

        page.get_by_role("button", name="in front").click()
        shown.drag((150, 120), (200, 120), (200, 180))
        shown.until(lambda: len(shown.state.strokes) == 1)
        mark = shown.state.strokes[0]
        object_class = viewer.walk.session.explainer.object_class
        marks = shown.state.hints(400, 300).check(400, 300, object_class).marks
        assert marks is not None and set(np.unique(marks)) == {0, PixelLabel.IN_FRONT}
        assert mark.radius == pytest.approx(8.0)
        assert (marks[120, 150:200] == PixelLabel.IN_FRONT).all(), "continuous"
        assert (marks[120:180, 200] == PixelLabel.IN_FRONT).all()
        pixel = page.evaluate(
            "([x, y]) => [...paint2d.getImageData(x * devicePixelRatio, y * devicePixelRatio, 1, 1).data]",
            [a - b for a, b in zip(shown.at(175, 120), stage_corner(page), strict=True)],
        )
        assert pixel[0] > 150 and pixel[1] < 60 and pixel[3] > 60, "drawn in red"

        assert page.locator("#views button").count() > 1
        verdict, shares = page.locator("#summary"), page.locator("#views small")
        right = shares.first.inner_text().removesuffix(" likely right")
        assert f"the view is right with a probability of {right}" in verdict.inner_text()
        assert all(re.fullmatch(r"\d+% likely right", each) for each in shares.all_inner_texts())
        page.locator("#views button").nth(1).click()
        shown.until(lambda: shown.state.azimuth_deg is not None)
        assert page.locator("#views button[aria-pressed=true]").count() == 1
        first, chosen, *others = shares.all_inner_texts()
        right = chosen.removesuffix(" likely right")
        assert f"the view is right with a probability of {right}" in verdict.inner_text()
        assert right and not any([first, *others]), "of the fit before"
        for scheme in ("light", "dark"):  # as the desktop is
            page.emulate_media(color_scheme=scheme)
            lightness = page.evaluate("getComputedStyle(document.body).backgroundColor.match(/[0-9]+/)[0]")
            assert (int(lightness) < 60) == (scheme == "dark") and page.evaluate(LOW_CONTRAST) == []
        page.get_by_role("button", name="save").click()
        page.get_by_text("Saved in").wait_for()
        assert len(State.read(run / name)[2].strokes) == 1
        page.get_by_role("button", name="next").last.click()
        shown.until(lambda: viewer.walk.place == 1)
        assert shown.state.box is None and page.locator("#items").input_value() == "1"
        assert "✓" in page.locator("#items option").first.inner_text()
        shown.close()
    finally:
        viewer.stop()


def stage_corner(page: Any) -> tuple[float, float]:
    box = page.locator("#stage").bounding_box()
    return box["x"], box["y"]


def test_the_keyboard_alone(browser: Any, viewer: Viewer) -> None:
    shown = Page(browser, viewer)
    page, keyboard = shown.page, shown.page.keyboard
    try:
        keyboard.press("?")
        page.get_by_text("another view").wait_for()
        keyboard.press("Escape")
        keyboard.press("1")
        page.locator("#paint").focus()
        keyboard.press("ArrowUp")
        keyboard.press("Space")
        keyboard.press("Space")
        shown.until(lambda: "spout" in shown.state.points)
        assert shown.state.points["spout"][0] == pytest.approx(200, abs=1)
        assert 140 < shown.state.points["spout"][1] < 150
        keyboard.press("b")
        keyboard.press("Space")
        for _ in range(4):
            keyboard.press("Shift+ArrowRight")
            keyboard.press("Shift+ArrowDown")
        keyboard.press("Space")
        shown.until(lambda: shown.state.box is not None)
        assert shown.state.box is not None and min(shown.state.box[2:]) > 30
        keyboard.press("g")
        for _ in range(3):
            keyboard.press("]")
        assert page.locator("#brush-size").text_content() == "32 px"  # of 400: .04 to either side
        keyboard.press("z")
        shown.until(lambda: shown.state.box is None)
        assert "spout" in shown.state.points
        keyboard.press("h")
        shown.until(lambda: shown.state.visible)
        keyboard.press("x")
        shown.until(lambda: shown.state == State())
        keyboard.press("z")
        shown.until(lambda: shown.state.visible)
        keyboard.press("Control+s")
        page.get_by_text("Saved in").wait_for()
        assert State.read(viewer.walk.items[0].folder)[2] == shown.state
        shown.close()
    finally:
        page.close()


def test_fingers_draw_and_two_of_them_zoom(browser: Any, viewer: Viewer) -> None:
    shown = Page(browser, viewer, "phone")
    page = shown.page
    try:
        touch = shown.context.new_cdp_session(page)

        def send(kind: str, *places: tuple[float, float]) -> None:
            points = [{"x": x, "y": y, "id": n} for n, (x, y) in enumerate(places)]
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        before = shown.layout()
        send("touchStart", shown.at(130, 75))
        for x, y in ((180, 120), (220, 170), (265, 215)):
            send("touchMove", shown.at(x, y))
        send("touchEnd")
        shown.until(lambda: shown.state.box is not None)
        assert shown.state.box == pytest.approx((130, 75, 135, 140), abs=3) and shown.layout() == before
        first, second = shown.at(180, 150), shown.at(220, 150)
        send("touchStart", first)
        send("touchStart", first, second)
        send("touchMove", (first[0] - 40, first[1]), (second[0] + 40, second[1]))
        send("touchEnd")
        page.wait_for_timeout(200)
        assert shown.layout()[2] > 1.5 * before[2]
        assert len(viewer.walk.session.states) == 2, "zooming draws nothing"
        shown.close()
    finally:
        page.close()


def test_what_cannot_be_done_is_said_and_loses_nothing(browser: Any, viewer: Viewer) -> None:
    shown = Page(browser, viewer)
    try:
        shown.drag((100, 100), (105, 104))
        shown.page.locator("#message.refused").get_by_text("at least 8 pixels a side").wait_for()
        shown.page.mouse.click(*shown.at(100, 100))
        shown.page.get_by_text("Drag from corner to corner").wait_for()
        assert shown.state == State() and shown.page.locator("#undo").is_disabled()
        shown.close()
    finally:
        shown.page.close()


def test_a_photos_name_is_shown_as_it_is(browser: Any, tmp_path: Path) -> None:
    walk = Walk.of_photo(large_photo(tmp_path / HOSTILE), "teapot", tmp_path / HOSTILE.replace(".png", ""))
    viewer = Viewer(walk, 8431)
    shown = Page(browser, viewer)
    try:
        assert shown.page.locator("#name").inner_text() == HOSTILE
        shown.page.keyboard.press("s")
        shown.page.get_by_text("Saved in").wait_for()
        assert "PWN" not in shown.page.title().replace(HOSTILE, "")
        assert shown.page.locator("iframe").count() == 0 and shown.page.locator("img[src=x]").count() == 0
        shown.close()
    finally:
        viewer.stop()


def test_other_objects_of_the_photo_can_be_chosen(browser: Any, tmp_path: Path) -> None:
    viewer = Viewer(Walk.of_photo(two_pots(tmp_path / "two.png"), "teapot", tmp_path / "saved"), 8431)
    shown = Page(browser, viewer)
    try:
        shown.page.keyboard.press("1")
        shown.page.keyboard.press("o")
        shown.page.get_by_text("Click into a frame").wait_for()
        places = shown.page.evaluate("state.objects.map(({ box }) => box)")
        assert len(places) >= 2
        for x, y, width, height in places[:2]:
            shown.page.mouse.click(*shown.at(x + width / 2, y + height / 2))
            shown.until(lambda box=(x, y, width, height): shown.state.box == pytest.approx(box, abs=1))  # type: ignore[misc]
        shown.close()
    finally:
        viewer.stop()


def test_a_run_is_walked_in_review_order_and_vig_fit_takes_corrections_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = fitted(tmp_path) / "run"
    walk = Walk.of_folder(run)
    rows = read_results(run)
    confidences = [item.found["confidence"] for item in walk.items if item.found["verdict"] == "trusted"]
    assert confidences == sorted(confidences) and len(walk.items) == 3
    walk.step(1)
    walk.session.correct(walk.session.set_box(130.0, 75.0, 140.0, 145.0))
    walk.session.correct(add_stroke(PixelLabel.IN_FRONT, 200.0, 150.0, 6.0, [(210.0, 160.0)]))
    corrected = walk.session.explanation.to_dict()
    folder = walk.save()
    walk.close()
    after = {row["folder"]: row for row in read_results(run)}
    row = after[folder.name]
    assert row["azimuth_deg"] == corrected["azimuth_deg"] and row["object"] == 1
    assert [row["photo"] for row in rows] == [row["photo"] for row in after.values()]
    assert json.loads((folder / "explanation.json").read_text()) == corrected
    again = Walk.of_folder(run)
    assert [item.corrected for item in again.items].count(True) == 1

    capsys.readouterr()

    def fitted_again() -> dict[str, Any]:
        fit(tmp_path / "photos", "--out", run, "--json")
        out, err = capsys.readouterr()
        assert (
            f"corrected in vig view, taken as it is there (or remove corrections.json): {folder.name}" in err
        )
        (result,) = (each for each in json.loads(out)["results"].values() if each["folder"] == str(folder))
        return result  # type: ignore[no-any-return]

    times = {path: path.stat().st_mtime_ns for path in run.glob("*/explanation.json")}
    for _ in range(2):
        result = fitted_again()
        result.pop("folder")
        assert result == corrected
        assert State.read(folder)[2].strokes == walk.session.state.strokes
    changed = [path.parent.name for path, time in times.items() if path.stat().st_mtime_ns != time]
    assert changed in ([], [folder.name]), "the others are not fitted again"
    assert read_results(run)[0]["width"] == 400


def test_a_photo_that_is_gone_is_left_out(run: Path) -> None:
    walk = Walk.of_folder(run)
    (run.parent / "photos" / f"{walk.items[0].folder.name}.png").unlink()
    viewer = Viewer(walk, 8431)
    assert walk.place == 1 and "got nothing of that name" in viewer.state()["message"]
    viewer.stop()
    shutil.rmtree(run.parent / "photos")
    with pytest.raises(UserError, match="^.*/photos/.*png: expected an image file; got nothing of that name"):
        Walk.of_folder(run).step(1)


def test_a_result_with_a_mask_is_opened_without_it_and_says_so(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "masks").mkdir()
    for number in range(2):
        large_photo(tmp_path / "photos" / f"{number}.png", number)
        mask = np.zeros((300, 400), np.uint8)
        mask[90:200, 140:260] = 255
        Image.fromarray(mask).save(tmp_path / "masks" / f"{number}.png")
    fit(tmp_path / "photos", "--mask", tmp_path / "masks", "--quiet", "--out", tmp_path / "run")
    walk = Walk.of_folder(tmp_path / "run")
    assert "fitted with a mask, marks or a pose, which are left out" in walk.step(1)
    assert walk.session.state == State() and not walk.session.unsaved
    walk.session.correct(set_state(elevation_deg=None, roll_deg=5.0))
    walk.save()
    walk.step(1)
    assert walk.step(-1) == "" and walk.session.state == State(roll_deg=5.0)


def test_exports_are_those_of_what_is_saved(run: Path) -> None:
    fit(run.parent / "photos", "--out", run, "--quiet", "--export", "coco", "ros")
    walk = Walk.of_folder(run)
    walk.step(1)
    exports = walk.items[0].folder / "pose.yaml", run / "coco.json"
    before = [path.read_text() for path in exports]
    walk.session.correct(lambda state: replace(state, azimuth_deg=100.0, elevation_deg=60.0))
    walk.save()
    assert all(path.read_text() != text for path, text in zip(exports, before, strict=True))
    viewer = Viewer(walk, 8431)
    assert viewer.photo(0) != viewer.photo(2), "by item, whichever is open"
    with pytest.raises(ValueError, match="expected an item below 3; got 3"):
        viewer.photo(3)
    viewer.stop()


def test_rows_that_others_wrote_meanwhile_stay(run: Path) -> None:
    walk = Walk.of_folder(run)
    walk.step(1)
    rows = read_results(run)
    write_table(run, [*rows, rows[0] | {"folder": "later", "photo": "later.png"}])
    walk.session.correct(set_state(elevation_deg=None, roll_deg=4.0))
    folder = walk.save()
    after = read_results(run)
    assert [row["folder"] for row in after] == [*(row["folder"] for row in rows), "later"]
    row = next(row for row in after if row["folder"] == folder.name)
    assert row["roll_deg"] == walk.session.explanation.roll_deg
    write_table(run, [row for row in after if row["folder"] != "later"])
    walk.close()
    assert "later" not in (run / "report.html").read_text()
    for damage in ({"folder": "../victim"}, {"folder": None}, {"photo": None}, {"verdict": "sure"}):
        write_table(run, [rows[0] | damage])
        with pytest.raises(UserError, match="expected the table of `vig fit` of several photos"):
            Walk.of_folder(run)


def test_one_of_several_objects_is_corrected_and_taken_up(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    two_pots(tmp_path / "photos" / "two.png")
    large_photo(tmp_path / "photos" / "one.png")
    boxes = {"two.png": [[75, 75, 135, 140], [340, 75, 135, 140]], "one.png": [130, 75, 135, 140]}
    (tmp_path / "boxes.json").write_text(json.dumps(boxes))
    command = tmp_path / "photos", "--boxes", tmp_path / "boxes.json", "--quiet", "--out", tmp_path / "run"

    fit(*command)
    walk = Walk.of_folder(tmp_path / "run")
    place = next(n for n, item in enumerate(walk.items) if item.folder.name == "2-teapot")
    walk.open(place)
    assert [walk.items[each["item"]].folder.name for each in walk.objects()] == ["1-teapot"]
    assert walk.session.others is not None and walk.session.others.any()
    walk.session.correct(set_point("spout", 350.0, 140.0))
    corrected = walk.session.explanation.to_dict()
    folder = walk.save()
    walk.close()
    fit(*command)
    assert json.loads((folder / "explanation.json").read_text())["hints"] == corrected["hints"]
    assert State.read(folder)[2].points == {"spout": (350.0, 140.0)}
    row = next(row for row in read_results(tmp_path / "run") if row["folder"] == "two/2-teapot")
    assert row["azimuth_deg"] == pytest.approx(corrected["azimuth_deg"], abs=1e-3)

    first, second = boxes["two.png"]
    (tmp_path / "boxes.json").write_text(json.dumps(boxes | {"two.png": [second, first]}))
    fit(*command)
    assert State.read(folder.with_name("1-teapot"))[2].points == {"spout": (350.0, 140.0)}
    assert State.read(folder)[2].points == {}, "the other object"
    kept = (folder.with_name("1-teapot") / "corrections.json").read_bytes()
    for other in ([first, [200, 75, 135, 140]], first):
        (tmp_path / "boxes.json").write_text(json.dumps(boxes | {"two.png": other}))
        fit(*command, code=1)
        error = next(row["error"] for row in read_results(tmp_path / "run") if row["folder"] == "two")
        assert "two/1-teapot/corrections.json' was made for; got others" in error
        assert (folder.with_name("1-teapot") / "corrections.json").read_bytes() == kept


def test_one_of_several_that_is_not_there_leaves_table_and_exports(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    for name in ("one", "two"):
        large_photo(tmp_path / "photos" / f"{name}.png")
    boxes = {"one.png": [130, 75, 135, 140], "two.png": [[130, 75, 135, 140], [10, 10, 90, 90]]}
    (tmp_path / "boxes.json").write_text(json.dumps(boxes))
    run = tmp_path / "run"
    command = tmp_path / "photos", "--boxes", tmp_path / "boxes.json", "--quiet", "--out", run
    fit(*command, "--export", "coco", "bop")
    walk = Walk.of_folder(run)
    walk.open(next(n for n, item in enumerate(walk.items) if item.folder.name == "2-teapot"))
    pose = run / "two" / "2-teapot" / "bop" / "scene_gt.json"
    for correction, there in ((dismiss, False), (None, True), (dismiss, False)):  # None takes it back
        walk.session.correct(correction)
        walk.save()
        assert pose.exists() == there
    walk.close()
    for again in (False, True):
        if again:
            fit(*command, "--export", "coco")
        assert [row["folder"] for row in read_results(run)] == ["one", "two/1-teapot"]
        assert len(json.loads((run / "coco.json").read_text())["annotations"]) == 2
        assert State.read(run / "two" / "2-teapot")[2].found == 0
    with Image.open(run / "two" / "mask.png") as mask:
        assert set(np.unique(np.asarray(mask))) == {0, 1}
    walk = Walk.of_folder(run / "two")  # where it can be taken back
    walk.open(next(n for n, item in enumerate(walk.items) if item.folder.name == "2-teapot"))
    assert walk.session.explanation.verdict is vig.Verdict.ABSENT


@pytest.mark.parametrize("change", [{"format": 2}, {"state": {"nose": 1}}, {"class": "mug"}], ids=str)
def test_corrections_by_hand_that_cannot_be_taken_stay(run: Path, change: dict[str, Any]) -> None:
    path = run / "1" / "corrections.json"
    written = json.dumps(json.loads(path.read_text()) | {"corrected": True} | change)
    path.write_text(written)
    fit(run.parent / "photos", "--out", run, "--quiet", code=1)
    errors = [row["error"] for row in read_results(run)]
    assert [error is None for error in errors] == [True, False, True]
    assert "corrected by hand and stays" in errors[1] and path.read_text() == written
    older = json.loads(written)
    older.pop("corrected")
    path.write_text(json.dumps(older))
    fit(run.parent / "photos", "--out", run, "--quiet")
