"""Settings of the core's verbs: a dataclass each, from which the command line is derived."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vig.names import LikelihoodName, OptimizerName


@dataclass(frozen=True)
class Fit:
    """Explain photos of one object each: explanation.json, overlay.png, mask.png and object.glb per photo."""

    images: tyro.conf.Positional[tuple[Path, ...]]
    """Photos: any size, any format that pillow reads."""
    box: str | None = None
    """x,y,w,h in pixels: a box round the whole object, hidden parts included; with several photos, the same
    for each. The whole photo by default."""
    object_class: Annotated[str, tyro.conf.arg(name="class")] = "teapot"
    """A packaged class or the folder of a class pack."""
    likelihood: LikelihoodName = "spatial"
    """The pixel model: robust allows for occluders, pixel by pixel; in spatial's mask neighbouring pixels are
    hidden or visible together; gaussian takes all of the object as visible."""
    optimizer: OptimizerName = "lm"
    """Levenberg-Marquardt, Powell's dogleg, L-BFGS, BFGS, nonlinear conjugate gradient, gradient descent with
    momentum; docs/choosing.md compares them."""
    no_self_shadow: bool = False
    """Shade without self-shadowing and interreflection; docs/self_shadow.md."""
    framing: Literal["auto", "fixed", "free"] = "auto"
    """Fit the image's shift and magnification too? auto: with a box, or when the photo is not square."""
    out: Path = Path("vig-fit")
    """Folder for the results, one folder per photo."""
    json: bool = False
    """Print one JSON object instead of lines."""


@dataclass(frozen=True)
class Doctor:
    """Versions, devices, and a check of the kernels: what a bug report needs."""

    json: bool = False
    """Print one JSON object."""
