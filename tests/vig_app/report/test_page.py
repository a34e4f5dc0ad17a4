"""report.html: what it holds, and that a browser shows it."""

import base64
import io
import json
import math
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import vig
from tests.support import LOW_CONTRAST, run_vig
from vig.inference import OtherView
from vig.photo.images import as_srgb
from vig.renderer import render_latents
from vig.renderer.drawing import draw_latents
from vig.scene import Latents
from vig.scene.light import srgb_from_linear
from vig_app.examples import example_photos
from vig_app.pictures import part_albedo
from vig_app.report import words
from vig_app.report.folder_page import Entry, folder_html, reduce_picture
from vig_app.report.gallery import card_of, gallery_html

HOSTILE = '</script><script>window.hacked=1</script><img src=x onerror="window.hacked=1">.png'


@pytest.fixture(scope="module")
def explanation() -> vig.Explanation:
    """A fit with another view beside it."""
    explained = vig.Explainer("teapot").explain(example_photos()[1].photo)
    turned = replace(explained.latents, azimuth=explained.latents.azimuth + 1.0)
    alternative = OtherView(turned, explained.fit.framing, 0.25)
    return replace(explained, fit=replace(explained.fit, alternatives=(alternative,)))


def data_of(page: str) -> Any:
    """What the page's script reads."""
    match = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert match
    return json.loads(match.group(1))


def text_of(page: str, name: str) -> str:
    """The text of the element that has an id."""
    match = re.search(rf'<(\w+) id="{name}"[^>]*>(.*?)</\1>|<p class="quiet" id="{name}">(.*?)</p>', page)
    assert match
    return unescape(match[2] or match[3])


def rows_of(page: str) -> dict[str, str]:
    """The table of numbers."""
    return {
        name: unescape(words)
        for name, words in re.findall(r'<th scope="row">([^<]*)</th><td>([^<]*)</td>', page)
    }


def test_the_page_holds_what_the_json_says(explanation: vig.Explanation) -> None:
    page, described = explanation.report("egg cup.png"), explanation.to_dict()
    data, rows = data_of(page), rows_of(page)
    assert f"<title>{described['verdict']}: egg cup.png</title>" in page
    assert (text_of(page, "name"), text_of(page, "reason")) == ("egg cup.png", described["reason"])
    assert rows["azimuth of the eye"].startswith(f"{described['azimuth_deg']:.0f}°, 90 % interval ±")
    assert rows["hidden"] == f"{described['hidden_fraction']:.0%} of the object"
    assert page.count("<figcaption>") == len(data["views"]) == 2 and ", 25% likely right</figcaption>" in page
    faces = np.frombuffer(base64.b64decode(data["mesh"]["faces"]), "<u2").reshape(-1, 3)
    assert np.array_equal(faces, explanation.object_class.shape_model.faces)


@pytest.mark.parametrize(
    ("verdict", "mask", "badge"),
    [
        (vig.Verdict.TRUSTED, True, "trusted"),
        (vig.Verdict.TRUSTED, False, "view trusted, mask not"),
        (vig.Verdict.AMBIGUOUS, True, "view ambiguous, mask trusted"),
        (vig.Verdict.AMBIGUOUS, False, "ambiguous"),
    ],
)
def test_the_badge_says_of_what_the_verdict_is(
    explanation: vig.Explanation, verdict: vig.Verdict, mask: bool, badge: str
) -> None:
    fit = replace(explanation.fit, verdict=verdict, mask_trusted=mask)
    assert words.badge(replace(explanation, fit=fit).to_dict()) == badge


def test_nothing_of_a_name_is_markup(explanation: vig.Explanation) -> None:
    page = explanation.report(HOSTILE)
    assert text_of(page, "name") == HOSTILE
    assert page.count("<script") == 2 and "<img src=x" not in page


def test_an_azimuth_that_is_known_of_the_right_view_alone_is_said_so(explanation: vig.Explanation) -> None:
    layout = vig.scene.latent_layout(explanation.object_class.shape_model.modes)
    deviation = explanation.fit.deviation.copy()
    deviation[layout["azimuth"]] = math.pi
    wide = replace(explanation, fit=replace(explanation.fit, deviation=deviation))
    rows = dict(words.table_rows(wide.to_dict()))
    assert rows["azimuth of the eye"].endswith("°, if this is the right view")


@pytest.mark.parametrize("size", [(390, 844), (1100, 800), (1920, 1080)])
def test_a_browser_draws_it_without_errors_or_requests(
    browser: Any, explanation: vig.Explanation, tmp_path: Path, size: tuple[int, int]
) -> None:
    """Phone, laptop and wide: drawn, clicked, turned by hand and by keys; nothing asked for, nothing run."""
    (tmp_path / "report.html").write_text(explanation.report(HOSTILE), encoding="utf-8")
    shown = browser.new_page(viewport={"width": size[0], "height": size[1]})
    errors: list[str] = []
    asked: list[str] = []
    shown.on("console", lambda message: errors.append(message.text))
    shown.on("pageerror", lambda error: errors.append(str(error)))
    shown.on("request", lambda request: asked.append(request.url))
    address = (tmp_path / "report.html").as_uri()
    shown.goto(address)

    assert shown.locator("#name").inner_text() == HOSTILE and shown.evaluate("window.hacked") is None
    assert shown.evaluate("document.documentElement.scrollWidth <= innerWidth")
    for picture in shown.locator("img:visible").all():
        assert picture.evaluate("image => image.complete && image.naturalWidth > 0")
    assert shown.locator("#outline").is_hidden()
    shown.locator("#outlines").check()
    assert shown.locator("#outline").is_visible()
    shown.locator("#slider").focus()
    shown.keyboard.press("Home")
    assert (
        shown.evaluate("getComputedStyle(document.getElementById('whole')).clipPath")
        == "inset(0px 0px 0px 100%)"
    )

    canvas = shown.locator("#model")

    def colours() -> set[str]:
        values: set[str] = set(canvas.evaluate(
            """canvas => { const flat = document.createElement("canvas").getContext("2d");
            flat.canvas.width = flat.canvas.height = 64; flat.drawImage(canvas, 0, 0, 64, 64);
            const bytes = flat.getImageData(0, 0, 64, 64).data, found = [];
            for (let i = 0; i < bytes.length; i += 4) found.push(bytes.slice(i, i + 3).join());
            return found; }"""
        ))  # fmt: skip
        return values

    def picture() -> str:
        url: str = canvas.evaluate("canvas => canvas.toDataURL()")
        return url

    assert len(colours()) > 20, "the object is drawn, shaded"
    first = picture()
    canvas.focus()
    shown.keyboard.press("ArrowLeft")
    turned = picture()
    assert turned != first
    shown.get_by_role("button", name="as in the photo").click()
    assert picture() == first
    shown.get_by_role("button", name="drag turns the light").click()
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    shown.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    shown.mouse.down()
    shown.mouse.move(box["x"] + box["width"] / 2 + 90, box["y"] + box["height"] / 2, steps=4)
    shown.mouse.up()
    assert picture() not in (first, turned)
    shown.get_by_role("button", name="as in the photo").click()
    shown.get_by_role("button", name="show in 3-D").nth(1).click()
    assert picture() != first
    shown.clock.install()
    shown.get_by_role("button", name="replay").click()
    shown.get_by_text("step 0 of").wait_for()
    begun = picture()
    steps = data_of(explanation.report())["steps"]
    shown.clock.run_for(500 * len(steps))
    shown.get_by_text(steps[-1]["words"]).wait_for()
    assert picture() != begun, "the object in 3-D turns along"
    shown.locator("#steps").press("Home")
    shown.get_by_text("step 0 of").wait_for()
    for scheme in ("light", "dark"):
        shown.emulate_media(color_scheme=scheme)
        assert shown.evaluate(LOW_CONTRAST) == []
    assert not errors and [url for url in asked if not url.startswith("data:")] == [address]


def test_the_object_is_drawn_as_the_photo_shows_it(
    browser: Any, explanation: vig.Explanation, tmp_path: Path
) -> None:
    """Not mirrored, upright: the page's silhouette, mirrored or not, beside that of the renderer."""
    latents = explanation.fit.latents  # from the side, and nearly black before the page's grey
    latents = replace(latents, azimuth=np.array([0.2], np.float32), light=1e-3 * latents.light)
    explanation = replace(explanation, fit=replace(explanation.fit, latents=latents))
    (tmp_path / "report.html").write_text(explanation.report(), encoding="utf-8")
    shown = browser.new_page()
    shown.goto((tmp_path / "report.html").as_uri())
    drawn = shown.locator("#model").evaluate(
        """canvas => { const flat = document.createElement("canvas").getContext("2d");
        flat.canvas.width = flat.canvas.height = 90; flat.drawImage(canvas, 0, 0, 90, 90);
        const bytes = flat.getImageData(0, 0, 90, 90).data, found = [];
        for (let i = 0; i < bytes.length; i += 4)
          found.push(Math.hypot(bytes[i] - 138, bytes[i + 1] - 144, bytes[i + 2] - 153) > 8);
        return found; }"""
    )
    page = np.array(drawn).reshape(90, 90)
    spread = explanation.vertices.max(0) - explanation.vertices.min(0)
    middle = explanation.vertices.min(0) + spread / 2
    # The page's camera: six sizes away, looking at the middle of the object's box. Ours looks at its axis.
    focal, away = 6 * 0.8 * 90, 6 * float(spread.max())
    beside = focal * float(middle[0] * math.cos(0.2) + middle[1] * math.sin(0.2)) / away
    camera = vig.Camera(90, 90, focal, 45 - beside, 45, away, float(middle[2]))
    expected = explanation.render(camera=camera)[..., 3] > 0.5

    def iou(other: np.ndarray) -> float:
        return float((page & other).sum() / (page | other).sum())

    assert iou(expected) > 0.94, "as the renderer draws it"
    assert iou(expected) > 0.03 + max(iou(expected[:, ::-1]), iou(expected[::-1]))


PIXELS = """(canvas, size) => {
    const flat = Object.assign(document.createElement("canvas"), { width: size[0], height: size[1] });
    flat.getContext("2d").drawImage(canvas, 0, 0, ...size);
    return flat.toDataURL(); }"""


def pixels(shown: Any, name: str, width: int, height: int) -> np.ndarray:
    """A canvas or image of the page, (height, width, 4): 8-bit RGB, and opacity in [0, 1]."""
    address = shown.locator(name).evaluate(PIXELS, [width, height])  # a PNG: lists of numbers take minutes
    picture = Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))).convert("RGBA")
    return np.asarray(picture, np.float32) / [1, 1, 1, 255]


def opened(browser: Any, explanation: vig.Explanation, folder: Path) -> Any:
    """A browser's page of an explanation."""
    (folder / "report.html").write_text(explanation.report(), encoding="utf-8")
    shown = browser.new_page()
    shown.goto((folder / "report.html").as_uri())
    return shown


def test_views_and_steps_are_drawn_as_the_renderer_draws_them(
    browser: Any, explanation: vig.Explanation, tmp_path: Path
) -> None:
    """Turned, off the middle, of another shape, before the window's photo: in place, shaded and shadowed."""
    first = explanation.fit.descent[0]
    latents = replace(explanation.latents, shape=explanation.latents.shape + 0.5)
    framing = np.array([0.06, -0.04, -0.1, 0.4], np.float32)
    other = OtherView(latents, framing, 0.25)
    explanation = replace(explanation, fit=replace(explanation.fit, alternatives=(other,)))
    shown = opened(browser, explanation, tmp_path)
    shown.locator("#steps").press("Home")
    start = Latents.from_vector(first[None, :-4])
    for name, posed, placed in (
        ("#step", start, first[-4:]),
        ("#views figure:nth-child(2) canvas", latents, framing),
    ):
        camera = explanation.object_class.camera(150, explanation.camera_distance_ratio)
        camera = camera.apply_framing(*placed.tolist())
        drawn = render_latents(posed, explanation.object_class, camera, samples=2)
        share = drawn.coverage[0, :, :, None].numpy()
        photo = srgb_from_linear(explanation.window.crop(explanation.picture, 150)[0])
        colour = srgb_from_linear(drawn.rgb[0].numpy() / np.maximum(share, 1e-6))
        canvas = pixels(shown, name, 600, 600)[..., :3].reshape(150, 4, 150, 4, 3).mean((1, 3))
        off = np.abs(canvas - 255 * (photo + share * (colour - photo)))
        inside = share[..., 0] == 1
        without = render_latents(posed, explanation.object_class, camera, self_shadow=False, samples=2)
        shadows = np.abs(srgb_from_linear(without.rgb[0].numpy()) - colour)[inside].mean() * 255
        # Measured: .22 and .21 of 255 within the object, .73 and .84 of all; shadows are 2.4 and 2.7.
        assert off[inside].mean() < 0.5 < 3 * 0.5 < shadows and off.mean() < 1.5


def test_the_hidden_part_and_the_outline_lie_where_the_overlay_has_them(
    browser: Any, explanation: vig.Explanation, tmp_path: Path
) -> None:
    shown = opened(browser, explanation, tmp_path)
    shown.locator("#outlines").check()
    height, width = explanation.picture.shape[:2]
    hidden = explanation.amodal & ~explanation.mask
    assert hidden.sum() > 100
    drawn = pixels(shown, "#whole", width, height)
    # Measured: .0027, all at edges.
    assert np.mean((drawn[..., 3] > 0.5) != hidden) < 0.005 < 0.02 < hidden.mean()
    model, albedo = explanation.object_class.shape_model, explanation.latents.albedo[0]
    rendered = draw_latents(explanation.latents, explanation.object_class, explanation.camera)
    part = model.parts[model.faces[rendered.triangle_id, 0]]
    colours = srgb_from_linear(rendered.rgb / albedo * part_albedo(explanation)[part])
    surely = hidden & (drawn[..., 3] > 0.99) & (rendered.coverage > 0.99)
    off = np.abs(drawn[..., :3] - 255 * colours)[surely]
    assert surely.sum() > 500 and off.mean() < 1  # measured: .32 of 255
    lines, photo = pixels(shown, "#outline", width, height), as_srgb(explanation.picture).astype(float)
    composed = photo + lines[..., 3:] * (lines[..., :3] - photo)
    # Measured: .09; without the outline 5.1.
    assert np.abs(composed - explanation.overlay()).mean() < 0.5


def test_a_browser_without_webgl_shows_the_outline(
    browser: Any, explanation: vig.Explanation, tmp_path: Path
) -> None:
    (tmp_path / "report.html").write_text(explanation.report(), encoding="utf-8")
    shown = browser.new_page()
    errors: list[str] = []
    shown.on("pageerror", lambda error: errors.append(str(error)))
    shown.add_init_script(
        """const get = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
            return kind.startsWith("webgl") ? null : get.call(this, kind, ...rest); };"""
    )
    shown.goto((tmp_path / "report.html").as_uri())
    assert shown.get_by_text("This browser has no WebGL").is_visible()
    assert shown.locator("#outline").is_visible() and shown.locator("#model").is_hidden()
    height, width = explanation.picture.shape[:2]
    assert pixels(shown, "#outline", width, height)[..., 3].any() and not errors


def test_a_folders_page_lists_what_to_review_first(
    browser: Any, explanation: vig.Explanation, tmp_path: Path
) -> None:
    described, picture = explanation.to_dict(), reduce_picture(explanation.overlay())
    doubtful = described | {"verdict": "ambiguous", "confidence": 0.4, "azimuth_deg": 350.0}
    doubtful |= {"hidden_fraction": None, "mask_confidence": None}
    entries = [Entry("sure.png", "sure", described, picture), Entry(HOSTILE, "a b", doubtful, picture)]
    (tmp_path / "report.html").write_text(folder_html(entries, 3, [HOSTILE]), encoding="utf-8")
    shown = browser.new_page()
    errors: list[str] = []
    shown.on("console", lambda message: errors.append(message.text))
    shown.on("pageerror", lambda error: errors.append(str(error)))
    shown.goto((tmp_path / "report.html").as_uri())
    assert shown.locator("strong").all_inner_texts() == [HOSTILE, "sure.png"]
    assert shown.locator("a").first.get_attribute("href") == "a%20b/report.html"
    shown.get_by_text("as a table").click()
    shown.get_by_role("button", name="azimuth").click()
    assert shown.locator("#table td:first-child").all_inner_texts() == ["sure.png", HOSTILE]
    cells = shown.locator("#table tr:last-child td").all_inner_texts()
    assert cells[1:3] == ["ambiguous", "350°"] and cells[4:] == ["", "40%", ""]
    shown.get_by_role("button", name="azimuth").click()
    assert shown.locator("#table td:first-child").all_inner_texts() == [HOSTILE, "sure.png"]
    shown.get_by_text("1 could not be explained").click()
    assert shown.locator("#errors li").all_inner_texts() == [HOSTILE]
    assert shown.get_by_text("Here are the 2 to review first").is_visible()
    shown.locator("#order").select_option("azimuth")
    assert shown.locator("strong").all_inner_texts() == ["sure.png", HOSTILE]
    assert shown.evaluate("window.hacked") is None and not errors
    for scheme in ("light", "dark"):
        shown.emulate_media(color_scheme=scheme)
        assert shown.evaluate(LOW_CONTRAST) == []


def test_a_gallery_slides_turns_and_says_what_is_not_there(
    browser: Any, explanation: vig.Explanation, tmp_path: Path
) -> None:
    """Made of the pages of results: a slider by keys, an object that turns by itself and by hand, offline."""
    for name in ("a", "b"):
        explanation.save(tmp_path / name, files=["report.html"])
    described = json.loads((tmp_path / "b/explanation.json").read_text()) | {"verdict": "absent"}
    (tmp_path / "b/explanation.json").write_text(json.dumps(described))
    cards = [card_of(tmp_path / "a", "best", HOSTILE, "a/report.html"), card_of(tmp_path / "b", HOSTILE)]
    (tmp_path / "gallery.html").write_text(gallery_html(cards, "A show"), encoding="utf-8")
    shown = browser.new_page(viewport={"width": 400, "height": 800})
    errors: list[str] = []
    asked: list[str] = []
    shown.on("pageerror", lambda error: errors.append(str(error)))
    shown.on("request", lambda request: asked.append(request.url))
    shown.goto((tmp_path / "gallery.html").as_uri())
    assert shown.locator("strong").all_inner_texts() == ["best", HOSTILE]
    assert shown.locator("small").all_inner_texts() == [HOSTILE]
    assert shown.locator("strong a").get_attribute("href") == "a/report.html"
    names = [f"or azimuth {explanation.to_dict()['alternatives'][0]['azimuth_deg']:.0f}°", "view right"]
    assert {*shown.locator("li").first.locator("dt").all_inner_texts()} >= {*names}
    assert shown.locator("li").nth(1).locator("canvas, input").count() == 0

    def picture() -> str:
        url: str = shown.locator(".model").evaluate("canvas => canvas.toDataURL()")
        return url

    shown.wait_for_function("cards[0].opened")
    first = picture()
    shown.wait_for_function("first => document.querySelector('.model').toDataURL() !== first", arg=first)
    shown.locator("#turn").uncheck()
    shown.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    still = picture()
    shown.wait_for_timeout(200)
    assert picture() == still
    shown.locator(".model").press("ArrowLeft")
    assert picture() != still
    shown.locator(".slide input").press("Home")
    assert shown.locator(".after").evaluate("canvas => getComputedStyle(canvas).clipPath").endswith("0%)")
    height, width = explanation.picture.shape[:2]
    after = pixels(shown, ".after", width, height)[..., :3]
    photo = pixels(shown, ".explained .slide img", width, height)[..., :3]
    colourful, was_colourful = np.ptp(after, axis=-1) > 12, np.ptp(photo, axis=-1) > 12
    seen, rest = explanation.mask & was_colourful, ~explanation.mask
    # Measured: 1.00 of the object; .09 of the rest (outline, hidden pixels), .46 in the photo.
    assert seen.sum() > 1000 and colourful[seen].mean() > 0.95
    assert colourful[rest].mean() < 0.2 < 0.4 < was_colourful[rest].mean()
    assert shown.evaluate("document.documentElement.scrollWidth") == 400
    assert shown.evaluate("window.hacked") is None and not errors
    assert [url for url in asked if not url.startswith("data:")] == [(tmp_path / "gallery.html").as_uri()]
    for scheme in ("light", "dark"):
        shown.emulate_media(color_scheme=scheme)
        assert shown.evaluate(LOW_CONTRAST) == []


def test_a_run_has_a_gallery(
    explanation: vig.Explanation, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of each photo and of each object of several, by name; a folder of none is refused in one line."""
    for name in ("two", "one", "several/1-teapot"):
        explanation.save(tmp_path / "run" / name, files=["report.html"])
    out = tmp_path / "gallery"
    assert run_vig("gallery", tmp_path / "run", "--out", out, "--json") == 0
    page = (out / "index.html").read_text()
    assert json.loads(capsys.readouterr().out) == {
        "page": str(out / "index.html"), "photos": 3, "folder": str(out),
    }  # fmt: skip
    names = ["one", "two", "several/1-teapot"]
    links = [(f"../run/{name}/report.html", name) for name in names]
    assert re.findall('<strong><a href="([^"]+)">([^<]*)</a></strong>', page) == links
    assert len(data_of(page)) == 3 and all((out / link).is_file() for link, _ in links)
    for bad in (out, tmp_path / "nothing"):
        assert run_vig("gallery", bad) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and str(bad) in error
    path = tmp_path / "run/two/explanation.json"
    whole = json.loads(path.read_text())
    path.write_text(json.dumps(whole | {"hidden_fraction": "0.2"}))
    assert run_vig("gallery", tmp_path / "run") == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and f"{path}'; got something else" in error
    assert "got `str` - at `$.hidden_fraction`" in error
    path.write_text(json.dumps(whole))
    (tmp_path / "run/one/report.html").write_text("<p>mine")
    assert run_vig("gallery", tmp_path / "run") == 2 and "no photo or no mesh" in capsys.readouterr().err


def test_several_photos_have_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photos = [str(example.photo) for example in example_photos()[:2]]
    run_vig("fit", *photos, "--out", tmp_path)
    links = re.findall('<li><a href="([^"]+)">', (tmp_path / "report.html").read_text())
    assert set(links) == {f"{example.photo.stem}/report.html" for example in example_photos()[:2]}
    assert all((tmp_path / link).is_file() for link in links)
