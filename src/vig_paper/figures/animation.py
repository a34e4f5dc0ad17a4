"""An animated fit: the best explanation so far over the photo, step by step."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from PIL import Image

from vig.inference import ExplainSettings, explain_one
from vig.io.files import atomic_write
from vig.recognition import Prediction
from vig.scene import Latents, ObjectClass, srgb_from_linear
from vig.search.optimizer import Budget, Descent, Optimizer, Problem
from vig_paper.figures.style import outline, render_explanations, show_picture
from vig_world.extras import optional_import

MAX_FRAMES = 40
MAX_BYTES = 1_000_000
"""Greatest size of the file; the quality is lowered until it fits."""


@dataclass(frozen=True)
class Recorder:
    """An optimiser that runs another, and records the way of the best search of each stage."""

    optimizer: Optimizer
    points: list[np.ndarray] = field(default_factory=list)
    """(P',) each: the start, then the best point after each step; the end alone where no way was kept."""

    def __call__(
        self, problem: Problem, starts: np.ndarray, photo: np.ndarray, sigma: float, budget: Budget
    ) -> Descent:
        """Run the other optimiser; see `Optimizer`."""
        descent = self.optimizer(problem, starts, photo, sigma, budget)
        best = int(np.nan_to_num(descent.value, nan=-np.inf).argmax())
        self.points.extend((descent.points[None] if descent.path is None else descent.path)[:, best])
        return descent


def fit_animation(
    photo: np.ndarray,
    prediction: Prediction,
    object_class: ObjectClass,
    settings: ExplainSettings,
    path: str | Path,
) -> Path:
    """Write an animated WebP of one photo's fit: the photo, and the best explanation so far over it.

    At most `MAX_FRAMES` frames, evenly spaced over the steps of each stage's best search, and `MAX_BYTES`.
    The first frame is the recognition model's best guess, the last the result.

    Args:
        photo: (150, 150, 3) linear RGB.
        prediction: Prediction for this photo (N = 1).
        object_class: Class of the object.
        settings: Settings of the fit.
        path: Path of the WebP file.
    """
    recorder = Recorder(settings.optimizer)
    answer = explain_one(photo, prediction, object_class, replace(settings, optimizer=recorder))
    points = recorder.points
    shown = np.linspace(0, len(points) - 1, min(len(points), MAX_FRAMES - 2)).round().astype(int)
    guess = prediction.best().to_vector()[0]
    vectors = [guess, *(points[index][: len(guess)] for index in shown), answer.latents.to_vector()[0]]
    captions = ["recognition model", *(f"step {index + 1} of {len(points)}" for index in shown)]
    captions.append(answer.verdict.name.lower())
    explanations = Latents.from_vector(np.stack(vectors).astype(np.float32))
    colours, coverage = render_explanations(explanations, object_class, settings.self_shadow)
    frames = [_frame(photo, *content) for content in zip(colours, coverage, captions, strict=True)]
    _write(Path(path), frames, [600] + [120] * (len(frames) - 2) + [2500])
    return Path(path)


def _frame(photo: np.ndarray, colour: np.ndarray, coverage: np.ndarray, caption: str) -> Image.Image:
    """Return the photo, linear RGB, on the left; on the right the rendering over it, outlined."""
    with optional_import("world"):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

    covered, photo = coverage[..., None], srgb_from_linear(photo)
    explained = photo * (1 - covered) + srgb_from_linear(colour) * covered
    canvas = FigureCanvasAgg(Figure(figsize=(6, 3.2), facecolor="white"))
    axes = canvas.figure.add_axes((0.0, 0.0625, 1.0, 0.9375))
    show_picture(axes, np.hstack([photo, explained]), caption)
    outline(axes, np.hstack([coverage * 0, coverage]) >= 0.5)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


def _write(path: Path, frames: list[Image.Image], durations: list[int]) -> None:
    """Write an animated WebP of the best quality that stays under `MAX_BYTES`; durations in ms."""
    first, *following = frames
    with atomic_write(path) as temporary:
        for quality in (80, 60, 40, 20):
            settings = {"append_images": following, "duration": durations, "quality": quality, "method": 4}
            first.save(temporary, "WEBP", save_all=True, loop=0, **settings)
            if temporary.stat().st_size < MAX_BYTES:
                break
