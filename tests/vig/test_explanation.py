"""What is written for the user of one fit."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from PIL import Image, ImageDraw
from scipy.ndimage import distance_transform_edt

from tests.support import latents
from vig import Explainer, Explanation, record
from vig.inference import ExplainSettings, Fit, OtherView, Verdict
from vig.inference.calibration import CONFIDENCE_FEATURES
from vig.io.errors import UserError
from vig.photo.window import Window
from vig.scene import ObjectClass
from vig_app.examples import example_photos


def written(
    folder: Path, photo: np.ndarray, window: Window, fit: Fit, object_class: ObjectClass
) -> dict[str, Any]:
    """What the JSON of a saved explanation holds."""
    explanation = Explanation(photo, window, fit, object_class)
    assert explanation.save(folder) == folder
    return explanation.to_dict()


@pytest.fixture
def fit() -> Fit:
    """An object over rows 50-99, columns 50-99 of the window; its right half is hidden."""
    amodal = np.zeros((150, 150), bool)
    amodal[50:100, 50:100] = True
    mask = amodal.copy()
    mask[:, 75:] = False
    return Fit(
        latents=latents(),
        framing=np.array([0.01, 0.02, 0.1, 0.03], np.float32),
        deviation=np.arange(1, 25) / 100,
        framing_deviation=np.array([0.01, 0.01, 0.02, 0.03], np.float32),
        visible=mask.astype(np.float32),
        mask=mask,
        mask_by_pixel=mask,
        coverage=amodal.astype(np.float32),
        verdict=Verdict.TRUSTED,
        reason=Verdict.TRUSTED.value,
        confidence=0.9,
        mask_confidence=0.7,
        mask_trusted=False,
        confidence_features=np.zeros(len(CONFIDENCE_FEATURES)),
        evidence=123.456789,
        start_evidence=-1.0,
        evaluations=77,
        alternatives=(),
        descent=np.concatenate([latents().to_vector(), np.array([[0.01, 0.02, 0.1, 0.03]])], axis=1),
    )


def test_seven_files_are_written_and_the_json_says_what_was_returned(
    fit: Fit, teapot: ObjectClass, tmp_path: Path
) -> None:
    photo = np.full((150, 150, 3), 0.2, np.float32)
    said = written(tmp_path / "new" / "photo", photo, Window.of(150, 150), fit, teapot)
    folder = tmp_path / "new" / "photo"
    assert {path.name for path in folder.iterdir()} == {
        "explanation.json",
        "overlay.png",
        "mask.png",
        "render.png",
        "object.glb",
        "report.html",
        "thumbnail.jpg",
    }
    assert json.loads((folder / "explanation.json").read_text()) == said
    assert Image.open(folder / "overlay.png").size == (150, 150)


def test_chosen_files_alone_are_written_and_others_of_another_result_go(
    fit: Fit, teapot: ObjectClass, tmp_path: Path
) -> None:
    photo = np.full((150, 150, 3), 0.2, np.float32)
    explanation = Explanation(photo, Window.of(150, 150), fit, teapot)
    explanation.save(tmp_path)
    explanation.save(tmp_path, files=["mask.png"])
    assert len(list(tmp_path.iterdir())) == 7, "they are of this result, too"
    other = Explanation(photo, Window.of(150, 150), replace(fit, evidence=1.0), teapot)
    other.save(tmp_path, files=["mask.png"])
    assert {path.name for path in tmp_path.iterdir()} == {"explanation.json", "mask.png"}
    with pytest.raises(UserError, match="texture_seen.png; got 'mask.jpg'. Leave it out"):
        other.save(tmp_path / "new", files=["mask.jpg"])
    assert not (tmp_path / "new").exists()


def test_the_json_speaks_degrees_and_names_every_latent(
    fit: Fit, teapot: ObjectClass, tmp_path: Path
) -> None:
    photo = np.full((150, 150, 3), 0.2, np.float32)
    said = written(tmp_path, photo, Window.of(150, 150), fit, teapot)
    assert set(said) == {
        *(
            "format",
            "frames",
            "glb_from_object",
            "hints",
            "mask_confidence",
            "points",
            "bounds",
            "present",
            "trusted",
            "trusted_from",
        ),
        *(
            "vig",
            "class",
            "verdict",
            "reason",
            "confidence",
            "azimuth_deg",
            "elevation_deg",
            "albedo",
            "light",
            "shape",
        ),
        *("alternatives", "deviation", "hidden_fraction", "evidence_nats", "start_evidence_nats"),
        *("evaluations", "window", "framing", "camera", "pinhole", "roll_deg", "family", "box", "front"),
    }
    assert list(said) == [field.encode_name for field in msgspec.structs.fields(record.Explanation)]
    assert (said["class"], said["verdict"]) == ("teapot", "trusted")
    assert (said["mask_confidence"], said["trusted"]) == (0.7, ["view"])
    assert said["azimuth_deg"] == pytest.approx(360 - math.degrees(1), abs=1e-4)  # in [0, 360)
    assert said["elevation_deg"] == pytest.approx(math.degrees(0.5), abs=1e-4)
    assert said["albedo"] == pytest.approx([0.8, 0.4, 0.1])
    assert len(said["light"]) == 9 and said["light"][0] == pytest.approx(2.356)
    assert said["shape"] == [0.5] * 10
    deviation = said["deviation"]
    assert deviation["shape"] == pytest.approx([i / 100 for i in range(1, 11)])
    assert deviation["azimuth_deg"] == pytest.approx(math.degrees(0.11), abs=1e-4)
    assert deviation["elevation_deg"] == pytest.approx(math.degrees(0.12), abs=1e-4)
    assert deviation["albedo"] == pytest.approx([0.13, 0.14, 0.15])
    assert deviation["light"] == pytest.approx([i / 100 for i in range(16, 25)])
    assert said["hidden_fraction"] == 0.5
    assert said["window"] == {"left": 0, "top": 0, "side": 150}
    assert said["framing"]["magnification"] == pytest.approx(math.exp(0.1), abs=1e-4)
    assert said["alternatives"] == [] and said["format"] == 2
    assert said["camera"]["focal_from"] == "assumed" and "ratio" in said["camera"]["scale"]
    assert said["frames"]["object"].startswith("right-handed, metres, Z up")


def test_the_other_explanation_is_told(fit: Fit, teapot: ObjectClass) -> None:
    other = replace(latents(), azimuth=np.array([2.0], np.float32))
    view = OtherView(other, np.zeros(4, np.float32), 0.3)
    ambiguous = replace(fit, verdict=Verdict.AMBIGUOUS, reason="two", alternatives=(view,))
    photo = np.full((150, 150, 3), 0.2, np.float32)
    explanation = Explanation(photo, Window.of(150, 150), ambiguous, teapot)
    (found,) = explanation.alternatives
    assert found.latents is other and found.probability == 0.3
    assert found.azimuth_deg == pytest.approx(math.degrees(2.0), abs=1e-4)
    assert found.camera.roll == 0 and found.camera_from_object.shape == (4, 4)
    said = explanation.to_dict()
    assert said["verdict"] == "ambiguous" and said["reason"] == "two"
    (told,) = said["alternatives"]
    assert told["azimuth_deg"] == pytest.approx(math.degrees(2.0), abs=1e-4)
    assert (told["probability"], told["roll_deg"]) == (0.3, 0.0)
    assert set(told) == {
        *("azimuth_deg", "elevation_deg", "albedo", "light", "shape", "roll_deg"),
        *("probability", "behind_nats", "K", "camera_from_object"),
    }
    assert told["behind_nats"] is None


def test_the_mask_has_three_values_in_the_photos_own_frame(
    fit: Fit, teapot: ObjectClass, tmp_path: Path
) -> None:
    """A window of side 300 at (-30, 40) in a photo of 400 x 320: every window pixel is two of the photo's."""
    written(tmp_path, np.full((320, 400, 3), 0.2, np.float32), Window(-30, 40, 300), fit, teapot)
    mask = np.asarray(Image.open(tmp_path / "mask.png"))
    expected = np.zeros((320, 400), np.uint8)
    expected[140:240, 70:120] = 255
    expected[140:240, 120:170] = 128
    assert mask.shape == expected.shape and set(np.unique(mask)) == {0, 128, 255}
    assert (mask != expected).mean() < 0.002  # half a pixel along the edges at most


def test_what_lies_beyond_the_photo_is_not_called_hidden(
    fit: Fit, teapot: ObjectClass, tmp_path: Path
) -> None:
    """The photo ends where the hidden half begins: all of the object that it shows is visible."""
    said = written(tmp_path, np.full((150, 75, 3), 0.2, np.float32), Window(0, 0, 150), fit, teapot)
    assert said["hidden_fraction"] == 0.0


def test_nothing_covered_is_not_a_fraction(fit: Fit, teapot: ObjectClass, tmp_path: Path) -> None:
    nothing = np.zeros((150, 150), bool)
    empty = replace(
        fit, coverage=nothing.astype(np.float32), mask=nothing, visible=nothing.astype(np.float32)
    )
    said = written(tmp_path, np.full((150, 150, 3), 0.2, np.float32), Window.of(150, 150), empty, teapot)
    assert said["hidden_fraction"] is None
    assert not np.asarray(Image.open(tmp_path / "mask.png")).any()


def as_others_take_it(photo: Image.Image, how: str) -> Image.Image:
    """The photo itself, or in a larger picture: enlarged and off its middle, or turned."""
    if how == "as it is":
        return photo
    large = Image.new("RGB", (900, 700), (120, 120, 120))
    picture = photo.resize((480, 480), Image.Resampling.BICUBIC)
    if how == "turned":
        picture = picture.rotate(-18, Image.Resampling.BICUBIC, expand=True, fillcolor=(120, 120, 120))
    large.paste(picture, (280, 60))
    return large


@pytest.mark.parametrize(("number", "how"), [(0, "as it is"), (3, "enlarged"), (1, "turned"), (7, "turned")])
def test_numpy_alone_puts_the_object_on_the_photo(
    number: int, how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the JSON and the GLB hold, and nothing of vig: the projected faces cover what the model's mask
    does, without the network's share. The last, three quarters hidden, would count as absent.
    """
    monkeypatch.setattr("vig.inference.presence.MIN_PRESENT", 0.0)
    photo = as_others_take_it(Image.open(example_photos()[number].photo).convert("RGB"), how)
    explanation = Explainer("teapot", ExplainSettings(network_mask_share=0.0)).explain(photo)
    explanation.save(tmp_path)
    said = json.loads((tmp_path / "explanation.json").read_text())
    data = (tmp_path / "object.glb").read_bytes()
    length = int.from_bytes(data[12:16], "little")
    described, binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def read(number: int, kind: str, width: int) -> np.ndarray:
        view = described["bufferViews"][described["accessors"][number]["bufferView"]]
        return np.frombuffer(binary, kind, view["byteLength"] // 4, view["byteOffset"]).reshape(-1, width)

    points = np.c_[read(0, "<f4", 3), np.ones(len(read(0, "<f4", 3)))]
    pose, k = np.array(said["camera"]["camera_from_object"]), np.array(said["camera"]["K"])
    seen = k @ (pose @ points.T)[:3]
    pixels = (seen[:2] / seen[2]).T
    size = said["camera"]["width"], said["camera"]["height"]
    drawn = Image.new("1", (4 * size[0], 4 * size[1]))
    pen = ImageDraw.Draw(drawn)
    for primitive in described["meshes"][0]["primitives"]:
        for face in read(primitive["indices"], "<u4", 3):
            pen.polygon([tuple(4 * pixels[corner]) for corner in face], fill=1)
    outline = np.asarray(drawn).reshape(size[1], 4, size[0], 4).mean((1, 3)) > 0.5
    within(
        outline, explanation.render()[..., 3] > 0.5, 1, 1e-4
    )  # a pixel that is half covered goes either way
    # The mask has the resolution of the fit, thin tips and sharp corners less, and ends with the window.
    window = explanation.window
    inside = np.zeros_like(outline)
    for tile in window.tiles(*size):
        inside[tile] = window.paste(np.ones((150, 150)), *tile) > 0.5
    amodal = np.asarray(Image.open(tmp_path / "mask.png")) > 0
    within(outline & inside, amodal, window.side / 150 + 1, 0.004)


def within(one: np.ndarray, other: np.ndarray, pixels: float, left: float = 0.0) -> None:
    """Each covers what the other does but for pixels so near its edge, and a share of its pixels."""
    for here, there in ((one, other), (other, one)):
        far = here & (distance_transform_edt(~there) > pixels)
        assert far.sum() <= left * here.sum(), (far.sum(), here.sum())


def test_a_verdict_prints_as_the_json_has_it() -> None:
    assert [str(verdict) for verdict in Verdict] == ["trusted", "reverted", "ambiguous", "failed", "absent"]
