"""Methods run over a small dataset with a network that has learned nothing."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support import TEAPOT, run_vig
from vig.inference import ExplainSettings, explain_one
from vig.io.errors import UserError
from vig.likelihood import GAUSSIAN, SPATIAL
from vig.recognition import Recognizer
from vig.scene import Latents, ObjectClass, linear_from_srgb
from vig_paper.figures.style import render_explanations
from vig_train import METHODS
from vig_train.evaluation.fits import FitRun
from vig_train.evaluation.protocol import MASK_HEAD, evaluate, silhouettes
from vig_train.evaluation.results import write_csv
from vig_world.assets.target import target_vertices
from vig_world.dataset import Dataset

COUNT = 4
PAPER = {"azimuth_deg", "elevation_deg", "appearance", "illumination", "shape_mm"}
ANSWERS = (*METHODS[:2], MASK_HEAD, *METHODS[2:])


def test_every_method_answers_every_image(results) -> None:
    assert tuple(results) == ANSWERS
    assert set(results[MASK_HEAD].errors) == {"segmentation_iou"}
    for method, result in results.items():
        if method == MASK_HEAD:
            continue
        assert set(result.errors) == PAPER | (set() if method == "baseline" else {"segmentation_iou"})
        assert len(result.verdicts) == COUNT
        assert len(result.latents) == COUNT
        assert (result.deviation is None) == (result.masks is None) == (method == "baseline")
        if result.deviation is not None:
            assert result.deviation.shape == (COUNT, 24) and (result.deviation >= 0).all()
            assert result.masks.shape == (COUNT, 150, 150) and result.masks.dtype == bool
        for values in result.errors.values():
            assert values.shape == (COUNT,) and np.isfinite(values).all() and (values >= 0).all()
        fits = method in ("gaussian", "robust", "spatial")
        assert all(
            (name in ("trusted", "reverted", "ambiguous", "failed")) == fits for name in result.verdicts
        )


def test_the_baseline_stands_at_azimuth_zero_and_the_mean_shape(
    results, dataset: Dataset, teapot: ObjectClass
) -> None:
    degrees = np.degrees(dataset.latents[:, 10])
    np.testing.assert_allclose(
        results["baseline"].errors["azimuth_deg"], np.abs((degrees + 180) % 360 - 180), atol=1e-3
    )
    truth = np.stack([target_vertices(spec, teapot) for spec in dataset.specs()])
    offset = truth - teapot.shape_model.mean
    np.testing.assert_allclose(
        results["baseline"].errors["shape_mm"], 1000 * np.linalg.norm(offset, axis=-1).mean(1), rtol=1e-3
    )


def test_the_baseline_is_the_middle_of_what_training_draws(results, teapot: ObjectClass) -> None:
    """Elevation is uniform up to 90 degrees, albedo from 0.2 to 0.8; light is the prior's mean, exposed."""
    said = results["baseline"].latents
    np.testing.assert_allclose(said.elevation, math.pi / 4)
    np.testing.assert_allclose(said.albedo, np.full((COUNT, 3), 0.5))
    assert not said.azimuth.any() and not said.shape.any()
    mean = teapot.light_prior_mean
    np.testing.assert_allclose(said.light, np.tile(mean / mean[0] * 0.75 * math.pi, (COUNT, 1)), rtol=1e-5)


def test_images_are_not_mixed_up_by_threads(
    results, dataset: Dataset, weights: Path, teapot: ObjectClass, quick: ExplainSettings
) -> None:
    alone = evaluate(dataset, Recognizer(weights), FitRun(teapot, 1), ("robust",), quick)["robust"]
    for metric, values in results["robust"].errors.items():
        np.testing.assert_array_equal(alone.errors[metric], values)
    assert alone.verdicts == results["robust"].verdicts


@pytest.mark.slow
def test_processes_fit_as_threads_do(
    results,
    dataset: Dataset,
    weights: Path,
    teapot: ObjectClass,
    quick: ExplainSettings,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("vig_train.evaluation.fits.MIN_PHOTOS_FOR_PROCESSES", 2)
    run = FitRun(teapot, 2, processes=True)
    apart = evaluate(dataset, Recognizer(weights), run, ("robust",), quick)
    for metric, values in results["robust"].errors.items():
        np.testing.assert_array_equal(apart["robust"].errors[metric], values)
    assert apart["robust"].verdicts == results["robust"].verdicts


def test_silhouettes_of_the_truth_are_nearly_the_datasets_masks(
    dataset: Dataset, teapot: ObjectClass
) -> None:
    """Nearly: the objects of the test split are held-out designs, which no latents quite reach."""
    truth = Latents.from_vector(dataset.latents)
    masks = silhouettes(truth, teapot)
    assert masks.dtype == bool and masks.shape == (COUNT, 150, 150)
    union = (masks | dataset.amodal).sum((1, 2))
    assert ((masks & dataset.amodal).sum((1, 2)) / union > 0.93).all()


def test_a_silhouette_is_as_large_as_what_is_covered(dataset: Dataset, teapot: ObjectClass) -> None:
    """A pixel counts from half coverage on, so that as much is added at edges as is left out."""
    truth = Latents.from_vector(dataset.latents)
    coverage = render_explanations(truth, teapot)[1]
    area, covered = silhouettes(truth, teapot).sum((1, 2)), coverage.sum((1, 2))
    np.testing.assert_allclose(area, covered, rtol=0.003)
    edge = ((coverage > 0.05) & (coverage < 0.95)).sum((1, 2))
    assert (edge > 0.03 * covered).all(), "or any threshold would do"


def test_masks_are_measured_against_what_is_seen_of_the_object(results, dataset: Dataset) -> None:
    """Not against the whole object: |A and B| / |A or B|, pixel by pixel."""
    hidden = (dataset.amodal & ~dataset.visible).sum((1, 2))
    assert (hidden > 50).any(), "or nothing is tested"
    measured = [method for method in ANSWERS if method != "baseline"]
    for method in measured:
        masks = results[method].masks
        for image in range(COUNT):
            said, seen = set(np.flatnonzero(masks[image])), set(np.flatnonzero(dataset.visible[image]))
            share = len(said & seen) / len(said | seen)
            assert results[method].errors["segmentation_iou"][image] == pytest.approx(share)


def test_each_method_has_the_mask_of_its_own_pixel_model(
    results, dataset: Dataset, weights: Path, teapot: ObjectClass, quick: ExplainSettings
) -> None:
    """Robust: each pixel by itself; spatial: neighbours agree; gaussian and rm: the whole silhouette."""
    photos = linear_from_srgb(dataset.images.astype(np.float32) / 255)
    prediction = Recognizer(weights)(photos)
    differ = 0
    for image in range(COUNT):
        spatial, gaussian = (
            explain_one(
                photos[image], prediction[image : image + 1], teapot, replace(quick, likelihood=model)
            )
            for model in (SPATIAL, GAUSSIAN)
        )
        np.testing.assert_array_equal(results["robust"].masks[image], spatial.mask_by_pixel)
        np.testing.assert_array_equal(results["spatial"].masks[image], spatial.mask)
        np.testing.assert_array_equal(results["gaussian"].masks[image], gaussian.amodal)
        differ += not np.array_equal(spatial.mask_by_pixel, spatial.mask)
        differ += not np.array_equal(gaussian.amodal, gaussian.mask)
    assert differ >= 4, "or nothing is tested"
    np.testing.assert_array_equal(results["rm"].masks, silhouettes(prediction.best(), teapot))
    np.testing.assert_array_equal(results[MASK_HEAD].masks, prediction.mask.argmax(-1) == 0)


def test_the_csv_has_a_row_for_each_image_and_method(results, dataset: Dataset, tmp_path: Path) -> None:
    write_csv(tmp_path / "errors.csv", dataset, results)
    with open(tmp_path / "errors.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == COUNT * len(ANSWERS)
    pose = {f"{whose}_{angle}_deg" for whose in ("true", "estimated") for angle in ("azimuth", "elevation")}
    told = {"image", "occlusion", "cause", "method", "verdict"} | pose
    assert set(rows[0]) == told | PAPER | {"segmentation_iou"}
    for number, row in enumerate(rows):
        method, image = ANSWERS[number // COUNT], number % COUNT
        assert (row["method"], row["image"], row["cause"]) == (method, str(image), dataset.cause[image])
        assert float(row["occlusion"]) == pytest.approx(dataset.occlusion[image], abs=1e-4)
        if method == MASK_HEAD:
            assert row["azimuth_deg"] == row["estimated_azimuth_deg"] == ""
            continue
        error = results[method].errors["azimuth_deg"][image]
        assert float(row["azimuth_deg"]) == pytest.approx(error, rel=1e-5)
        turn = float(row["estimated_azimuth_deg"]) - float(row["true_azimuth_deg"])
        assert abs((turn + 180) % 360 - 180) == pytest.approx(error, abs=0.002)
        assert 0 <= float(row["estimated_azimuth_deg"]) < 360
        assert (row["segmentation_iou"] == "") == (method == "baseline")


@pytest.mark.parametrize(
    ("methods", "said"), [(("robust", "magic"), "got magic"), ((), "at least one method")]
)
def test_methods_that_do_not_exist_are_refused(
    methods, said: str, dataset: Dataset, weights: Path, teapot: ObjectClass
) -> None:
    with pytest.raises(UserError, match=said):
        evaluate(dataset, Recognizer(weights), FitRun(teapot), methods)


def test_a_dataset_of_another_class_is_refused(dataset: Dataset, weights: Path, teapot: ObjectClass) -> None:
    other = replace(dataset, latents=dataset.latents[:, 2:])
    with pytest.raises(UserError, match="with 10 shape components; .* has 8"):
        evaluate(other, Recognizer(weights), FitRun(teapot))


def run(capsys, *arguments: object) -> tuple[int, str, str]:
    return run_vig("evaluate", "--class", TEAPOT, *arguments), *capsys.readouterr()


def test_the_command_writes_its_files_and_prints_the_folder_last(
    capsys, made: Path, weights: Path, tmp_path: Path
) -> None:
    out = tmp_path / "r"
    arguments = ("--dataset", made, "--out", out, "--weights", weights, "--methods", "baseline", "rm")
    code, printed, errors = run(capsys, *arguments, "--max-occlusion", 1)
    assert code == 0 and printed.splitlines()[-1] == str(out)
    assert errors.splitlines()[-1].startswith(f"vig: measured: {out / 'table.md'} ")
    assert {path.name for path in out.iterdir()} == {"errors.csv", "table.json", "table.md"}
    table = json.loads((out / "table.json").read_text())
    assert table["count"] == COUNT and set(table["rows"]["azimuth_deg"]) == {"baseline", "rm"}
    assert set(table["rows"]) == PAPER | {"shape_ratio", "segmentation_iou"}
    lines = printed.splitlines()[:-1]
    assert max(map(len, lines)) <= 100 and len(lines) < 30, "Table 1 and the verdicts"
    printed_too = {"Table 1": True, "azimuth off by > 30": True}
    for said in (*printed_too, "predicted 90 % interval"):
        assert (said in printed) == printed_too.get(said, False)
        assert said in (out / "table.md").read_text().replace("<br>", " ")


def test_the_command_takes_some_images_and_says_it_in_json(
    capsys, made: Path, dataset: Dataset, weights: Path, tmp_path: Path
) -> None:
    least = float(np.sort(dataset.occlusion[:3])[0])
    arguments = (
        "--dataset",
        made,
        "--out",
        tmp_path / "r",
        "--weights",
        weights,
        "--methods",
        "rm",
        "--json",
    )
    limits = ("--limit", 3, "--min-occlusion", least, "--max-occlusion", 1)
    code, printed, _ = run(capsys, *arguments, *limits, "--json")
    table = json.loads(printed)
    assert code == 0 and table["count"] == 2 and table == json.loads((tmp_path / "r/table.json").read_text())


@pytest.mark.parametrize("wrong", ["occlusion", "range", "none", "limit", "out", "split", "weights", "modes"])
def test_mistakes_are_told_in_a_line_before_any_work(
    capsys, wrong: str, made: Path, weights: Path, untrained: Any, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("mine")
    given = {"--dataset": made, "--out": tmp_path / "r", "--weights": weights}
    extra, said = {
        "occlusion": ({"--max-occlusion": 75}, "--max-occlusion from 0 to 1; got 75"),
        "range": ({"--min-occlusion": 0.8}, "--min-occlusion below --max-occlusion; got 0.8 and 0.75"),
        "none": ({"--min-occlusion": 0.99, "--max-occlusion": 1}, "more than 99% and at most 100%"),
        "limit": ({"--limit": 0}, "expected --limit of at least 1; got 0"),
        "out": ({"--out": tmp_path / "file" / "r"}, "cannot write"),
        "split": ({"--split": "train"}, "has no train split; it has test"),
        "weights": ({"--weights": tmp_path / "file"}, "expected recognition weights"),
        "modes": ({"--weights": untrained(tmp_path / "w", modes=4)}, "10 shape components"),
    }[wrong]
    code, printed, error = run(capsys, *(word for pair in (given | extra).items() for word in pair))
    assert code == 2 and printed == "" and said in error and error.count("\n") == 1
    assert not (tmp_path / "r").exists() or not any((tmp_path / "r").iterdir())
