"""From a photo on disk to an explanation on disk."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import torch

from vig.errors import UserError
from vig.inference import ExplainSettings, Explanation, explain
from vig.likelihood import GAUSSIAN, ROBUST, SPATIAL, load_kernels
from vig.optimizers.bfgs import BFGS
from vig.optimizers.conjugate_gradient import ConjugateGradient
from vig.optimizers.dogleg import Dogleg
from vig.optimizers.gradient_descent import GradientDescent
from vig.optimizers.lbfgs import LBFGS
from vig.optimizers.levenberg_marquardt import LevenbergMarquardt
from vig.optimizers.optimizer import Optimizer
from vig.photo.images import read_photo
from vig.photo.window import Window
from vig.recognition import Recognizer
from vig.report import write_explanation
from vig.scene import ObjectClass

Box = tuple[float, float, float, float]
OPTIMIZERS: dict[str, Optimizer] = {
    "lm": LevenbergMarquardt(),
    "dogleg": Dogleg(),
    "lbfgs": LBFGS(),
    "bfgs": BFGS(),
    "cg": ConjugateGradient(),
    "gd": GradientDescent(),
}
LIKELIHOODS = {"robust": ROBUST, "gaussian": GAUSSIAN, "spatial": SPATIAL}


class Explainer:
    """Reads, explains and writes photos with one class and one way of fitting."""

    def __init__(
        self,
        object_class: str,
        likelihood: str = "spatial",
        optimizer: str = "lm",
        self_shadow: bool = True,
    ):
        self.object_class = ObjectClass.load(object_class)
        self.recognizer = Recognizer.of_class(self.object_class)
        load_kernels(torch.float32, self.object_class.shape_model.modes)
        self.likelihood, self.optimizer = LIKELIHOODS[likelihood], OPTIMIZERS[optimizer]
        self.self_shadow = self_shadow

    def __call__(
        self, image: Path, folder: Path, box: Box | None = None, framing: str = "auto"
    ) -> tuple[dict[str, Any], Explanation]:
        """Explain a photo into a folder; returns what its JSON says, and the explanation.

        UserError for an unreadable photo, a box outside it, or a folder that cannot be written.
        """
        photo = read_photo(image)
        height, width = photo.shape[:2]
        window = Window.of(width, height, box)
        cut, known = window.cut(photo)
        free = framing == "free" or (framing == "auto" and (box is not None or height != width))
        settings = ExplainSettings(
            self.likelihood, free_framing=free, optimizer=self.optimizer, self_shadow=self.self_shadow
        )
        explanation = next(
            explain(
                torch.from_numpy(cut)[None],
                self.object_class,
                self.recognizer,
                settings,
                torch.from_numpy(known)[None],
            )
        )
        return write_explanation(folder, photo, window, explanation, self.object_class), explanation


def parse_box(text: str) -> Box:
    """ "x,y,w,h" as four numbers; UserError when it is not."""
    try:
        x, y, w, h = (float(part) for part in text.replace(" ", "").split(","))
        if not all(map(math.isfinite, (x, y, w, h))):
            raise ValueError
    except ValueError:
        raise UserError(f"expected --box x,y,w,h in pixels, such as 40,30,200,160; got '{text}'") from None
    return x, y, w, h


def result_folders(images: tuple[Path, ...], out: Path) -> list[Path]:
    """A folder for each photo, named after it; a number is added where two photos share a name."""
    if not images:
        raise UserError("expected at least one photo; got none. Name one: vig fit photo.jpg")
    used: set[str] = set()
    folders = []
    for image in images:
        name, number = image.stem, 2
        while name in used:
            name, number = f"{image.stem}-{number}", number + 1
        used.add(name)
        folders.append(out / name)
    return folders
