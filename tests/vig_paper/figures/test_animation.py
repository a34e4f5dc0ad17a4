"""A fit that is watched is the fit that it would have been."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vig.inference import ExplainSettings, Stage, explain_one
from vig.recognition import Recognizer
from vig.scene import ObjectClass, linear_from_srgb
from vig.search.levenberg_marquardt import LevenbergMarquardt
from vig.search.optimizer import Budget, Evaluation
from vig_paper.figures import animation
from vig_paper.figures.animation import fit_animation
from vig_paper.optimizers import BFGS
from vig_world.dataset import Dataset


class Bowl:
    """-|point|^2, highest at 0."""

    lower, upper = np.full(18, -9.0, np.float32), np.full(18, 9.0, np.float32)
    dtype = np.float32

    def __call__(self, points, photo, sigma, derivatives=True) -> Evaluation:
        normal = 2 * np.tile(np.eye(18, dtype=np.float32), (len(points), 1, 1))
        return Evaluation(-(points**2).sum(1).astype(np.float64), -2 * points, normal)


@pytest.mark.parametrize(("optimizer", "least"), [(LevenbergMarquardt(), 3), (BFGS(), 1)])
def test_the_recorder_changes_nothing_and_keeps_the_best_searchs_way(optimizer, least: int) -> None:
    starts, photo = np.linspace(-3, 3, 36, dtype=np.float32).reshape(2, 18), np.zeros(2, np.int32)
    alone = optimizer(Bowl(), starts, photo, 1.0, Budget(10, 1e-3))
    recorder = animation.Recorder(optimizer)
    watched = recorder(Bowl(), starts, photo, 1.0, Budget(10, 1e-3))
    np.testing.assert_array_equal(watched.points, alone.points)
    values = [-float((point**2).sum()) for point in recorder.points]
    assert values == sorted(values) and len(values) >= least
    assert abs(values[-1] - float(watched.value.max())) < 1e-4


def test_the_animation_ends_with_the_answer(
    dataset: Dataset, weights: Path, teapot: ObjectClass, tmp_path: Path, monkeypatch
) -> None:
    photo = linear_from_srgb(dataset.images[0] / 255.0).astype(np.float32)
    prediction = Recognizer(weights)(photo[None])
    settings = ExplainSettings(stages=(Stage(3, 20, scale=0.5), Stage(2, 30, tolerance=0.0)))
    words: list[str] = []
    drawn: list[np.ndarray] = []
    frame = animation._frame

    def watched(linear, colour, coverage, said):
        words.append(said)
        drawn.append(coverage >= 0.5)
        return frame(linear, colour, coverage, said)

    monkeypatch.setattr(animation, "_frame", watched)
    path = fit_animation(photo, prediction, teapot, settings, tmp_path / "fit.webp")
    answer = explain_one(photo, prediction, teapot, replace(settings))
    assert words[0] == "recognition model" and words[-1] == answer.verdict.name.lower()
    assert words[1].startswith("step 1 of ")
    assert (drawn[-1] == answer.amodal).mean() > 0.999
    with Image.open(path) as image:
        assert image.format == "WEBP" and 10 < image.n_frames <= len(words) <= animation.MAX_FRAMES
    assert path.stat().st_size < animation.MAX_BYTES


def test_a_large_animation_is_made_smaller(tmp_path: Path, monkeypatch) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (3, 64, 64, 3), dtype=np.uint8)
    frames = [Image.fromarray(each) for each in noise]
    animation._write(tmp_path / "best.webp", frames, [100] * 3)
    best = (tmp_path / "best.webp").stat().st_size
    monkeypatch.setattr(animation, "MAX_BYTES", best)
    animation._write(tmp_path / "small.webp", frames, [100] * 3)
    assert (tmp_path / "small.webp").stat().st_size < best
