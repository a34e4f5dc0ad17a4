"""Style and parts that the figures share. matplotlib is imported in functions: it takes 0.2 s."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from vig.io.files import atomic_write
from vig.renderer.explained import render_latents
from vig.scene import Latents, ObjectClass
from vig_train.evaluation.protocol import MASK_HEAD
from vig_train.evaluation.results import MethodResult
from vig_world.extras import optional_import

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#22262e"
SOFT = "#6b7480"
FAINT = "#d9dde3"
COLOURS = {
    "baseline": "#9aa3ae",
    "rm": "#3b6fb6",
    MASK_HEAD: "#7fb0e6",
    "gaussian": "#e08a2e",
    "robust": "#2f9e6e",
    "spatial": "#c2357b",
}
NAMES = {"rm": "recognition model", MASK_HEAD: "its mask head", "gaussian": "Gaussian fit"} | {
    name: f"{name} fit" for name in ("robust", "spatial")
}
EXPLAINING_METHODS = ("rm", "gaussian", "robust", "spatial")
"""The methods whose explanations are drawn; where there is room for one, it is the last."""


def new_figure(width: float, height: float) -> Figure:
    """Return a white figure of a size in inches, laid out without overlaps."""
    with optional_import("world"):
        from matplotlib.figure import Figure
        from matplotlib.layout_engine import ConstrainedLayoutEngine

    spacing = ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.08, hspace=0.04, wspace=0.04)
    return Figure(figsize=(width, height), facecolor="white", layout=spacing)


def style_axes(axes: Axes, title: str) -> None:
    """Style axes with a plain frame and their title above it."""
    axes.set_title(title, loc="left", fontsize=10, color=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["bottom", "left"]].set_color(FAINT)
    axes.tick_params(which="both", colors=SOFT, labelsize=8.5, length=0)
    axes.grid(color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)


def show_picture(axes: Axes, picture: np.ndarray, caption: str = "") -> None:
    """Show a picture (H, W, 3) in [0, 1] without a frame, a small caption below it."""
    axes.imshow(np.clip(picture, 0, 1))
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)
    axes.set_xlabel(caption, fontsize=7.5, color=SOFT, labelpad=2)


def picture_grid(
    titles: Sequence[str], rows: int, inches: float, widths: Sequence[float] | None = None
) -> tuple[Figure, np.ndarray]:
    """Return a figure, and its axes (rows, columns) for pictures: titles above the columns, each picture
    as high as `inches` and as wide as that times its entry of `widths`, by default 1.
    """
    widths = widths or [1.0] * len(titles)
    figure = new_figure(inches * sum(widths) + 0.5, (inches + 0.15) * rows + 0.3)
    panels = figure.subplots(rows, len(titles), squeeze=False, width_ratios=widths)
    for axes, title in zip(panels[0], titles, strict=True):
        axes.set_title(title, fontsize=8.5, color=INK)
    return figure, panels


def outline(axes: Axes, mask: np.ndarray) -> None:
    """Draw the edge of a mask (H, W) over a picture."""
    if mask.any() and not mask.all():
        axes.contour(mask.astype(float), levels=[0.5], colors=["#ffd200"], linewidths=0.9)


def last_fit(results: Mapping[str, MethodResult]) -> str | None:
    """Return the last fit, else "rm"; None where there is neither."""
    return next((method for method in reversed(EXPLAINING_METHODS) if method in results), None)


def render_explanations(
    latents: Latents, object_class: ObjectClass, self_shadow: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Render N explanations in the standard camera.

    Returns:
        The object's own colour (N, H, W, 3), linear RGB, 0 where it is not, and coverage (N, H, W) in [0, 1].
    """
    camera = object_class.camera()
    with torch.no_grad():
        rendering = render_latents(latents, object_class, camera, self_shadow)
    colours = rendering.rgb / rendering.coverage.clamp_min(1e-3)[..., None]  # they were blended with black
    return colours.numpy(), rendering.coverage.numpy()


def save(figure: Figure, path: str | Path, dpi: int = 110) -> Path:
    """Write a figure, whole or not at all, in the format that the path's suffix names."""
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=dpi)
    return Path(path)
