"""The library as its users meet it: `import vig`, a photo of any size in, a folder out."""

import io
import json
import math
import subprocess
import sys
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage
from scipy.ndimage import binary_dilation

import vig
from tests.support import run_vig
from vig.inference.confidence import low_confidence_reason
from vig.inference.settings import OtherView
from vig.photo import Window
from vig.recognition.find import Candidate
from vig.scene import srgb8_from_linear

PUBLIC = {
    "Hints",
    "Camera",
    "Explainer",
    "Explanation",
    "Latents",
    "ObjectClass",
    "SceneExplanation",
    "Track",
    "TrackedFrame",
    "TrackedPose",
    "Tracker",
    "UserError",
    "Verdict",
    "__version__",
    "explain_found",
    "explain_together",
    "render",
    "track",
}
BOX = (27.0, 37.0, 124.0, 79.0)
"""Round the teapot of `photo`, by its packaged amodal mask."""


@pytest.fixture(scope="module")
def photo() -> np.ndarray:
    """A packaged example in a frame of an odd size: (140, 200, 3) uint8."""
    example = np.asarray(Image.open(str(files("vig_app") / "examples" / "01_open.png")).convert("RGB"))
    return np.pad(example[5:145], ((0, 0), (20, 30), (0, 0)), mode="edge")


@pytest.fixture(scope="module")
def explanation(explainer: vig.Explainer, photo: np.ndarray) -> vig.Explanation:
    return explainer.explain(photo, BOX)


@pytest.mark.parametrize("orientation", [1, 6])
def test_a_large_photo_is_explained_as_the_small_one(
    explainer: vig.Explainer,
    photo: np.ndarray,
    explanation: vig.Explanation,
    tmp_path: Path,
    orientation: int,
) -> None:
    """Its windows are cut from halves; boxes and masks are still in its own pixels, as EXIF turns them."""
    large = Image.fromarray(photo).resize((2000, 1400), Image.Resampling.BICUBIC)
    stored = large.transpose(Image.Transpose.ROTATE_90) if orientation == 6 else large
    exif = Image.Exif()
    exif[0x0112] = orientation
    stored.save(tmp_path / "large.jpg", quality=95, exif=exif)
    found = explainer.explain(tmp_path / "large.jpg", tuple(10 * each for each in BOX))
    assert abs(found.azimuth_deg - explanation.azimuth_deg) < 3
    assert found.verdict is explanation.verdict
    assert found.mask.shape == found.photo.shape[:2] == found.overlay().shape[:2] == (1400, 2000)
    small = np.asarray(Image.fromarray(found.mask).resize((200, 140), Image.Resampling.NEAREST))
    assert iou(small, explanation.mask) > 0.93
    assert found.box and explanation.box
    assert found.box == pytest.approx([10 * each for each in explanation.box], abs=40)


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


def test_the_inventory_of_public_names() -> None:
    assert set(vig.__all__) == PUBLIC and len(vig.__all__) == len(PUBLIC)
    assert set(dir(vig)) >= PUBLIC
    for name in PUBLIC - {"__version__"}:
        assert (getattr(vig, name).__doc__ or "").strip(), f"{name} has no docstring"
    with pytest.raises(AttributeError, match="no attribute 'explode'"):
        vig.explode  # noqa: B018


def test_the_package_is_typed() -> None:
    assert (files("vig") / "py.typed").is_file()


def test_importing_vig_loads_no_heavy_library() -> None:
    code = "import sys, vig; dir(vig); print(sorted({'torch', 'warp', 'numpy', 'PIL'} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_photo_of_any_size_in_and_a_folder_out_as_vig_fit_writes_it(
    explanation: vig.Explanation, photo: np.ndarray, tmp_path: Path
) -> None:
    folder = explanation.save(tmp_path / "result", "photo.png")
    assert json.loads((folder / "explanation.json").read_text()) == explanation.to_dict()
    Image.fromarray(photo).save(tmp_path / "photo.png")
    box = ",".join(f"{number:g}" for number in BOX)
    assert run_vig("fit", tmp_path / "photo.png", "--box", box, "--out", tmp_path / "cli") == 0
    of_cli = tmp_path / "cli" / "photo"
    names = sorted(path.name for path in folder.iterdir())
    assert names == sorted(
        path.name for path in of_cli.iterdir() if path.name not in ("corrections.json", ".key")
    )
    assert not [name for name in names if (folder / name).read_bytes() != (of_cli / name).read_bytes()]


WHOLE = vig.photo.Window(0, 0, 150)


@pytest.mark.parametrize(
    ("given", "free", "camera_distance_ratio"),
    [
        ({}, True, 1.4),
        ({"box": (25, 25, 100, 60)}, True, 1.4),
        ({"window": WHOLE}, False, 1.0),
        # The window's middle is 24.6 pixels above the photo's: its ray is 1.00137 long, and what a flat film
        # draws there larger by that to the power 3 / 2.
        ({"box": (25, 25, 100, 60), "focal": 3 * 1.12 * 140}, True, 3.00616),
        ({"window": WHOLE, "focal": 1e9}, False, 25.0),
    ],
)
def test_framing_and_distance_are_those_of_a_window_that_is_given_or_of_the_focal_length(
    given: dict, free: bool, camera_distance_ratio: float, explainer: vig.Explainer, monkeypatch
) -> None:
    """A photo cut by hand does not have the object where the paper's photos have it."""
    asked = []

    def explained(photos, object_class, recognizer, settings, valid, hints, expected):
        asked.append((settings.free_framing, settings.camera_distance_ratio))
        raise vig.UserError("enough")

    monkeypatch.setattr(vig.explainer, "explain", explained)
    monkeypatch.setattr(vig.explainer, "upright", lambda photo, window, recognizer: window)
    with pytest.raises(vig.UserError, match="enough"):
        explainer.explain(np.full((150, 150, 3), 128, np.uint8), **given)
    assert asked == [(free, pytest.approx(camera_distance_ratio, rel=1e-5))]


def test_a_focal_length_tells_the_camera(explainer: vig.Explainer, photo: np.ndarray) -> None:
    explanation = explainer.explain(photo, BOX, focal=700.0)
    scale = float(explanation.fit.framing[2])
    height, width = photo.shape[:2]
    assert explanation.focal_from == "given"
    np.testing.assert_allclose(explanation.camera.K, [[700, 0, width / 2], [0, 700, height / 2], [0, 0, 1]])
    # The fit's eye is at this distance with a lens `scale` longer: the true one is nearer by as much.
    distance = 0.4 * 700 / (1.12 * 1.4 * BOX[2]) / np.exp(scale)
    looked_at = explanation.camera_from_object @ [0, 0, explanation.object_class.target_height, 1]
    assert np.linalg.norm(looked_at[:3]) == pytest.approx(distance, rel=0.02)


def test_the_camera_is_rolled_as_window_and_fit_are(explainer: vig.Explainer, photo: np.ndarray) -> None:
    """A photo turned clockwise by 15 degrees, which the network's part and the fit's are together."""
    level = explainer.explain(photo, BOX)
    turned = ndimage.rotate(photo, -15, (0, 1), reshape=False, order=1, mode="nearest")
    explanation = explainer.explain(turned, BOX)
    fitted = explanation.window.roll + float(explanation.fit.framing[3])
    assert explanation.roll_deg == pytest.approx(math.degrees(fitted), abs=1e-6)
    assert explanation.roll_deg - level.roll_deg == pytest.approx(15, abs=5)
    assert explanation.camera.roll == pytest.approx(fitted)


@pytest.mark.parametrize(("present", "verdict"), [(0.71, "trusted"), (0.69, "ambiguous"), (0.49, "absent")])
def test_what_is_not_surely_found_is_not_trusted(
    explainer: vig.Explainer, photo: np.ndarray, present: float, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    explained = vig.explainer.explain

    def trusting(*given: Any) -> Any:
        sure = {"confidence": 0.9, "mask_confidence": 0.8, "mask_trusted": True}
        return (
            replace(
                fit,
                verdict=vig.Verdict.TRUSTED,
                alternatives=(OtherView(fit.latents, fit.framing, 0.06),),
                **sure,
            )
            for fit in explained(*given)
        )

    window = Window.of(photo.shape[1], photo.shape[0], BOX)
    monkeypatch.setattr(vig.explainer, "explain", trusting)
    monkeypatch.setattr(vig.explainer, "find", lambda photo, recognizer, clues: Candidate(window, present))
    found = explainer.explain(photo)
    assert str(found.verdict) == verdict and found.present == pytest.approx(present)
    assert found.trusted == (("view", "mask") if verdict == "trusted" else ())
    assert bool(found.amodal.any()) == (verdict != "absent")
    # Those of a view and a mask of an object that is there: whether it is, is another question.
    assert (found.confidence, found.mask_confidence) == ((0.0, 0.0) if verdict == "absent" else (0.9, 0.8))
    given = explainer.explain(photo, BOX)
    assert str(given.verdict) == "trusted"
    if verdict == "ambiguous":
        assert found.reason == "what was found in the photo may be no teapot; give a box if it is one"
        assert [view.probability for view in found.alternatives] == [0.06]


@pytest.mark.parametrize(
    ("threshold", "more"), [(0.9, ""), (1.0, "; no view of this class is trusted, see its card")]
)
def test_the_reason_says_what_the_confidence_says(
    explainer: vig.Explainer, photo: np.ndarray, threshold: float, more: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    explained = vig.explainer.explain
    doubt = {"confidence": 0.6, "view_threshold": threshold, "verdict": vig.Verdict.AMBIGUOUS}
    doubt["reason"] = low_confidence_reason(0.6, threshold)
    window = Window.of(photo.shape[1], photo.shape[0], BOX)
    monkeypatch.setattr(
        vig.explainer, "explain", lambda *given: (replace(fit, **doubt) for fit in explained(*given))
    )
    monkeypatch.setattr(vig.explainer, "find", lambda photo, recognizer, clues: Candidate(window, 0.8))
    found = explainer.explain(photo)
    assert found.confidence == 0.6 and found.present == 0.8
    assert found.reason == f"its view is right with a probability of {found.confidence:.0%} only{more}"


def test_a_photo_without_the_object_fails_and_says_so(explainer: vig.Explainer) -> None:
    explanation = explainer.explain(np.full((200, 300, 3), 128, np.uint8))
    assert explanation.verdict is vig.Verdict.ABSENT and explanation.confidence == 0
    assert explanation.present < 0.01 and explanation.trusted == () and explanation.box is None
    assert explanation.reason == "no teapot was found in the photo; give a box if there is one"


def test_an_explanation_shows_itself_in_a_line_and_in_a_notebook(explanation: vig.Explanation) -> None:
    assert repr(explanation).startswith("Explanation(teapot in 200 x 140: ") and len(repr(explanation)) < 120
    shown = Image.open(io.BytesIO(explanation._repr_png_()))
    assert (shown.format, shown.size) == ("PNG", (200, 140))
    assert np.array_equal(np.asarray(shown), explanation.overlay())
    photo = srgb8_from_linear(explanation.photo)
    outside = ~binary_dilation(explanation.amodal, iterations=8)
    assert np.array_equal(explanation.overlay()[outside], photo[outside])  # drawn on the photo itself
    assert (explanation.overlay() != photo).any()


def test_an_explanation_is_drawn_where_it_was_fitted_and_turned_and_relit(
    explanation: vig.Explanation,
) -> None:
    drawn = explanation.render()
    assert drawn.shape == (140, 200, 4) and drawn.dtype == np.float32
    assert iou(drawn[..., 3] > 0.5, explanation.amodal) > 0.98
    turned = explanation.render(azimuth_deg=explanation.azimuth_deg + 90)
    assert iou(turned[..., 3] > 0.5, explanation.amodal) < 0.9
    light, inside = explanation.latents.light[0], drawn[..., 3] > 0.5
    np.testing.assert_allclose(explanation.render(light=2 * light)[..., :3], 2 * drawn[..., :3], rtol=1e-4)
    black = explanation.render(albedo=np.zeros(3))
    assert not black[inside, :3].any() and np.array_equal(black[..., 3], drawn[..., 3])
    small = explanation.render(camera=explanation.camera.scale(0.5))
    assert small.shape == (70, 100, 4)


@pytest.mark.slow
def test_processes_give_the_same_explanations(explainer: vig.Explainer, photo: np.ndarray) -> None:
    photos, boxes, hints = [photo, photo[:, ::-1]], [BOX, None], [vig.Hints(elevation_deg=30.0), None]
    alone, shared = (list(explainer.explain_many(photos, boxes, workers=n, hints=hints)) for n in (1, 2))
    assert len(alone) == 2 and alone[0].azimuth_deg != alone[1].azimuth_deg
    assert alone[0].elevation_deg == pytest.approx(30, abs=1e-3)
    assert [e.to_dict() for e in shared] == [e.to_dict() for e in alone]
    for one, two in zip(alone, shared, strict=True):
        assert np.array_equal(one.mask, two.mask) and np.array_equal(one.photo, two.photo)


def test_an_object_is_found_without_a_box(explainer: vig.Explainer, photo: np.ndarray) -> None:
    """The photo in the corner of a larger one."""
    given = explainer.explain(photo, BOX)
    wide = np.full((300, 420, 3), 200, np.uint8)
    wide[150:290, 200:400] = photo
    found = explainer.explain(wide)
    assert given.box is not None and found.box is not None
    for at, (here, there) in enumerate(zip(found.box, given.box, strict=True)):
        assert here - (200, 150, 0, 0)[at] == pytest.approx(there, abs=12)


def test_the_verdict_and_the_pose_are_those_of_the_photo(explanation: vig.Explanation) -> None:
    truth = json.loads((files("vig_app") / "examples" / "truth.json").read_text())["photos"][0]
    assert explanation.verdict is vig.Verdict.TRUSTED
    assert explanation.elevation_deg == pytest.approx(truth["elevation_deg"], abs=10)
    assert abs((explanation.azimuth_deg - truth["azimuth_deg"] + 180) % 360 - 180) < 10
