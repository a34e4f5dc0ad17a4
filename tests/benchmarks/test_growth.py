"""The benchmarks of growth and of large photos: what they measure is what they say."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks import growth, photos
from benchmarks.case import Ours, make_case


def test_a_thinned_case_has_fewer_numbers_and_the_same_mean() -> None:
    case = make_case(60)
    few = growth.thinned(case, 2)
    assert few.model.modes == 2 and few.truth.shape.shape[1] == 2
    np.testing.assert_array_equal(few.model.mean, case.model.mean)
    assert np.isfinite(float(Ours(few).full(0).value[0]))


def test_a_batch_is_as_many_points_as_asked() -> None:
    values = growth.batched(make_case(60), 5)(0).value
    assert values.shape == (5,) and np.isfinite(values.numpy()).all()


def test_proportional_work_has_exponent_one(monkeypatch: pytest.MonkeyPatch) -> None:
    times = {"10": np.array([1.0, 2.0]), "20": np.array([2.0, 4.0]), "80": np.array([8.0, 16.0])}
    monkeypatch.setattr(growth, "interleaved", lambda *_: times)
    rows = growth.measured("x", {10: print, 20: print, 80: print}, rounds=2)
    assert [row["name"] for row in rows] == ["x_10_ms", "x_20_ms", "x_80_ms", "x_exponent"]
    assert rows[-1]["value"] == 1.0


@pytest.mark.parametrize("ending", photos.FORMATS)
def test_a_photo_is_enlarged_to_the_pixels_asked(tmp_path: Path, ending: str) -> None:
    small, large = tmp_path / "small.png", tmp_path / f"large.{ending}"
    Image.new("RGB", (40, 30), (9, 99, 199)).save(small)
    photos.enlarged(small, 1, large)
    with Image.open(large) as opened:
        assert opened.width * opened.height == pytest.approx(1e6, rel=0.01)
        assert opened.width / opened.height == pytest.approx(4 / 3, rel=0.01)


def test_a_fit_that_fails_is_no_measurement(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match=r"vig fit missing.png ended with"):
        photos.cost(tmp_path / "missing.png", tmp_path / "out")


@pytest.mark.parametrize(
    ("module", "arguments"),
    [(growth, ["--fits", "9"]), (growth, ["--repeats", "0"]), (photos, ["--runs", "0"])],
)
def test_senseless_numbers_are_refused(
    module: object, arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["x", *arguments])
    with pytest.raises(SystemExit):
        module.main()  # type: ignore[attr-defined]
    assert "expected" in capsys.readouterr().err
