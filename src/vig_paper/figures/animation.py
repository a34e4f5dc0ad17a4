"""An animated fit: the best explanation so far over the photo, evaluation by evaluation."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage

from vig.inference import ExplainSettings, explain_one
from vig.io.files import atomic_write
from vig.recognition import Prediction
from vig.scene import Latents, ObjectClass, srgb8_from_linear, srgb_from_linear
from vig.search.optimizer import Budget, Descent, Optimizer, Problem
from vig_paper.figures.style import render_explanations

MAX_FRAMES = 40
MAX_BYTES = 1_000_000
"""Greatest size of the file; the quality is lowered until it fits."""
PICTURE_PIXELS = 300
"""Side of each of the two pictures, the photo and the explanation."""
FRAME_MS = 120
LAST_FRAME_MS = 2500
"""Duration of the last frame, the result."""
OUTLINE = np.array([1.0, 0.82, 0.0])
"""Colour of the silhouette's edge, sRGB in [0, 1]."""


@dataclass(frozen=True)
class Recorder:
    """An optimiser that runs another and records, at every evaluation, the best point of its stage so far."""

    optimizer: Optimizer
    best: list[np.ndarray] = field(default_factory=list)
    """Points (P',), one per evaluation; a stage's first is among its own starts."""

    def __call__(
        self, problem: Problem, starts: np.ndarray, photo: np.ndarray, sigma: float, budget: Budget
    ) -> Descent:
        """Run the other optimiser; see `Optimizer`."""
        return self.optimizer(_RecordedProblem(problem, self.best), starts, photo, sigma, budget)


class _RecordedProblem:
    """A problem that records the best point evaluated so far."""

    def __init__(self, problem: Problem, best: list[np.ndarray]):
        self.problem, self.best = problem, best
        self.highest = -np.inf
        self.lower, self.upper = problem.lower, problem.upper
        self.dtype = problem.dtype

    def __call__(
        self, points: np.ndarray, photo: np.ndarray, sigma: np.ndarray, derivatives: bool = True
    ) -> Any:
        evaluation = self.problem(points, photo, sigma, derivatives)
        values = np.where(np.isnan(evaluation.value), -np.inf, evaluation.value)
        index = int(values.argmax())
        if values[index] > self.highest or not self.best:
            self.highest = float(values[index])
            self.best.append(points[index].copy())
        else:
            self.best.append(self.best[-1])
        return evaluation


def fit_animation(
    photo: np.ndarray,
    prediction: Prediction,
    object_class: ObjectClass,
    settings: ExplainSettings,
    path: str | Path,
) -> Path:
    """Write an animated WebP of one photo's fit: the photo, and the best explanation so far over it.

    At most `MAX_FRAMES` frames, evenly spaced over all evaluations, and `MAX_BYTES`. The first frame is the
    recognition model's best guess, the last the result. The best is that of the current stage, since each
    stage has its own noise and scale.

    Args:
        photo: (150, 150, 3) linear RGB.
        prediction: Of this photo (N = 1).
        object_class: Of the object.
        settings: Of the fit.
        path: Of the WebP file.
    """
    recorder = Recorder(settings.optimizer)
    answer = explain_one(photo, prediction, object_class, replace(settings, optimizer=recorder))
    evaluations = np.linspace(0, len(recorder.best) - 1, min(len(recorder.best), MAX_FRAMES - 2)).round()
    points = [recorder.best[int(evaluation)] for evaluation in evaluations]
    vectors = [
        prediction.best().to_vector()[0],
        *(point[: prediction.best().to_vector().shape[1]] for point in points),
        answer.latents.to_vector()[0],
    ]
    captions = ["recognition model"]
    captions += [f"evaluation {int(evaluation) + 1} of {len(recorder.best)}" for evaluation in evaluations]
    captions += [answer.verdict.name.lower()]
    explanations = Latents.from_vector(np.stack(vectors).astype(np.float32))
    colours, coverage = render_explanations(explanations, object_class, settings.self_shadow)
    linear = photo
    frames = [
        _frame(linear, colour, covered, caption)
        for colour, covered, caption in zip(colours, coverage, captions, strict=True)
    ]
    durations = [5 * FRAME_MS] + [FRAME_MS] * (len(frames) - 2) + [LAST_FRAME_MS]
    _write(Path(path), frames, durations)
    return Path(path)


def _frame(photo: np.ndarray, colour: np.ndarray, coverage: np.ndarray, caption: str) -> Image.Image:
    """The photo on the left; on the right the rendering over it with its outline, and a caption."""
    overlay = (
        srgb_from_linear(photo) * (1 - coverage[..., None]) + srgb_from_linear(colour) * coverage[..., None]
    )
    silhouette = coverage >= 0.5
    overlay[ndimage.binary_dilation(silhouette) & ~silhouette] = OUTLINE
    sheet = Image.new("RGB", (2 * PICTURE_PIXELS + 4, PICTURE_PIXELS + 22), "white")
    for left, picture in (
        (0, srgb8_from_linear(photo)),
        (PICTURE_PIXELS + 4, (255 * overlay).round().astype(np.uint8)),
    ):
        sheet.paste(
            Image.fromarray(picture).resize((PICTURE_PIXELS, PICTURE_PIXELS), Image.Resampling.BICUBIC),
            (left, 0),
        )
    ImageDraw.Draw(sheet).text(
        (PICTURE_PIXELS + 4, PICTURE_PIXELS + 3), caption, fill="#22262e", font=ImageFont.load_default(13)
    )
    return sheet


def _write(path: Path, frames: list[Image.Image], durations: list[int]) -> None:
    """Animated WebP of the best quality that stays under `MAX_BYTES`."""
    with atomic_write(path) as temporary:
        for quality in (80, 60, 40, 20):
            opening, *following = frames
            opening.save(
                temporary, "WEBP", save_all=True, append_images=following, duration=durations, loop=0,
                quality=quality, method=4,
            )  # fmt: skip
            if temporary.stat().st_size < MAX_BYTES:
                break
