"""Fits kept on disk: taken from there when nothing changed, made again when anything did."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file

from tests.nodes import needs_ray, two_nodes
from tests.support import run_vig
from vig.inference import ExplainSettings, FitCalibration
from vig.inference.calibration import CONFIDENCE_FEATURES
from vig.recognition import Recognizer
from vig.scene import ObjectClass
from vig_train.evaluation import fits
from vig_train.evaluation.protocol import evaluate
from vig_world.dataset import Dataset
from vig_world.generation.write import make_dataset

Run = Callable[..., int]


@pytest.fixture()
def run(
    dataset: Dataset, weights: Path, teapot: ObjectClass, quick: ExplainSettings, tmp_path: Path, monkeypatch
) -> Iterator[Run]:
    """Evaluates "robust" with a cache of two fits to a file; returns how many were really fitted."""
    fitted: list[int] = []
    real = fits.explain_one

    def counted(*given):
        fitted.append(1)
        return real(*given)

    monkeypatch.setattr(fits, "explain_one", counted)
    monkeypatch.setattr(fits, "CHUNK_PHOTOS", 2)

    def evaluated(data=dataset, path=weights, settings=quick, object_class=teapot) -> int:
        before, told = len(fitted), []
        fit_run = fits.FitRun(object_class, 1, told.append, tmp_path)
        evaluated.found = evaluate(data, Recognizer(path), fit_run, ("robust",), settings)["robust"]
        assert sum(told) == len(data)
        return len(fitted) - before

    yield evaluated


def test_nothing_is_fitted_twice_and_the_answer_is_the_same(run, tmp_path: Path) -> None:
    assert run() == 4
    first = run.found
    assert {path.name for path in (tmp_path / "spatial").iterdir()} == {
        "000000.safetensors",
        "000002.safetensors",
    }
    assert run() == 0
    np.testing.assert_array_equal(run.found.latents.to_vector(), first.latents.to_vector())
    np.testing.assert_array_equal(run.found.deviation, first.deviation)
    np.testing.assert_array_equal(run.found.masks, first.masks)
    assert run.found.verdicts == first.verdicts and run.found.masks.any()


def test_a_chunk_that_is_lost_or_damaged_is_fitted_again(run, tmp_path: Path) -> None:
    run()
    (tmp_path / "spatial" / "000000.safetensors").unlink()
    assert run() == 2
    whole = (tmp_path / "spatial" / "000002.safetensors").read_bytes()
    (tmp_path / "spatial" / "000002.safetensors").write_bytes(whole[: len(whole) // 2])
    assert run() == 2
    (tmp_path / "spatial" / "000002.safetensors").write_text("none of ours")
    assert run() == 2


@pytest.mark.parametrize("what", ["settings", "weights", "class", "light", "calibration"])
def test_fits_of_something_else_are_not_taken(
    run, what: str, quick: ExplainSettings, untrained, teapot: ObjectClass, tmp_path: Path
) -> None:
    run()
    features = np.ones(len(CONFIDENCE_FEATURES))
    certain = (features, 9.0) * 3
    boastful = FitCalibration(*certain, 0.0, 0.0, np.ones((2, 24)), np.zeros((2, 24)))
    larger = replace(teapot.shape_model, mean=teapot.shape_model.mean * np.float32(1.01))
    other = {
        "settings": lambda: {"settings": replace(quick, view_weight=299.0)},
        "calibration": lambda: {"settings": replace(quick, calibration=boastful)},
        "weights": lambda: {"path": untrained(tmp_path / "w", seed=1)},
        "class": lambda: {"object_class": replace(teapot, shape_model=larger)},
        "light": lambda: {"object_class": replace(teapot, light_prior_mean=teapot.light_prior_mean * 1.01)},
    }[what]()
    assert run(**other) == 4
    assert run(**other) == 0
    assert run() == 4


def test_other_photos_are_fitted_again_where_they_differ(run, dataset: Dataset) -> None:
    run()
    some = {name: getattr(dataset, name)[:3] for name in ("latents", "occlusion", "design", "cause")}
    assert run(replace(dataset, **some)) == 1  # the first file holds the first two of both
    darker = replace(dataset)
    images = dataset.images.copy()
    images[0] //= 2
    darker.__dict__["images"] = images
    run()
    assert run(darker) == 2


@needs_ray
@pytest.mark.slow
def test_an_evaluation_on_a_cluster_one_of_whose_nodes_is_killed_has_the_same_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two nodes on this machine; one dies when a chunk of two fits is there. The rest is resumed here."""
    monkeypatch.setattr(fits, "CHUNK_PHOTOS", 2)
    data, out, here = tmp_path / "data", tmp_path / "out", tmp_path / "here"
    make_dataset(data, 16, 5, split="test", workers=1, progress=False)
    command = ["evaluate", "--dataset", str(data), "--methods", "robust", "gaussian", "--workers", "1"]
    with two_nodes(lambda: len(list(out.glob("fits/*/*.safetensors"))), after=1) as (address, killed):
        assert run_vig(*command, "--out", out, "--cluster", address) == 0
    assert killed and killed[0] < 8
    assert run_vig(*command, "--out", here) == 0
    names = sorted(str(path.relative_to(here)) for path in here.rglob("*") if path.is_file())
    assert len([name for name in names if name.startswith("fits")]) == 16
    assert names == sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())
    for name in names:
        if name.endswith(".safetensors"):  # which holds its metadata in any order
            one, other = load_file(out / name), load_file(here / name)
            assert one.keys() == other.keys()
            for key in one:  # NaN stands for unknown
                np.testing.assert_array_equal(one[key], other[key])
        else:
            assert (out / name).read_bytes() == (here / name).read_bytes()
    for number in ("000004", "000010"):
        (out / "fits" / "spatial" / f"{number}.safetensors").unlink()
    before = (out / "fits" / "spatial" / "000000.safetensors").stat().st_mtime_ns
    assert run_vig(*command, "--out", out) == 0
    assert (out / "fits" / "spatial" / "000000.safetensors").stat().st_mtime_ns == before
    assert (out / "errors.csv").read_bytes() == (here / "errors.csv").read_bytes()
