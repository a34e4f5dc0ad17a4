"""Trust is learned from features, and deviations are widened until nine in ten intervals hold."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

import vig
from tests.support import TEAPOT, run_vig
from vig.inference import ExplainSettings, FitCalibration, Verdict, explain_one
from vig.inference.calibration import CONFIDENCE_FEATURES, MIN_DEVIATION, residual
from vig.io.errors import UserError
from vig.photo.pinhole import sight_axes
from vig.recognition import Recognizer
from vig.scene import ObjectClass, Symmetry, linear_from_srgb
from vig_app.examples import example_photos
from vig_train.calibration import learning
from vig_train.calibration.learning import (
    FOLDS,
    MIN_THRESHOLD,
    PRECISION,
    CalibrationSamples,
    describe,
    deviation_scale_and_floor,
    learn,
    logistic,
    lowest_threshold,
    out_of_fold,
    pooled_threshold,
)
from vig_train.calibration.positions import calibrate_positions
from vig_train.calibration.samples import (
    AS_USERS_TAKE_THEM,
    StudioPhotos,
    _by_mesh,
    calibrate_fits,
    fit_count,
    photos_to_roll,
    roll_angles,
    roll_photos,
    samples_of,
)
from vig_train.evaluation.fits import FitRun, Fits
from vig_world.dataset import Dataset
from vig_world.generation.write import make_dataset

ALIKE = np.full(4000, 1 / 4000)
MASK_CLUE = CONFIDENCE_FEATURES.index("outline_agreement")


@pytest.fixture(scope="module")
def samples() -> CalibrationSamples:
    """Fits whose view is right as one clue says, and whose errors are thrice what the curvature states."""
    rng = np.random.default_rng(0)
    features = rng.normal(size=(4000, len(CONFIDENCE_FEATURES)))
    right = rng.random(4000) < 1 / (1 + np.exp(-3 * features[:, 0] - 2))
    deviation = np.exp(rng.normal(0, 0.5, (4000, 5)))
    noise = np.exp(features[:, [CONFIDENCE_FEATURES.index("log_residual")]])
    error = 3 * noise * deviation * rng.normal(size=(4000, 5))
    fold = np.arange(4000) % FOLDS
    mask_right = rng.random(4000) < 1 / (1 + np.exp(-2 * features[:, MASK_CLUE] - 1))
    return CalibrationSamples(
        features, right, mask_right, error, deviation, ALIKE, fold, np.arange(4000), features[:0], fold[:0]
    )


@pytest.fixture(scope="module")
def learned(samples: CalibrationSamples) -> FitCalibration:
    return learn(samples)


def with_others(samples: CalibrationSamples, off: float) -> CalibrationSamples:
    """The same, and photos of another kind, about which the recognition model is more in doubt."""
    features = samples.features[:1000].copy()
    features[:, CONFIDENCE_FEATURES.index("shape_deviation")] += off
    return replace(samples, out_of_distribution=features, out_of_distribution_fold=samples.fold[:1000])


def test_the_clue_that_matters_is_found_and_confidence_is_a_probability(
    samples: CalibrationSamples, learned: FitCalibration
) -> None:
    assert learned.view_weights[0] == pytest.approx(3, rel=0.15)
    assert np.abs(learned.view_weights[1:]).max() < 0.2
    assert learned.mask_weights[MASK_CLUE] == pytest.approx(2, rel=0.15)
    assert learned.mask_bias == pytest.approx(1, abs=0.2)
    confidence = np.array([learned.confidence(row) for row in samples.features])
    for low, high in ((0.1, 0.3), (0.4, 0.6), (0.8, 0.95)):
        here = (confidence > low) & (confidence < high)
        assert samples.right[here].mean() == pytest.approx(confidence[here].mean(), abs=0.06)


def test_photos_of_another_kind_are_not_trusted(samples: CalibrationSamples) -> None:
    given = with_others(samples, off=6.0)
    learned = learn(given)
    assert learned.in_distribution_weights[CONFIDENCE_FEATURES.index("shape_deviation")] < 0
    assert learned.in_distribution_weights[CONFIDENCE_FEATURES.index("evidence_gap")] == 0, (
        "says nothing of the kind of photo"
    )
    known = np.array([learned.in_distribution(row) for row in given.features])
    other = np.array([learned.in_distribution(row) for row in given.out_of_distribution])
    assert (known > 0.5).mean() > 0.99 and (other < 0.5).mean() > 0.99
    confidence = [learned.confidence(row) for row in given.out_of_distribution]
    assert np.mean(np.array(confidence) >= learned.threshold) < 0.01
    assert "fits of photos rolled or without the object, of which 0" in describe(learned, given)[2]
    masks = [learned.mask_confidence(row) for row in given.out_of_distribution]
    assert np.mean(np.array(masks) >= learned.mask_threshold) < 0.01


def test_without_photos_of_another_kind_all_are_of_the_known_one(
    samples: CalibrationSamples, learned: FitCalibration
) -> None:
    assert all(learned.in_distribution(row) > 0.999 for row in samples.features[:50])


def test_few_fits_get_a_threshold_with_those_of_other_classes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Views of other classes are all right from .85 on and wrong below; nine own fits prove nothing."""
    confidence = np.linspace(1, 0.7, 301)
    others = {"confidence": confidence, "right": np.uint8(confidence > 0.8499), "model": np.arange(301) % 10}
    path = tmp_path / "reliability.safetensors"
    save_file(others | {"weight": np.full(301, 1 / 301)}, path)
    monkeypatch.setattr(learning, "RELIABILITY_FILE", path)
    own, mesh, weight = np.linspace(0.99, 0.72, 9), np.arange(9) % 3, np.ones(9)
    right = np.ones(9, bool)
    assert lowest_threshold(own, right, weight, mesh) == 1.0
    assert 0.8 < pooled_threshold(own, right, weight, mesh) <= 0.85
    assert 0.85 < pooled_threshold(own, own > 0.86, weight, mesh) < 0.9, "below .86 the own ones are wrong"
    assert pooled_threshold(own, ~right, weight, mesh) == 1.0, "whatever others are"


def test_other_classes_views_are_right_as_often_as_their_confidence_says() -> None:
    """The packaged file's weights are shares of all views; it holds those from `MIN_THRESHOLD` on."""
    others = load_file(learning.RELIABILITY_FILE)
    assert others["confidence"].min() >= MIN_THRESHOLD and others["weight"].sum() < 1
    stated, right = (np.average(others[name], weights=others["weight"]) for name in ("confidence", "right"))
    assert stated == pytest.approx(right, abs=0.03)


def test_a_worse_fit_is_never_trusted_more() -> None:
    rng = np.random.default_rng(2)
    features = rng.normal(size=(2000, len(CONFIDENCE_FEATURES)))
    right = rng.random(2000) < 1 / (1 + np.exp(-3 * features[:, CONFIDENCE_FEATURES.index("log_residual")]))
    weights, _ = logistic(features, right, np.full(2000, 1 / 2000))
    assert weights[CONFIDENCE_FEATURES.index("log_residual")] == 0


def test_what_is_trusted_is_as_often_right_as_was_asked(
    samples: CalibrationSamples, learned: FitCalibration
) -> None:
    confidence = np.array([learned.confidence(row) for row in samples.features])
    trusted = confidence >= learned.threshold
    assert 0.3 < trusted.mean() < 0.8
    assert samples.right[trusted].mean() == pytest.approx(PRECISION, abs=0.01)
    assert "are right" in describe(learned, samples)[0]


def test_nine_in_ten_intervals_hold_in_either_group(
    samples: CalibrationSamples, learned: FitCalibration
) -> None:
    confidence = np.array([learned.confidence(row) for row in samples.features])
    for trusted in (True, False):
        group = (confidence >= learned.threshold) == trusted
        pairs = zip(samples.deviation[group], samples.features[group], strict=True)
        wide = np.stack([learned.widen_deviations(*pair, trusted) for pair in pairs])
        held = np.abs(samples.error[group]) <= 1.6449 * wide
        assert held.mean(0) == pytest.approx(0.9, abs=0.02)


def test_a_floor_is_found_where_small_deviations_mean_nothing() -> None:
    rng = np.random.default_rng(1)
    deviation = 10 ** rng.uniform(-4, 0, 4000)
    error = rng.normal(size=4000) * np.hypot(deviation, 0.5)
    scale, floor = deviation_scale_and_floor(error, deviation, ALIKE)
    assert 0.3 < floor < 0.7
    held = np.abs(error) <= 1.6449 * np.hypot(scale * deviation, floor)
    assert held.mean() == pytest.approx(0.9, abs=0.005)
    small = deviation < 0.01
    assert held[small].mean() == pytest.approx(0.9, abs=0.05)


def test_intervals_hold_on_other_meshes_than_they_were_learned_on() -> None:
    """Errors of one mesh are alike: with six of them nine tenths of these fits are less of others."""
    held = {}
    for by_mesh in (False, True):
        shares = []
        for seed in range(40):
            rng = np.random.default_rng(seed)
            offset = rng.normal(size=200)
            mesh = np.repeat(np.arange(6), 100)
            error = offset[mesh] + 0.3 * rng.normal(size=len(mesh))
            ones = np.ones(len(mesh))
            scale, floor = deviation_scale_and_floor(error, ones, ones, mesh if by_mesh else None)
            other = offset[6:] + 0.3 * rng.normal(size=194)
            shares.append((np.abs(other) <= 1.6449 * np.hypot(scale, floor)).mean())
        held[by_mesh] = float(np.mean(shares))
    assert held[False] < 0.885
    assert 0.9 < held[True] < 0.97


def test_nothing_is_trusted_when_nothing_is_right_often_enough() -> None:
    right = np.zeros(100, dtype=bool)
    assert lowest_threshold(np.linspace(0, 0.9, 100), right, np.ones(100)) == 1.0
    assert lowest_threshold(np.linspace(0, 0.9, 1000), np.ones(1000, bool), np.ones(1000)) == MIN_THRESHOLD


def test_what_is_wrong_of_one_mesh_weighs_more_than_what_is_wrong_here_and_there() -> None:
    """Nine of twelve meshes' 300 fits are wrong: of one mesh, another mesh may be like it."""
    confidence, mesh, weight = np.linspace(1, 0.7, 300), np.arange(300) % 12, np.ones(300)
    scattered = np.ones(300, bool)
    scattered[7::35] = False
    of_one = np.ones(300, bool)
    of_one[np.arange(3, 300, 12)[::3]] = False
    assert (~scattered).sum() == (~of_one).sum()
    assert lowest_threshold(confidence, scattered, weight, mesh) == pytest.approx(0.7)
    assert lowest_threshold(confidence, of_one, weight, mesh) > 0.8
    assert lowest_threshold(confidence, of_one, weight) == pytest.approx(0.7)
    one = lowest_threshold(confidence, scattered, weight, np.zeros(300, int))
    independent = lowest_threshold(confidence, scattered, weight)
    assert one == independent, "of a single mesh nothing is known of others"


@pytest.mark.parametrize("count", [1, 5, 18])
def test_a_few_right_fits_prove_nothing(count: int) -> None:
    confidence, right = np.linspace(1, 0.5, 100), np.arange(100) < count
    assert lowest_threshold(confidence, right, np.ones(100), np.arange(100) % 3) == 1.0
    many = np.arange(100) < 40
    assert lowest_threshold(confidence, many, np.ones(100), np.arange(100) % 3) < 0.82


def test_all_fits_of_a_mesh_are_in_one_fold_where_there_are_enough_meshes() -> None:
    photo = np.arange(60) % FOLDS
    model = np.arange(60) % 7
    fold = _by_mesh(model, photo)
    assert [len(set(fold[model == mesh])) for mesh in range(7)] == [1] * 7 and len(set(fold)) == 7
    few = np.arange(60) % 4
    assert (_by_mesh(few, photo) == photo).all()
    mixed = np.concatenate([model, -1 - np.arange(60)])  # beside the photos of a dataset
    assert (_by_mesh(mixed, np.tile(photo, 2))[60:] == photo).all()


def test_positions_are_calibrated_so_that_nine_in_ten_lie_within(
    learned: FitCalibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Truths drawn about one explanation's position, by other deviations where it is not trusted."""
    photo = example_photos()[1].photo
    explanation = vig.Explainer("teapot").explain(photo, focal=400.0)
    certain = {
        name: np.zeros_like(getattr(explanation.fit, name)) for name in ("deviation", "framing_deviation")
    }
    explanation = replace(explanation, fit=replace(explanation.fit, **certain))
    pose, drawn = explanation.pinhole_pose()[1], np.array([[0.02, 0.04, 0.06], [0.05, 0.03, 0.2]])
    rng, posed = np.random.default_rng(0), []
    for number in range(240):
        row, true = number % 2, pose.copy()
        off = rng.standard_normal(3) * drawn[row] * explanation.position_units
        true[:3, 3] += sight_axes(pose) @ off
        verdict = Verdict.AMBIGUOUS if row else Verdict.TRUSTED
        posed.append((replace(explanation, fit=replace(explanation.fit, verdict=verdict)), true))
    monkeypatch.setattr("vig_train.calibration.positions._explained_photos", lambda *given: iter(posed))
    photographs = SimpleNamespace(world="photo", first=lambda count: None)
    monkeypatch.setattr("vig_train.calibration.positions.Dataset", SimpleNamespace)
    network = SimpleNamespace(informed=True)
    calibration = calibrate_positions(learned, [photographs], explanation.object_class, network)
    np.testing.assert_allclose(calibration.position, drawn, rtol=0.2)
    assert np.array_equal(calibrate_positions(learned, [], None, None).position, learned.position)


def test_a_calibration_is_read_as_it_was_written(learned: FitCalibration, tmp_path: Path) -> None:
    learned.save(tmp_path / "calibration.json")
    read = FitCalibration.load(tmp_path / "calibration.json")
    assert read.threshold == learned.threshold and np.array_equal(read.scale, learned.scale)
    assert np.array_equal(read.view_weights, learned.view_weights) and read.to_json() == learned.to_json()


def test_a_calibration_of_an_older_format_is_told(learned: FitCalibration, tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(learned.to_json().replace('"format": 7', '"format": 6'))
    with pytest.raises(UserError, match="it is of format 6, where this vig reads 7.* Make it again"):
        FitCalibration.load(path)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"features": ["lead"]}'])
def test_a_calibration_of_no_use_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "calibration.json").write_text(text)
    with pytest.raises(UserError, match="expected a calibration at"):
        FitCalibration.load(tmp_path / "calibration.json")


def test_photos_are_rolled_but_those_from_above() -> None:
    """From above a rolled photo is a photo of another azimuth, and nothing is wrong with it."""
    latents = np.zeros((9, 24), np.float32)
    latents[[0, 4], 11] = math.radians(80)
    assert photos_to_roll(cast(Dataset, SimpleNamespace(latents=latents))).tolist() == [1, 3, 6, 8]


def test_a_rolled_photo_is_the_photo_turned_by_a_good_angle_about_its_centre() -> None:
    y, x = np.mgrid[:61, :61] - 30.0
    spot = np.exp(-((x - 12) ** 2 + y**2) / 8)  # at the right, 12 pixels from the centre
    images = np.repeat((255 * spot).astype(np.uint8)[None, :, :, None], 40, 0).repeat(3, 3)
    found = roll_photos(images, roll_angles(40))
    assert found.shape == images.shape and found.dtype == np.uint8
    mass = found[..., 0].astype(float)
    to = np.degrees(np.arctan2((mass * y).sum((1, 2)), (mass * x).sum((1, 2))))
    away = np.hypot((mass * y).sum((1, 2)), (mass * x).sum((1, 2))) / mass.sum((1, 2))
    np.testing.assert_allclose(away, 12, atol=0.3)
    assert (np.abs(to) > 19).all()
    assert np.histogram(to % 360, bins=8, range=(0, 360))[0].min() >= 2, "all round"


def test_a_rolled_photo_is_in_the_fold_of_the_photo_it_was(samples: CalibrationSamples) -> None:
    given = with_others(samples, off=1.0)
    left = given.without(2)
    assert set(left.fold) == set(left.out_of_distribution_fold) == set(range(FOLDS)) - {2}
    assert len(left.out_of_distribution) == 950 and len(left.features) == len(left.weight) == 3800


def hand_made(azimuth_off: np.ndarray) -> tuple[Fits, Dataset, np.ndarray]:
    """Fits that are off in azimuth by so many degrees, round the circle, and by 0.1 in all else."""
    count = len(azimuth_off)
    truth = np.zeros((count, 24), np.float32)
    truth[:, 10] = np.radians(np.where(azimuth_off > 0, 359, 1))  # so that errors cross north
    found = truth + np.float32(0.1)
    found[:, 10] = np.remainder(truth[:, 10] + np.radians(azimuth_off), 2 * np.pi)
    masks = np.zeros((count, 2, 2), bool)
    features = np.arange(count * len(CONFIDENCE_FEATURES), dtype=np.float64).reshape(count, -1)
    fits = Fits(
        found, np.full((count, 24), 0.2), masks, masks, features, np.ones(count), ("trusted",) * count
    )
    return fits, cast(Dataset, SimpleNamespace(latents=truth)), masks


def test_a_view_is_right_within_15_degrees_and_errors_go_round_the_circle() -> None:
    off = np.array([0.0, 14.5, -14.5, 15.5, -15.5, 59.0, 180.0])
    fits, dataset, seen = hand_made(off)
    seen = seen.copy()
    seen[:2, 0] = fits.masks[:2, 0] = True
    fits.masks[1, 0, 1] = False  # an intersection over union of a half
    learned = samples_of(fits, dataset, seen, np.array([2, 6]), fits.confidence_features[:2])
    assert learned.mask_right.tolist() == [True, False, True, True, True, True, True]
    assert learned.right.tolist() == [True] * 3 + [False] * 4
    np.testing.assert_allclose(np.abs(np.degrees(learned.error[:, 10])), np.abs(off), atol=1e-3)
    np.testing.assert_allclose(np.delete(learned.error, 10, 1), 0.1, atol=1e-6)
    np.testing.assert_array_equal(learned.features, fits.confidence_features)
    np.testing.assert_array_equal(learned.deviation, fits.deviation)
    assert learned.weight.sum() == pytest.approx(1), "a dataset counts alike whatever its size"
    assert learned.fold.tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert learned.out_of_distribution_fold.tolist() == [2, 6], "that of the photo that was rolled"


def test_a_view_that_looks_the_same_is_right_and_its_light_too() -> None:
    off = np.array([0.0, 179.0, 165.5, 80.0])
    fits, dataset, seen = hand_made(off)
    light = slice(15, 24)
    dataset.latents[:, light] = np.arange(9)
    fits.latents[:, light] = np.arange(9)
    fits.latents[1:3, light] *= [1, -1, 1, -1, 1, -1, 1, -1, 1]  # half a turn of it, by the odd orders
    none = np.array([], int)
    half = samples_of(fits, dataset, seen, none, fits.confidence_features[:0], Symmetry.HALF_TURN)
    assert half.right.tolist() == [True, True, True, False]
    np.testing.assert_allclose(np.degrees(half.error[:, 10]), [0, -1, -14.5, 80], atol=1e-3)
    np.testing.assert_allclose(half.error[1, light], 0, atol=1e-5)
    any_turn = samples_of(fits, dataset, seen, none, fits.confidence_features[:0], Symmetry.ANY_TURN)
    assert any_turn.right.all() and not any_turn.error[:, 10].any()


def test_where_azimuth_means_nothing_elevation_makes_a_view_right() -> None:
    fits, dataset, seen = hand_made(np.zeros(2))
    fits.latents[1, 11] = np.radians(16)
    outside = np.array([], int), fits.confidence_features[:0]
    found = samples_of(fits, dataset, seen, *outside, Symmetry.ANY_TURN)
    assert found.right.tolist() == [True, False]


def test_nothing_is_learned_from_a_fit_for_the_confidence_in_itself(samples: CalibrationSamples) -> None:
    """Were a fold's fits all wrong, confidence in those of the other folds would fall, in its own not."""
    some = CalibrationSamples(
        **{name: array[:400] for name, array in vars(with_others(samples, off=1.0)).items()}
    )
    here = some.fold == 1
    wrong = replace(some, right=some.right & ~here)
    wrong = replace(wrong, mask_right=wrong.mask_right & ~here)
    (before, mask_before, strange_before), (after, mask_after, strange_after) = map(
        out_of_fold, (some, wrong)
    )
    np.testing.assert_array_equal(before[here], after[here])
    np.testing.assert_array_equal(mask_before[here], mask_after[here])
    assert (np.abs(mask_before - mask_after)[~here] > 1e-3).mean() > 0.9
    np.testing.assert_array_equal(
        strange_before[some.out_of_distribution_fold == 1], strange_after[some.out_of_distribution_fold == 1]
    )
    assert (np.abs(before - after)[~here] > 1e-3).mean() > 0.9


def test_what_the_photo_looks_like_says_nothing_of_the_view(learned: FitCalibration) -> None:
    weights = dict(zip(CONFIDENCE_FEATURES, learned.view_weights.tolist(), strict=True))
    assert weights["log_residual"] == weights["mask_log_probability"] == 0.0
    assert weights["evidence_gap"] > 0.0 and learned.mask_weights.any()


def test_each_fold_of_meshes_has_photos_of_its_own() -> None:
    car = ObjectClass.load("car")
    draws = [StudioPhotos.draw(car, "train", 6, 3, (fold, 4), things="test")[0] for fold in range(2)]
    azimuth = np.concatenate([photos.latents[:, -14] for photos in draws])
    assert len(np.unique(azimuth)) == len(azimuth) > 4
    assert set(draws[0].model % 4) == {0} and set(draws[1].model % 4) == {1}
    again, _ = StudioPhotos.draw(car, "train", 6, 3, (0, 4), things="validation")
    place = {float(row[-14]): number for number, row in enumerate(again.latents)}
    shared = [
        (n, place[float(row[-14])]) for n, row in enumerate(draws[0].latents) if float(row[-14]) in place
    ]
    assert any((draws[0].images[n] != again.images[m]).any() for n, m in shared), "other things"
    assert AS_USERS_TAKE_THEM.rolled == 0.0


def test_the_threshold_is_learned_out_of_sample(samples: CalibrationSamples) -> None:
    """200 fits whose features say nothing: in sample, six numbers find many that are all right."""
    rng = np.random.default_rng(2)
    features = rng.normal(size=(200, len(CONFIDENCE_FEATURES)))
    some = {name: array[:200] for name, array in vars(samples).items()}
    none = CalibrationSamples(
        **some | {"features": features, "right": rng.random(200) < 0.93, "out_of_distribution": features[:0]}
    )
    learned = learn(none)
    in_sample = np.array([learned.confidence(row) for row in features])
    assert learned.threshold == lowest_threshold(out_of_fold(none)[0], none.right, none.weight)
    assert learned.threshold != lowest_threshold(in_sample, none.right, none.weight)


@pytest.fixture(scope="module")
def boastful() -> FitCalibration:
    """What says of each fit that it is surely right, and widens all deviations to 7 times the residual."""
    nothing = np.zeros(len(CONFIDENCE_FEATURES))
    scale = np.zeros((2, 24))
    surely = (nothing, 9.0) * 3
    return FitCalibration(*surely, 0.0, 0.0, scale, np.full_like(scale, 7.0))


def test_fits_are_calibrated_from_what_they_say_uncalibrated(
    dataset: Dataset, weights: Path, teapot: ObjectClass, quick: ExplainSettings, boastful, tmp_path: Path
) -> None:
    recognizer, told = Recognizer(weights), list[int]()
    given = replace(quick, calibration=boastful)
    two = [dataset, dataset.first(2)]

    def made() -> tuple[FitCalibration, CalibrationSamples]:
        return calibrate_fits(two, recognizer, FitRun(teapot, 1, told.append, tmp_path), given)

    learned, found = made()
    assert sum(told) == sum(map(fit_count, two)) and fit_count(dataset) == 4 + len(photos_to_roll(dataset))
    photos = linear_from_srgb(dataset.images.astype(np.float32) / 255)
    said = recognizer(photos)
    evidence = replace(quick, calibrated=False, widened=False)
    plain = [explain_one(photos[i], said[i : i + 1], teapot, evidence) for i in range(4)]
    twice = [*plain, *plain[:2]]  # both datasets, one after the other
    np.testing.assert_allclose(found.deviation, np.stack([fit.deviation for fit in twice]), rtol=1e-5)
    # These are what a calibration widens: one that does nothing leaves them, in units of the residual.
    idle = replace(learned, scale=np.ones_like(learned.scale), floor=np.zeros_like(learned.floor))
    fit = explain_one(photos[0], said[:1], teapot, replace(quick, calibration=idle))
    others = np.arange(found.deviation.shape[1]) != 10  # azimuth's is of all views
    expected = float(residual(fit.confidence_features)) * found.deviation[0]
    np.testing.assert_allclose(
        fit.deviation[others], expected[others].clip(MIN_DEVIATION), rtol=1e-4, atol=1e-9
    )
    assert (expected[others] > MIN_DEVIATION).any()
    np.testing.assert_allclose(
        found.features, np.stack([fit.confidence_features for fit in twice]), rtol=1e-5
    )
    np.testing.assert_allclose(found.weight, [1 / 4] * 4 + [1 / 2] * 2)
    truth = np.concatenate([dataset.latents, dataset.latents[:2]])
    off = np.stack([fit.latents.to_vector()[0] for fit in twice])[:, 10] - truth[:, 10]
    assert found.right.tolist() == (np.abs(np.degrees((off + np.pi) % (2 * np.pi) - np.pi)) < 15).tolist()
    origin = np.concatenate([photos_to_roll(each) for each in two])
    assert len(found.out_of_distribution) == len(origin) > 0
    np.testing.assert_array_equal(found.out_of_distribution_fold, origin % FOLDS)
    first = photos_to_roll(dataset)[:1]
    turned = roll_photos(dataset.images[first], roll_angles(len(photos_to_roll(dataset)))[:1])
    turned_photo = linear_from_srgb(turned.astype(np.float32) / 255)
    fit = explain_one(turned_photo[0], recognizer(turned_photo), teapot, replace(quick, calibrated=False))
    np.testing.assert_allclose(found.out_of_distribution[0], fit.confidence_features, rtol=1e-4, atol=1e-6)
    again, _ = made()  # from the fits that were kept
    assert again.to_json() == learned.to_json()
    assert len(list(tmp_path.iterdir())) == 4, "photos and rolled photos of either dataset"


def run(capsys, *arguments: object) -> tuple[int, str, str]:
    return run_vig("calibrate", "--class", TEAPOT, *arguments), *capsys.readouterr()


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory, teapot: ObjectClass) -> Path:
    """A dataset's folder: four images of the validation split."""
    out = tmp_path_factory.mktemp("calibrated") / "d"
    return make_dataset(
        out, 4, 3, split="validation", workers=1, progress=False, object_class=teapot, world="paper"
    )


@pytest.mark.parametrize("studio", [0, 75])
def test_the_command_calibrates_weights_in_place_and_writes_what_was_learned_of_fits(
    capsys, studio: int, photos: Path, untrained, tmp_path: Path
) -> None:
    """52 photos, as 13 times the same four, whose fits are made once; or the studio's alone, some without."""
    weights = untrained(tmp_path / "recognition.safetensors")
    before, datasets = Recognizer(weights), [] if studio else [photos] * 13
    code, printed, _ = run(capsys, *datasets, "--weights", weights, "--workers", 1, "--studio", studio)
    assert code == 0
    after = Recognizer(weights)
    assert not np.array_equal(before.calibration.deviation, after.calibration.deviation)
    assert np.array_equal(before.weights["azimuth.weight"], after.weights["azimuth.weight"])
    learned = FitCalibration.load(tmp_path / "calibration.json")
    assert learned.scale.shape == (2, 24) and np.isfinite(learned.scale).all()
    assert {path.name for path in tmp_path.iterdir()} == {
        "recognition.safetensors",
        "calibration.json",
        "reliability.png",
    }
    lines = printed.splitlines()
    count = int(lines[1].split()[0])
    assert lines[0].startswith(f"calibrated on {count} images") and lines[1].startswith(f"{count} fits, ")
    assert 30 < count < studio if studio else count == 52
    assert lines[-1] == str(tmp_path)


@pytest.mark.parametrize("wrong", ["none", "split", "weights", "workers", "studio", "seed", "class", "modes"])
def test_mistakes_are_told_before_any_work(
    capsys, wrong: str, photos: Path, untrained, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("mine")
    weights = untrained(tmp_path / "recognition.safetensors")
    kept = weights.read_bytes()
    arguments, said = {
        "none": (["--weights", weights, "--studio", 0], "expected a dataset or --studio above 0"),
        "split": (
            [photos, "--split", "train", "--weights", weights],
            "has no train split; it has validation",
        ),
        "weights": ([photos, "--weights", tmp_path / "file"], "expected recognition weights"),
        "workers": ([photos, "--weights", weights, "--workers", 0], "--workers of at least 1"),
        "studio": ([photos, "--weights", weights, "--studio", -5], "--studio of at least 0; got -5"),
        "seed": ([photos, "--weights", weights, "--seed", -1], "--seed of at least 0; got -1"),
        "class": ([photos, "--weights", weights, "--class", "car"], "dataset of class 'car' with 15"),
        "modes": ([photos, "--weights", untrained(tmp_path / "w", modes=4)], "10 shape components"),
    }[wrong]
    code, printed, error = run(capsys, *arguments)
    assert code == 2 and printed == "" and said in " ".join(error.split())
    assert weights.read_bytes() == kept and not (tmp_path / "calibration.json").exists()
