"""Figure 4: photos, what each method makes of them, and the visible masks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from vig.dataset import Dataset
from vig.inference import ExplainSettings
from vig.scene import Latents, ObjectClass, srgb_from_linear
from vig_lab.evaluation.rendering import rendered
from vig_lab.evaluation.results import MethodResult
from vig_lab.figures.style import EXPLAINED, NAMES, head, new_figure, save, show

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CELL = 1.55
"""Inches."""
OUTLINE, VISIBLE, HIDDEN = "#ffd200", "#19b36b", "#eb2878"
FADED = 0.45
"""How far what is not the object is faded to white behind a rendering or a mask."""


def figure4(
    dataset: Dataset,
    object_class: ObjectClass,
    results: Mapping[str, MethodResult],
    indices: Sequence[int],
    path: str | Path,
) -> Path:
    """Write a row for each image: photo, outline, renderings of the recognition model and the fits, masks.

    The outline is of the whole object in truth, hidden parts included. Renderings lie over the faded photo;
    below each stands its azimuth error, and its verdict. Of masks, green is visible and pink hidden: the last
    fit's (the recognition model's where there is none), and the truth's.
    """
    if not len(indices):
        raise ValueError("expected at least one image to show; got none")
    chosen = list(indices)
    photos = dataset.read("rgb", chosen) / 255.0
    truth = Latents.from_vector(torch.from_numpy(dataset.latents[chosen]))
    azimuth = np.degrees(truth.azimuth.numpy()) % 360
    amodal, visible = dataset.read("mask", chosen), dataset.read("mask_visib", chosen)
    shown = [method for method in EXPLAINED if method in results]
    titles = ["photo", "truth", *(NAMES[method] for method in shown)]
    titles += [f"{NAMES[shown[-1]]}: mask"] if shown else []
    titles += ["truth: mask"]
    figure = new_figure(CELL * len(titles) + 0.2, (CELL + 0.12) * len(chosen) + 0.3)
    panels = figure.subplots(len(chosen), len(titles), squeeze=False)
    drawn = {method: _drawn(results[method], chosen, object_class) for method in shown}
    for row, index in enumerate(chosen):
        cells = iter(panels[row])
        photo = photos[row]
        show(next(cells), photo, f"{index}: {dataset.occlusion[index]:.0%} hidden")
        axes = next(cells)
        show(axes, photo, f"azimuth {azimuth[row]:.0f}\N{DEGREE SIGN}")
        _outline(axes, amodal[row])
        for method in shown:
            colours, coverage = drawn[method][0][row], drawn[method][1][row]
            axes = next(cells)
            picture = _faded(photo) * (1 - coverage[..., None]) + colours * coverage[..., None]
            show(axes, picture, _said(results[method], index))
            _outline(axes, coverage >= 0.5)
        if shown:
            masks = results[shown[-1]].masks
            said = visible[row] & False if masks is None else masks[index]
            iou = results[shown[-1]].errors["segmentation_iou"][index]
            show(next(cells), _masked(photo, drawn[shown[-1]][1][row] >= 0.5, said), f"IoU {iou:.2f}")
        show(next(cells), _masked(photo, amodal[row], visible[row]))
    head(panels[0], titles)
    return save(figure, path)


def _drawn(
    result: MethodResult, chosen: list[int], object_class: ObjectClass
) -> tuple[np.ndarray, np.ndarray]:
    """sRGB in [0, 1] and coverage of a method's explanations of the chosen images, shaded as fits are."""
    assert result.latents is not None
    latents = result.latents[torch.tensor(chosen)]
    colours, coverage = rendered(latents, object_class, ExplainSettings().self_shadow)
    return srgb_from_linear(colours), coverage


def _said(result: MethodResult, index: int) -> str:
    error = f"{result.errors['azimuth_deg'][index]:.1f}\N{DEGREE SIGN} off"
    verdict = result.verdicts[index]
    return f"{error}, {verdict}" if verdict else error


def _faded(photo: np.ndarray) -> np.ndarray:
    return (1 - FADED) * photo + FADED


def _masked(photo: np.ndarray, amodal: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """The photo faded, with visible pixels in green and the silhouette's others in pink, half transparent."""
    from matplotlib.colors import to_rgb

    picture = _faded(photo)
    for mask, colour in ((amodal & ~visible, HIDDEN), (visible, VISIBLE)):
        picture[mask] = 0.4 * photo[mask] + 0.6 * np.array(to_rgb(colour))
    return picture


def _outline(axes: Axes, mask: np.ndarray) -> None:
    if mask.any() and not mask.all():
        axes.contour(mask.astype(float), levels=[0.5], colors=[OUTLINE], linewidths=0.9)
