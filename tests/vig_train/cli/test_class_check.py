"""`vig class check`: errors on labelled photos."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import vig
from vig.inference.calibration import CONFIDENCE_FEATURES, FitCalibration
from vig.io.errors import UserError
from vig.scene.object_class import PACKAGED
from vig_train.cli.class_check import HEADING, PhotoErrors, check_class, read_labels, recalibrate, row_of
from vig_train.cli.settings import CheckClass

pytestmark = pytest.mark.usefixtures("remembered_networks")


@pytest.fixture(scope="module")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[dict[str, object]]]:
    """A packaged example twice, labelled as vig explains it, but for a view that is turned round."""
    folder = tmp_path_factory.mktemp("photos")
    example = sorted((Path(vig.__file__).parents[1] / "vig_app" / "examples").glob("*.png"))[0]
    Image.open(example).save(folder / "a.png")
    Image.open(example).save(folder / "b.png")
    height, width = np.asarray(Image.open(example)).shape[:2]
    found = vig.Explainer("teapot").explain(folder / "a.png", box=(0, 0, width, height))
    Image.fromarray((found.amodal | found.mask).astype(np.uint8) * 255).save(folder / "outline.png")
    Image.fromarray(found.mask.astype(np.uint8) * 255).save(folder / "seen.png")
    label: dict[str, object] = {
        "photo": "a.png",
        "box": [0, 0, width, height],
        "azimuth_deg": found.azimuth_deg,
        "elevation_deg": found.elevation_deg,
        "silhouette": "outline.png",
        "shape": "plain",
        "object": 7,
    }
    turned = label | {
        "visible": "seen.png",
        "photo": "b.png",
        "azimuth_deg": found.azimuth_deg + 170,
        "shape": "turned",
    }
    (folder / "labels.json").write_text(json.dumps([label, turned]))
    return folder, [label, turned]


def test_errors_are_those_of_the_labels(
    labelled: tuple[Path, list[dict[str, object]]], capsys: pytest.CaptureFixture[str]
) -> None:
    before = (PACKAGED / "teapot" / "card.md").read_bytes()
    assert check_class(CheckClass("teapot", labelled[0], json=True)) == 0
    rows = {row["photos"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    assert rows["plain"]["azimuth_deg"] == pytest.approx(0, abs=1e-3)
    assert rows["plain"]["outline_iou"] == 1 and rows["plain"]["elevation_deg"] == pytest.approx(0, abs=1e-3)
    assert rows["turned"]["azimuth_deg"] == pytest.approx(170, abs=1e-3)
    assert rows["turned"]["visible_iou"] == 1 > rows["plain"]["visible_iou"] > 0.3, "something is before it"
    assert (rows["all"]["count"], rows["all"]["within_15"], rows["all"]["turned"]) == (2, 0.5, 0.5)
    assert (PACKAGED / "teapot" / "card.md").read_bytes() == before, "a packaged card is not the user's"


def test_the_card_of_a_pack_gets_the_table_once(
    labelled: tuple[Path, list[dict[str, object]]],
    small_pack: Callable[[], Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Also where it lies in a folder called classes, as the packaged ones do."""
    (tmp_path / "classes").mkdir()
    pack = small_pack().rename(tmp_path / "classes" / "pot")
    for _ in range(2):
        check_class(CheckClass(str(pack), labelled[0]))
    text = (pack / "card.md").read_text()
    assert text.count(HEADING) == 1 and "| all | 2 |" in text
    assert "| all | 2 |" in capsys.readouterr().out


@pytest.fixture
def small_pack(tmp_path: Path) -> Callable[[], Path]:
    def made() -> Path:
        pack = tmp_path / "pack"
        pack.mkdir()
        for file in (PACKAGED / "teapot").iterdir():
            (pack / file.name).write_bytes(file.read_bytes())
        return pack

    return made


def test_what_is_not_known_is_a_dash_and_null_and_names_stay(
    labelled: tuple[Path, list[dict[str, object]]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, labels = labelled
    (tmp_path / "a.png").write_bytes((folder / "a.png").read_bytes())
    label = {name: value for name, value in labels[0].items() if name != "silhouette"} | {"shape": "banana"}
    (tmp_path / "labels.json").write_text(json.dumps([label]))
    check_class(CheckClass("teapot", tmp_path))
    assert "| banana | 1 |" in (table := capsys.readouterr().out) and "| - |" in table
    check_class(CheckClass("teapot", tmp_path, json=True))
    row = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)["rows"][0]
    assert row["outline_iou"] is None


def photo_errors(azimuth: float, side: str, verdict: str = "ambiguous") -> PhotoErrors:
    return PhotoErrors("a", "", side, azimuth, 1.0, 0.9, 0.8, verdict)


def test_balanced_shares_count_each_side_alike() -> None:
    errors = [photo_errors(5, "right")] * 8 + [
        photo_errors(40, "left"),
        photo_errors(160, "other", "trusted"),
    ]
    row = row_of("all", errors, 15)
    assert (row["within_15"], row["within_30"], row["turned"]) == (0.8, 0.8, 0.1)
    assert row["balanced_15"] == pytest.approx(1 / 3)
    assert (row["trusted"], row["trusted_right"]) == (1, 0.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"photo": "no.png"}, "expected 'no.png' of"),
        ({"silhouette": "no.png"}, "expected 'no.png' of"),
        ({"elevation_deg": 100}, "elevation from -90 to 90"),
        ({"azimuth_deg": "left"}, "azimuth_deg"),
        ({"box": [1, 2, 3]}, "box"),
    ],
)
def test_labels_that_do_not_fit_get_one_line(
    labelled: tuple[Path, list[dict[str, object]]], change: dict[str, object], said: str, tmp_path: Path
) -> None:
    folder, labels = labelled
    path = tmp_path / "labels.json"
    path.write_text(json.dumps([labels[0] | change]))
    with pytest.raises(UserError, match=said):
        read_labels(folder, path)


@pytest.mark.parametrize(
    ("text", "said"), [("[]", "one photo or more"), ("{", "labels of photos"), ("{}", "labels")]
)
def test_a_file_without_labels_gets_one_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "labels.json"
    path.write_text(text)
    with pytest.raises(UserError, match=said):
        read_labels(tmp_path, path)
    with pytest.raises(UserError, match="expected a folder of photos"):
        read_labels(tmp_path / "none", path)


def test_one_silhouette_that_does_not_fit_ends_no_run(
    labelled: tuple[Path, list[dict[str, object]]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, labels = labelled
    for name in ("a.png", "b.png", "outline.png", "seen.png"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    Image.new("L", (20, 20), 255).save(tmp_path / "small.png")
    wrong = labels[0] | {"silhouette": "small.png"}
    (tmp_path / "labels.json").write_text(json.dumps([wrong, labels[1]]))
    check_class(CheckClass("teapot", tmp_path, json=True))
    said = capsys.readouterr()
    assert json.loads(said.out)["rows"][0]["count"] == 1 and "left out a.png" in said.err
    (tmp_path / "labels.json").write_text(json.dumps([wrong]))
    with pytest.raises(UserError, match="none of 1 can.*a mask as large as 'a.png'"):
        check_class(CheckClass("teapot", tmp_path))


def test_temperature_and_threshold_are_those_of_the_photos(tmp_path: Path) -> None:
    """A calibration states twice the log odds at which views are right: where it says .98, which is
    sigmoid(4), they are right with a probability of sigmoid(2) = .88.
    """
    rng = np.random.default_rng(7)
    count = len(CONFIDENCE_FEATURES)
    weights, none, latents = 2.0 * np.eye(count)[0], np.zeros(count), np.ones((2, 3))
    path = tmp_path / "calibration.json"
    FitCalibration(weights, 0.5, none, 20.0, none, 0.0, 0.9, 0.7, latents, latents).save(path)
    errors = []
    for odds in rng.uniform(-2, 6, 2000):
        error = 1.0 if rng.random() < 1 / (1 + np.exp(-odds)) else 90.0
        features = np.append((odds - 0.25), np.zeros(count - 1))
        errors.append(PhotoErrors(f"{len(errors)}.png", "", "other", error, 1.0, 1.0, 1.0, "", features))
    words = recalibrate(path, errors, 15.0)
    after = FitCalibration.load(path)
    assert after.view_weights[0] == pytest.approx(1.0, rel=0.1) and after.view_bias == pytest.approx(
        0.25, rel=0.1
    )
    assert "temperature 2.0" in words or "temperature 1.9" in words or "temperature 2.1" in words
    stated = np.array([after.confidence(error.features) for error in errors])
    right = np.array([error.azimuth_deg == 1.0 for error in errors])
    assert right[stated >= after.threshold].mean() >= 0.95 and after.threshold < 0.9
    assert f"now trusted from {after.threshold:.2f}" in words and "before trusted from 0.90" in words
    assert (after.mask_threshold, after.in_distribution_bias) == (0.7, 20.0)
    again = recalibrate(path, errors, 15.0)  # by the same photos nothing is left to change
    assert "temperature 1.00" in again and FitCalibration.load(path).threshold == pytest.approx(
        after.threshold
    )


@pytest.mark.parametrize("own", [False, True])
def test_few_labels_or_a_packaged_class_set_no_threshold(
    labelled: tuple[Path, list[dict[str, object]]], small_pack: Callable[[], Path], own: bool
) -> None:
    pack = small_pack() if own else PACKAGED / "teapot"
    before = (pack / "calibration.json").read_bytes()
    with pytest.raises(UserError, match="expected 30 labels or more, and a calibrated pack"):
        check_class(CheckClass(str(pack), labelled[0], calibrate=True))
    assert (pack / "calibration.json").read_bytes() == before


def test_thirty_photos_calibrate_a_pack(
    labelled: tuple[Path, list[dict[str, object]]], small_pack: Callable[[], Path], tmp_path: Path
) -> None:
    folder, labels = labelled
    (tmp_path / "many.json").write_text(json.dumps([labels[0] | {"shape": ""}] * 30))
    pack = small_pack()
    before = FitCalibration.load(pack / "calibration.json")
    check_class(CheckClass(str(pack), folder, tmp_path / "many.json", calibrate=True))
    changed = FitCalibration.load(pack / "calibration.json")
    # All views are right: the confidence rises, and nothing is against the threshold.
    assert changed.view_bias / before.view_bias > 1 and changed.threshold <= before.threshold
    assert "Confidence in views, set by 30 photos: temperature" in (pack / "card.md").read_text()
