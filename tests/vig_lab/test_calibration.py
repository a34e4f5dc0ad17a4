"""Trust is learned from clues, and deviations are widened until nine in ten intervals hold."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import torch

from vig.dataset import Dataset
from vig.errors import UserError
from vig.inference import Calibration
from vig.inference.calibration import CLUES
from vig_lab.calibration import (
    PRECISION,
    Lessons,
    describe,
    learn,
    least_threshold,
    logistic,
    roll_angles,
    rolled,
    to_roll,
    widening,
)

ALIKE = np.full(4000, 1 / 4000)


@pytest.fixture(scope="module")
def lessons() -> Lessons:
    """Fits whose view is right as one clue says, and whose errors are thrice what the curvature states."""
    rng = np.random.default_rng(0)
    clues = rng.normal(size=(4000, len(CLUES)))
    right = rng.random(4000) < 1 / (1 + np.exp(-3 * clues[:, 0] - 2))
    deviation = np.exp(rng.normal(0, 0.5, (4000, 5)))
    noise = np.exp(clues[:, [CLUES.index("misfit")]])
    error = 3 * noise * deviation * rng.normal(size=(4000, 5))
    fold = np.arange(4000) % 5
    return Lessons(clues, right, error, deviation, ALIKE, fold, clues[:0], fold[:0])


def strange(lessons: Lessons, off: float) -> Lessons:
    """The same, and photos of another kind, about which the recognition model is more in doubt."""
    clues = lessons.clues[:1000].copy()
    clues[:, CLUES.index("shape_doubt")] += off
    return replace(lessons, strange=clues, strange_fold=lessons.fold[:1000])


def test_the_clue_that_matters_is_found_and_confidence_is_a_probability(lessons: Lessons) -> None:
    learned = learn(lessons)
    assert learned.weights[0] == pytest.approx(3, rel=0.15)
    assert learned.weights[1:].abs().max() < 0.2
    confidence = np.array([learned.confidence(clues) for clues in torch.from_numpy(lessons.clues)])
    for low, high in ((0.1, 0.3), (0.4, 0.6), (0.8, 0.95)):
        here = (confidence > low) & (confidence < high)
        assert lessons.right[here].mean() == pytest.approx(confidence[here].mean(), abs=0.06)


def test_photos_of_another_kind_are_not_trusted(lessons: Lessons) -> None:
    given = strange(lessons, off=6.0)
    learned = learn(given)
    assert learned.kind_weights[CLUES.index("shape_doubt")] < 0
    assert learned.kind_weights[CLUES.index("lead")] == 0, "says nothing of the kind of photo"
    known = np.array([learned.known(clues) for clues in torch.from_numpy(given.clues)])
    other = np.array([learned.known(clues) for clues in torch.from_numpy(given.strange)])
    assert (known > 0.5).mean() > 0.99 and (other < 0.5).mean() > 0.99
    confidence = [learned.confidence(clues) for clues in torch.from_numpy(given.strange)]
    assert np.mean(np.array(confidence) >= learned.threshold) < 0.01
    assert "fits of rolled photos, of which 0" in describe(learned, given)[1]


def test_without_photos_of_another_kind_all_are_of_the_known_one(lessons: Lessons) -> None:
    learned = learn(lessons)
    assert all(learned.known(clues) > 0.999 for clues in torch.from_numpy(lessons.clues[:50]))


def test_a_worse_fit_is_never_trusted_more() -> None:
    rng = np.random.default_rng(2)
    clues = rng.normal(size=(2000, len(CLUES)))
    right = rng.random(2000) < 1 / (1 + np.exp(-3 * clues[:, CLUES.index("misfit")]))
    weights, _ = logistic(clues, right, np.full(2000, 1 / 2000))
    assert weights[CLUES.index("misfit")] == 0


def test_what_is_trusted_is_as_often_right_as_was_asked(lessons: Lessons) -> None:
    learned = learn(lessons)
    confidence = np.array([learned.confidence(clues) for clues in torch.from_numpy(lessons.clues)])
    trusted = confidence >= learned.threshold
    assert 0.3 < trusted.mean() < 0.8
    assert lessons.right[trusted].mean() == pytest.approx(PRECISION, abs=0.01)
    assert "are right" in describe(learned, lessons)[0]


def test_nine_in_ten_intervals_hold_in_either_group(lessons: Lessons) -> None:
    learned = learn(lessons)
    confidence = np.array([learned.confidence(clues) for clues in torch.from_numpy(lessons.clues)])
    for trusted in (True, False):
        group = (confidence >= learned.threshold) == trusted
        pairs = zip(lessons.deviation[group], lessons.clues[group], strict=True)
        wide = torch.stack([learned.widened(*map(torch.from_numpy, pair), trusted) for pair in pairs])
        held = np.abs(lessons.error[group]) <= 1.6449 * wide.numpy()
        assert held.mean(0) == pytest.approx(0.9, abs=0.02)


def test_a_floor_is_found_where_small_deviations_mean_nothing() -> None:
    rng = np.random.default_rng(1)
    deviation = 10 ** rng.uniform(-4, 0, 4000)
    error = rng.normal(size=4000) * np.hypot(deviation, 0.5)
    scale, floor = widening(error, deviation, ALIKE)
    assert 0.3 < floor < 0.7
    held = np.abs(error) <= 1.6449 * np.hypot(scale * deviation, floor)
    assert held.mean() == pytest.approx(0.9, abs=0.005)
    small = deviation < 0.01
    assert held[small].mean() == pytest.approx(0.9, abs=0.05)


def test_nothing_is_trusted_when_nothing_is_right_often_enough() -> None:
    right = np.zeros(100, dtype=bool)
    assert least_threshold(np.linspace(0, 0.9, 100), right, np.ones(100)) == 1.0


def test_a_calibration_is_read_as_it_was_written(lessons: Lessons, tmp_path: Path) -> None:
    learned = learn(lessons)
    learned.save(tmp_path / "calibration.json")
    read = Calibration.load(tmp_path / "calibration.json")
    assert read.threshold == learned.threshold and torch.equal(read.scale, learned.scale)
    assert torch.equal(read.weights, learned.weights) and read.to_json() == learned.to_json()


def test_a_calibration_of_an_older_format_is_told(lessons: Lessons, tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(learn(lessons).to_json().replace('"format": 3', '"format": 1'))
    with pytest.raises(UserError, match="got one of format 1, where this vig reads 3. Make it again"):
        Calibration.load(path)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"clues": ["lead"]}'])
def test_a_calibration_of_no_use_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "calibration.json").write_text(text)
    with pytest.raises(UserError, match="expected a calibration at"):
        Calibration.load(tmp_path / "calibration.json")


def test_photos_are_rolled_but_those_from_above() -> None:
    """From above a rolled photo is a photo of another azimuth, and nothing is wrong with it."""
    latents = np.zeros((9, 24), np.float32)
    latents[[0, 4], 11] = math.radians(80)
    assert to_roll(cast(Dataset, SimpleNamespace(latents=latents))).tolist() == [1, 3, 6, 8]


def test_a_rolled_photo_is_the_photo_turned_by_a_good_angle_about_its_centre() -> None:
    y, x = np.mgrid[:61, :61] - 30.0
    spot = np.exp(-((x - 12) ** 2 + y**2) / 8)  # at the right, 12 pixels from the centre
    images = np.repeat((255 * spot).astype(np.uint8)[None, :, :, None], 40, 0).repeat(3, 3)
    found = rolled(images, roll_angles(40))
    assert found.shape == images.shape and found.dtype == np.uint8
    mass = found[..., 0].astype(float)
    to = np.degrees(np.arctan2((mass * y).sum((1, 2)), (mass * x).sum((1, 2))))
    away = np.hypot((mass * y).sum((1, 2)), (mass * x).sum((1, 2))) / mass.sum((1, 2))
    np.testing.assert_allclose(away, 12, atol=0.3)
    assert (np.abs(to) > 19).all()
    assert np.histogram(to % 360, bins=8, range=(0, 360))[0].min() >= 2, "all round"


def test_a_rolled_photo_is_in_the_fold_of_the_photo_it_was(lessons: Lessons) -> None:
    given = strange(lessons, off=1.0)
    left = given.without(2)
    assert set(left.fold) == set(left.strange_fold) == {0, 1, 3, 4}
    assert len(left.strange) == 800 and len(left.clues) == len(left.weight) == 3200
