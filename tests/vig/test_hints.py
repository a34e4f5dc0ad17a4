"""What a user says of the object, and that it makes wrong fits right."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

import vig
from tests.support import run_vig
from vig.hints import Hints, check_pose, view_of
from vig.inference import Objective, PixelLabel, ReprojectionTerm, objective_of, resolve
from vig.io.errors import UserError
from vig.photo import Window
from vig.photo.lens import Intrinsics
from vig.photo.masks import read_mask
from vig.recognition import Prediction
from vig.scene import ObjectClass
from vig_app.cli.hints import mask_of, parse_point, read_marks, read_pose
from vig_app.examples import Example, example_photos

pytestmark = pytest.mark.usefixtures("remembered_networks")

HIDDEN = 3


@pytest.fixture(scope="module")
def example() -> Example:
    return example_photos()[HIDDEN]


@pytest.fixture(scope="module")
def plain(explainer: vig.Explainer, example: Example) -> vig.Explanation:
    """The example explained without hints."""
    return explainer.explain(example.photo)


def turned(a: float, b: float) -> float:
    return abs((a - b + 180) % 360 - 180)


def point_of(explanation: vig.Explanation, name: str) -> tuple[float, float]:
    """Where an explanation has a named point in the photo."""
    place = explanation.vertices[explanation.object_class.points[name]]
    x, y, z = explanation.camera.K @ (explanation.camera_from_object @ [*place, 1.0])[:3]
    return float(x / z), float(y / z)


def blind(explainer: vig.Explainer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the network see nothing of the view: every azimuth is as likely."""
    whole = type(explainer.recognizer).__call__

    def predict(self: object, photos: np.ndarray, **settings: bool) -> Prediction:
        found: Prediction = whole(self, photos, **settings)  # type: ignore[arg-type]
        return replace(found, azimuth=np.full_like(found.azimuth, 1 / found.azimuth.shape[1]))

    monkeypatch.setattr(type(explainer.recognizer), "__call__", predict)


def test_two_points_tell_the_view_where_the_network_does_not(
    explainer: vig.Explainer, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = 0
    truths = [explainer.explain(each.photo) for each in example_photos()[:3]]
    blind(explainer, monkeypatch)
    for truth in truths:
        points = {name: point_of(truth, name) for name in ("spout", "handle")}
        found = explainer.explain(truth.picture, window=truth.window, hints=Hints(points=points))
        right += turned(found.azimuth_deg, truth.azimuth_deg) < 15
        for name, place in points.items():
            assert math.dist(point_of(found, name), place) < 0.1 * truth.window.side
    assert right >= 2


def test_the_view_that_a_user_chooses_is_taken(
    explainer: vig.Explainer, plain: vig.Explanation, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = plain
    blind(explainer, monkeypatch)
    for asked in (truth.azimuth_deg + 6, truth.azimuth_deg + 120):
        found = explainer.explain(truth.picture, window=truth.window, hints=Hints(azimuth_deg=asked))
        assert turned(found.azimuth_deg, asked) < 25
    pose = truth.camera_from_object
    found = explainer.explain(truth.picture, window=truth.window, hints=Hints(pose=pose))
    assert turned(found.azimuth_deg, truth.azimuth_deg) < 7


def test_a_given_mask_is_the_answers_mask(
    explainer: vig.Explainer, example: Example, plain: vig.Explanation
) -> None:
    """Whatever is given, here the true mask without its left half: that half is then hidden."""
    mask = plain.mask.copy()
    middle = int(np.flatnonzero(plain.amodal.any(0)).mean())
    mask[:, :middle] = False
    found = explainer.explain(example.photo, hints=Hints(mask=mask))
    assert (found.mask & mask).sum() > 0.95 * mask.sum()
    assert found.mask[:, : middle - 2].sum() < 0.03 * found.amodal[:, : middle - 2].sum()
    assert found.to_dict()["hints"] == {"mask": int(mask.sum())}


def test_marks_say_it_of_single_places(
    explainer: vig.Explainer, example: Example, plain: vig.Explanation
) -> None:
    rows, columns = np.nonzero(plain.mask)
    at = (
        slice(int(np.median(rows)) - 6, int(np.median(rows)) + 6),
        slice(int(np.median(columns)) - 6, int(np.median(columns)) + 6),
    )
    marks = np.zeros(plain.mask.shape, np.uint8)
    marks[at] = PixelLabel.IN_FRONT
    found = explainer.explain(example.photo, hints=Hints(marks=marks))
    assert plain.mask[at].mean() > 0.9 and found.mask[at].mean() < 0.3 and found.amodal[at].all()


def test_nothing_hidden_is_nothing_hidden(
    explainer: vig.Explainer, example: Example, plain: vig.Explanation
) -> None:
    assert (plain.hidden_fraction or 0) > 0.1
    found = explainer.explain(example.photo, hints=Hints(visible=True))
    assert found.hidden_fraction is not None and found.hidden_fraction < 0.1


def test_held_angles_come_out_as_given(explainer: vig.Explainer, example: Example) -> None:
    hints = Hints(elevation_deg=21.0, roll_deg=4.0)
    found = explainer.explain(example.photo, hints=hints)
    assert found.elevation_deg == pytest.approx(21.0, abs=1e-3)
    assert found.roll_deg == pytest.approx(4.0, abs=1e-3)
    assert found.to_dict()["hints"] == {"elevation_deg": 21.0, "roll_deg": 4.0}


@pytest.mark.parametrize("count", [0, 2])
def test_hints_are_as_many_as_photos(explainer: vig.Explainer, count: int) -> None:
    """None is left out in silence."""
    photos = [np.full((40, 30, 3), 128, np.uint8)]
    with pytest.raises(UserError, match="expected a hint .or None. for each photo; got"):
        list(explainer.explain_many(photos, hints=[None] * count))


def test_a_hint_that_is_none_of_a_kind_skips_its_photo(explainer: vig.Explainer) -> None:
    photos, skipped = [each.photo for each in example_photos()[:2]], []
    hints = [{"visible": True}, None]
    found = list(explainer.explain_many(photos, hints=hints, skip=lambda n, e: skipped.append((n, str(e)))))  # type: ignore[arg-type]
    assert len(found) == 1 and skipped[0][0] == 0 and "expected vig.Hints; got a dict" in skipped[0][1]


def test_each_of_many_photos_has_the_mask_of_its_name(tmp_path: Path) -> None:
    """Which is not read here, so that a bad one is the photo's own error."""
    photos = [tmp_path / f"{name}.jpg" for name in "ab"]
    mask = mask_of(tmp_path, photos)
    assert [mask(photo) for photo in photos] == [tmp_path / "a.png", tmp_path / "b.png"]
    assert mask_of(None, photos)(photos[0]) is None
    with pytest.raises(UserError, match="expected --mask FOLDER for 2 photos"):
        mask_of(photos[0], photos)


@pytest.mark.parametrize("azimuth", [-3.0, -1.0, 0.0, 0.7, 3.1])
@pytest.mark.parametrize(("elevation", "roll"), [(0.3, 0.0), (-0.2, 0.4), (1.3, -2.0)])
def test_a_pose_tells_its_view(azimuth: float, elevation: float, roll: float) -> None:
    camera = vig.Camera(100, 100, 100.0, 50.0, 50.0, 0.5, 0.1, roll)
    found = view_of(camera.camera_from_world(azimuth, elevation))
    assert found == pytest.approx((azimuth, elevation, roll), abs=1e-6)


def points_objective(
    explainer: vig.Explainer, truth: vig.Explanation
) -> tuple[Objective, list[ReprojectionTerm], np.ndarray]:
    """An objective, a term of all named points, and a point some way from where they are."""
    unit = explainer.object_class.at_unit_scale
    cut = truth.window.crop(truth.picture)[0]
    settings = resolve(explainer.settings, explainer.object_class, photo=True)
    objective = objective_of(cut, explainer.recognizer(cut[None]), explainer.object_class, settings)
    hints = Hints(points={name: point_of(truth, name) for name in unit.points})
    camera = unit.camera(150, truth.camera_distance_ratio)
    matrix, fit = truth.camera.K, truth.camera_from_object
    seen = truth.vertices @ fit[:3, :3].T + fit[:3, 3]
    places = (seen @ matrix.T)[:, :2] / seen[:, 2:]
    box = (*places.min(0), *np.ptp(places, axis=0))
    told = hints.in_window(truth.window, explainer.object_class, box)
    terms = told.terms(unit, camera, objective.layout)
    return objective, terms, objective.point(truth.latents, truth.fit.framing[None])


def test_points_and_box_of_a_fit_are_where_it_puts_them(
    explainer: vig.Explainer, plain: vig.Explanation
) -> None:
    """The terms' projection is that of the answer: at the fit itself they cost nothing."""
    _, (points, box), at = points_objective(explainer, plain)
    assert float(points.value(at)[0]) > -1e-3
    assert float(box.value(at)[0]) > -3, "but for vertices that are on the hull of this shape alone"


@pytest.mark.parametrize("number", [0, 1])
def test_the_terms_derivatives_are_those_of_its_value(
    explainer: vig.Explainer, plain: vig.Explanation, number: int
) -> None:
    objective, terms, at = points_objective(explainer, plain)
    term = terms[number]
    rng = np.random.default_rng(0)
    points = at + 0.05 * rng.normal(size=(2, at.shape[1]))
    value, gradient = np.zeros(2), np.zeros(points.shape)
    normal = np.zeros((2, points.shape[1], points.shape[1]))
    term.add_to(points, value, gradient, normal)
    np.testing.assert_allclose(value, term.value(points))
    columns, ends = [], []
    for step in 1e-6 * np.eye(points.shape[1]):
        ends.append((term.value(points + step) - term.value(points - step)) / 2e-6)
        columns.append((term.residuals(points + step) - term.residuals(points - step)) / 2e-6)
    np.testing.assert_allclose(gradient, np.stack(ends, 1), rtol=1e-4, atol=1e-3 * np.abs(gradient).max())
    slopes = np.stack(columns, 2)
    expected = slopes.swapaxes(1, 2) @ slopes
    np.testing.assert_allclose(normal, expected, rtol=1e-4, atol=1e-4 * np.abs(normal).max())
    assert (gradient[:, objective.layout["framing"]] != 0).all()


@pytest.mark.parametrize(
    ("hints", "told"),
    [
        (Hints(mask=np.ones((3, 3), bool)), "expected mask of 150 x 150 pixels"),
        (Hints(mask=np.zeros((150, 150), bool)), "got an empty one"),
        (Hints(marks=np.full((150, 150), 9, np.uint8)), "expected marks of 0 to 3; got 9"),
        (Hints(points={"nose": (1, 2)}), "names (spout, handle, knob); got 'nose'"),
        (Hints(points={"spout": (1, math.nan)}), "the point 'spout' as 2 finite"),
        (Hints(elevation_deg=99.0), "elevation_deg within 90 degrees"),
        (Hints(azimuth_deg="left"), "azimuth_deg as 1 finite"),  # type: ignore[arg-type]
        (Hints(roll_deg=3.0), "a window or a roll among the hints"),
        ({"visible": True}, "expected vig.Hints; got a dict"),
        (Hints(pose=np.ones((4, 4))), "a rigid (4, 4) camera_from_object"),
    ],
)
def test_what_cannot_be_is_refused(explainer: vig.Explainer, example: Example, hints: Any, told: str) -> None:
    window = Window(0, 0, 150) if "a window or" in told else None
    with pytest.raises(UserError) as raised:
        explainer.explain(example.photo, window=window, hints=hints)
    assert told in str(raised.value) and "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("mask", "hints", "told"),
    [
        ([[1], [1, 2]], None, "expected mask of 150 x 150 pixels"),
        (np.full((150, 150), np.nan), None, "got float64"),
        ("no-mask.png", None, "no-mask.png"),
        (np.ones((150, 150), bool), {"visible": True}, "expected vig.Hints; got a dict"),
        (np.ones((150, 150), bool), Hints(mask=np.ones((150, 150), bool)), "got both"),
    ],
)
def test_a_mask_of_no_use_is_refused(
    explainer: vig.Explainer, example: Example, mask: Any, hints: Any, told: str
) -> None:
    for explain in (explainer.explain, vig.Tracker(explainer).start):
        with pytest.raises(UserError) as raised:
            explain(example.photo, mask=mask, hints=hints)
        assert told in str(raised.value) and "\n" not in str(raised.value)


def test_a_box_through_a_lens_has_the_middles_of_its_sides() -> None:
    """Those of the box round an ellipse that fills the box, mapped by the same lens, to a few hundredths."""
    lens = Intrinsics(150.0, 150.0, 100.0, 100.0)
    box = (0.0, 0.0, 100.0, 30.0)
    window = replace(Window.round_box(box), lens=lens)
    hints = Hints().in_window(window, ObjectClass.load("teapot"), box)
    assert hints.box is not None
    angle = np.linspace(0, 2 * np.pi, 200)
    x, y = window.to_window(50 + 50 * np.cos(angle), 15 + 15 * np.sin(angle))
    left, top = x.min() / window.side + 0.5, y.min() / window.side + 0.5
    expected = left, top, np.ptp(x) / window.side, np.ptp(y) / window.side
    np.testing.assert_allclose(hints.box, expected, atol=0.04)


@pytest.mark.parametrize("roll", [0.0, 0.5])
def test_nothing_is_beyond_a_box_whatever_a_mask_says(roll: float) -> None:
    photo_mask = np.zeros((200, 200), bool)
    photo_mask[80:120, 80:120] = True
    box = (60.0, 70.0, 80.0, 60.0)
    window = Window.round_box(box, roll)
    hints = Hints(mask=photo_mask).in_window(window, ObjectClass.load("teapot"), box)
    counts = np.bincount(hints.labels.ravel(), minlength=4)
    assert counts[PixelLabel.BACKGROUND] > 0.4 * hints.labels.size and counts[PixelLabel.IN_FRONT] > 1000
    assert (hints.box is None) == bool(roll)


def test_marks_and_masks_are_read_from_pictures(tmp_path: Path) -> None:
    picture = np.zeros((20, 30, 3), np.uint8)
    picture[2:4, :, 1], picture[5:7, :, 0], picture[8:10, :, 2], picture[12:] = 255, 255, 255, 200
    Image.fromarray(picture).save(tmp_path / "marks.png")
    marks = read_marks(tmp_path / "marks.png")
    assert [marks[row, 0] for row in (0, 3, 6, 9, 15)] == [
        0,
        PixelLabel.SEEN,
        PixelLabel.IN_FRONT,
        PixelLabel.BACKGROUND,
        0,
    ]
    with pytest.raises(UserError, match="expected a mask of one object; got 4 colours"):
        read_mask(tmp_path / "marks.png")
    Image.new("RGB", (20, 20), (90, 90, 90)).save(tmp_path / "grey.png")
    with pytest.raises(UserError, match="pure red, green or blue marks"):
        read_marks(tmp_path / "grey.png")


def test_a_pose_is_read_from_what_vig_and_others_write(tmp_path: Path) -> None:
    pose = np.eye(4)
    for content in (pose.tolist(), {"camera_from_object": pose.tolist()},
                    {"camera": {"camera_from_object": pose.tolist()}}):  # fmt: skip
        (tmp_path / "pose.json").write_text(json.dumps(content))
        np.testing.assert_array_equal(read_pose(tmp_path / "pose.json"), pose)
    for wrong in ([1, 2], {"camera": 3}, {}):
        (tmp_path / "pose.json").write_text(json.dumps(wrong))
        with pytest.raises(UserError, match="4 x 4 camera_from_object"):
            read_pose(tmp_path / "pose.json")


@pytest.mark.parametrize("text", ["spout", "spout=1", "=1,2", "spout=1,b", "spout=1,2,3"])
def test_a_point_without_a_place_is_refused(text: str) -> None:
    assert parse_point("spout=1.5,2") == ("spout", (1.5, 2.0))
    with pytest.raises(UserError, match="expected --points NAME=x,y"):
        parse_point(text)


def test_the_command_line_takes_hints(
    example: Example, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Image.new("L", (150, 150), 255).save(tmp_path / "mask.png")
    photo = str(example.photo)
    arguments = ["--out", str(tmp_path / "out"), "--elevation", "25", "--visible"]
    assert run_vig("fit", photo, *arguments, "--points", "spout=40,60") == 0
    said = json.loads((tmp_path / "out" / example.photo.stem / "explanation.json").read_text())
    assert said["hints"] == {"visible": True, "points": {"spout": [40.0, 60.0]}, "elevation_deg": 25.0}
    for more, told in (
        (["--points", "nose=1,2"], "got 'nose'"),
        ([photo, "--azimuth", "3"], "expected one photo with --azimuth; got 2"),
        ([photo, "--mask", str(tmp_path / "mask.png")], "expected --mask FOLDER for 2 photos"),
    ):
        capsys.readouterr()
        assert run_vig("fit", photo, *more, *arguments) == 2 and told in capsys.readouterr().err


POSE = np.array([[0.0, 1, 0, 0.02], [0.6, 0, -0.8, 0.01], [-0.8, 0, -0.6, 0.7], [0, 0, 0, 1]])


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        (np.diag([1.0, -1, -1, 1]) @ POSE, r"behind the camera, z = -0.7; of OpenGL or Blender\?"),
        (POSE.T, "transposed"),
        (POSE * [[2, 2, 2, 1]] * 3 + np.diag([0, 0, 0, -2.0]), "scaled by 6"),
        (POSE @ np.diag([1.0, -1, 1, 1]), "left-handed"),
        (
            POSE * [[1, 1, 1, 1000]] * 1.0 - np.diag([0, 0, 0, 999.0]),
            r"700.* metres away; is that in millimetres\?",
        ),
        (np.eye(4) + 1, "a last row"),
        (np.full((4, 4), np.nan), "not finite"),
        (np.eye(3), r"shape \(3, 3\)"),
        ("here", "an array of shape"),
        (np.diag([1.0, 2, 3, 1]) + np.eye(4, k=3), "no rotation"),
        (POSE + np.eye(4, k=3) * 4, "far outside"),
    ],
)
def test_a_pose_of_another_convention_is_named(pose: object, words: str) -> None:
    with pytest.raises(UserError, match=words) as caught:
        check_pose(pose, 0.4)
    assert "\n" not in str(caught.value)


def test_a_pose_may_lack_its_last_row() -> None:
    np.testing.assert_array_equal(check_pose(POSE[:3].tolist(), 0.4), POSE)


@pytest.mark.parametrize(
    "mask",
    [
        np.eye(30, 40, dtype=np.uint8),
        255 * np.eye(30, 40, dtype=np.uint8),
        np.eye(30, 40, dtype=np.float32),
        np.eye(30, 40, dtype=int)[..., None],
        torch.eye(30, 40)[None],
        255 * np.eye(30, 40) + 3 * np.eye(30, 40, k=1),
    ],
)
def test_a_mask_is_taken_in_any_usual_type(mask: Any) -> None:
    hints = Hints(mask=mask).check(40, 30, ObjectClass.load("teapot"))
    np.testing.assert_array_equal(hints.mask, np.eye(30, 40, dtype=bool))


@pytest.mark.parametrize("kind", [np.float32, np.int64, np.array, torch.tensor])
def test_numbers_may_be_numpys_or_tensors(kind: Any) -> None:
    teapot = ObjectClass.load("teapot")
    given = Hints(azimuth_deg=kind(30), elevation_deg=kind(20), points={"spout": (kind(12), kind(9))})
    hints = given.check(40, 30, teapot)
    assert (hints.azimuth_deg, hints.elevation_deg, hints.points) == (30.0, 20.0, {"spout": (12.0, 9.0)})
    with pytest.raises(UserError, match="azimuth_deg"):
        Hints(azimuth_deg=True).check(40, 30, teapot)


def test_a_mask_or_points_without_a_box_place_the_window(explainer: vig.Explainer) -> None:
    """The photo in the corner of a larger, noisy one that holds it twice: what is marked is explained."""
    example = example_photos()[0]
    picture = np.asarray(Image.open(example.photo).convert("RGB"))
    wide = np.random.default_rng(0).integers(90, 120, (330, 480, 3), np.uint8)
    wide[20:170, 30:180] = wide[170:320, 310:460] = picture
    true = explainer.explain(picture)
    mask = np.zeros(wide.shape[:2], bool)
    mask[170:320, 310:460] = true.mask
    x, y, w, h = true.box
    ends = {"spout": (310.0 + x, 170.0 + y + h / 3), "handle": (310.0 + x + w, 170.0 + y + h / 3)}
    for hints in (Hints(mask=mask), Hints(points=ends)):
        found = explainer.explain(wide, hints=hints)
        assert abs(found.box[0] - 310 - x) < 12 and abs(found.box[1] - 170 - y) < 12
        assert abs(found.box[2] - w) < 20
