"""What each ablation switches off, and how a variant is compared with the default."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vig.inference import ExplainSettings, Stage
from vig.inference.settings import PICTURE
from vig.io.errors import UserError
from vig.likelihood import ROBUST, SPATIAL
from vig.recognition import Recognizer
from vig.scene import ObjectClass
from vig_paper import ablation
from vig_paper.ablation import ABLATIONS, DEFAULT, ablation_blocks, run_ablations, variants
from vig_train.evaluation.fits import FitRun
from vig_train.evaluation.presentation import markdown
from vig_train.evaluation.protocol import evaluate
from vig_world.dataset import Dataset

FITTED = ("silhouettes", "spatial", "hypotheses", "gd", "lbfgs")
WITH_SHADOW = ExplainSettings(self_shadow=True, stages=PICTURE["stages"])


def changed(name: str) -> dict[str, Any]:
    """The fields of the settings that an ablation changes."""
    other = variants(WITH_SHADOW, [name])[name]
    return {
        field.name: getattr(other, field.name)
        for field in fields(ExplainSettings)
        if field.compare and getattr(other, field.name) != getattr(WITH_SHADOW, field.name)
    }


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("silhouettes", {"silhouette": "paper"}),
        ("priors", {"recognition_weight": 0.0, "view_weight": 0.0, "prior_weight": 1.0}),
        ("prior-weight", {"prior_weight": 1.0}),
        ("spatial", {"likelihood": ROBUST}),
        ("annealing", {"stages": tuple(replace(stage, sigma=1.0) for stage in WITH_SHADOW.stages)}),
        ("hypotheses", {"stages": tuple(replace(stage, starts=1) for stage in WITH_SHADOW.stages)}),
        ("self-shadow", {"self_shadow": False}),
        ("mask-prior", {"mask_weight": 0.0}),
        ("surroundings", {"surroundings": 0.0}),
    ],
)
def test_an_ablation_switches_off_one_thing(name: str, expected: dict[str, Any]) -> None:
    assert changed(name) == expected


@pytest.mark.parametrize("name", ["cg", "cg-unscaled", "gd", "bfgs", "lbfgs", "dogleg"])
def test_an_optimiser_is_exchanged_with_the_same_starts_at_the_same_noise(name: str) -> None:
    assert set(changed(name)) <= {"optimizer", "stages"} and "optimizer" in changed(name)
    stages = variants(None, [name])[name].stages
    for stage, default in zip(stages, PICTURE["stages"], strict=True):
        assert (stage.starts, stage.sigma, stage.scale) == (default.starts, default.sigma, default.scale)
        assert stage.iterations >= default.iterations and stage.tolerance <= default.tolerance


def test_what_is_off_already_is_left_out_and_the_default_comes_first() -> None:
    assert list(variants(WITH_SHADOW)) == [DEFAULT, *ABLATIONS]
    assert "self-shadow" not in variants(replace(WITH_SHADOW, self_shadow=False))
    single = ExplainSettings(stages=(Stage(1, 4),), likelihood=ROBUST)
    assert not {"annealing", "hypotheses", "spatial"} & set(variants(single))


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(UserError, match=r"silhouettes, .* got magic$"):
        variants(names=["magic"])


@pytest.fixture(scope="module")
def table(
    dataset: Dataset,
    weights: Path,
    teapot: ObjectClass,
    quick: ExplainSettings,
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, Any]:
    """A few variants of a fit that hardly looks; the second run finds every fit in the cache."""
    cache, tables = tmp_path_factory.mktemp("ablated"), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ablation, "time_variants", lambda *given: dict.fromkeys(given[-1], 7.0))
        for _ in range(2):
            told: list[int] = []
            run = FitRun(teapot, 1, told.append, cache)
            tables.append(run_ablations(dataset, Recognizer(weights), run, FITTED, quick))
            assert sum(told) == len(dataset) * (1 + len(FITTED))
            written = {path: path.stat().st_mtime_ns for path in cache.rglob("*.safetensors")}
            patch.setattr("vig_train.evaluation.fits.explain_one", None)  # nothing may be fitted again
    assert tables[0] == tables[1] and len(written) == 1 + len(FITTED)
    return tables[0]


def test_every_variant_has_its_errors_failures_and_difference(
    table: dict[str, Any], dataset: Dataset, weights: Path, teapot: ObjectClass, quick: ExplainSettings
) -> None:
    assert table["count"] == len(dataset)
    assert table["max_occlusion"] == pytest.approx(dataset.occlusion.max())
    rows = table["variants"]
    assert list(rows) == [DEFAULT, *FITTED]
    paper = replace(quick, silhouette="paper")
    errors = [
        evaluate(dataset, Recognizer(weights), FitRun(teapot, 1), ("spatial",), settings)["spatial"].errors
        for settings in (quick, paper)
    ]
    for metric, found in rows["silhouettes"]["metrics"].items():
        assert found["median"] == np.median(errors[1][metric])
        test = rows["silhouettes"]["against_default"][metric]
        assert test["median_difference"] == np.median(errors[1][metric]) - np.median(errors[0][metric])
    assert rows["silhouettes"]["failure"]["count"] == (errors[1]["azimuth_deg"] > 30).sum()
    assert any(test["median_difference"] != 0 for test in rows["silhouettes"]["against_default"].values())
    assert "against_default" not in rows[DEFAULT]


def test_the_spatial_model_changes_nothing_but_the_mask(table: dict[str, Any]) -> None:
    assert SPATIAL.alpha == ROBUST.alpha and SPATIAL.sigma == ROBUST.sigma
    for metric, test in table["variants"]["spatial"]["against_default"].items():
        if metric != "segmentation_iou":
            assert test["median_difference"] == 0 and test["p"] == 1


def test_fits_are_timed_by_variant(
    dataset: Dataset, weights: Path, teapot: ObjectClass, quick: ExplainSettings
) -> None:
    """Twelve times the steps take longer than one does."""
    stages = {"short": (Stage(4, 1, tolerance=0.0),), "long": (Stage(4, 12, tolerance=0.0),)}
    chosen = {name: replace(quick, stages=given) for name, given in stages.items()}
    milliseconds = ablation.time_variants(dataset, teapot, Recognizer(weights), chosen, count=2)
    assert 0 < 1.5 * milliseconds["short"] < milliseconds["long"]


def test_the_markdown_has_a_row_for_each_variant_in_both_tables(table: dict[str, Any]) -> None:
    said = markdown(ablation_blocks(table))
    assert f"{table['count']} images" in said
    for name in FITTED:
        assert said.count(f"| {ABLATIONS[name].title} |") == 2
    assert said.count("| default |") == 1
    row = next(line for line in said.splitlines() if line.startswith("| default |"))
    median = table["variants"][DEFAULT]["metrics"]["azimuth_deg"]["median"]
    assert row.startswith(f"| default | {median:.3g} (") and row.endswith("| 7 |")
    alone = markdown(ablation_blocks({**table, "variants": {DEFAULT: table["variants"][DEFAULT]}}))
    assert alone.count("| default |") == 1 and "Less the default" not in alone
