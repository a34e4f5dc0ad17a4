"""Every figure of an evaluation into one folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from vig.dataset import Dataset
from vig.inference import ExplainSettings
from vig.recognition import Recognizer
from vig.scene import ObjectClass, linear_from_srgb
from vig_lab.evaluation.protocol import LIKELIHOODS
from vig_lab.evaluation.results import MethodResult
from vig_lab.figures.animation import fit_animation
from vig_lab.figures.choice import choose, worst
from vig_lab.figures.curves import figure3, reliability_figure
from vig_lab.figures.explained import figure4
from vig_lab.figures.lights import figure5
from vig_lab.figures.style import last_fit

WORST = 8


def draw_figures(
    dataset: Dataset,
    object_class: ObjectClass,
    recognizer: Recognizer,
    results: Mapping[str, MethodResult],
    tier: str,
    folder: Path,
    settings: ExplainSettings | None = None,
) -> list[Path]:
    """Write what the results allow; returns the paths. settings: how the photos were fitted.

    figure3.png, figure3_bins.png: errors against occlusion, cumulative and in bins. figure4.png, figure5.png:
    the last fit's median image of each bin of occlusion, see `choose`; fit.webp moves for the middle one.
    figure4_worst.png: the images whose azimuth it has most wrong. reliability.png: all that state deviations.
    """
    paths = [
        figure3(results, dataset.occlusion, tier, folder / "figure3.png"),
        figure3(results, dataset.occlusion, tier, folder / "figure3_bins.png", cumulative=False),
    ]
    method = last_fit(results)
    if method is None:
        return paths
    chosen, wrong = choose(results, dataset, method), worst(results, method, WORST)
    paths += [
        reliability_figure(results, dataset.latents, folder / "reliability.png"),
        figure4(dataset, object_class, results, chosen, folder / "figure4.png"),
        figure4(dataset, object_class, results, wrong, folder / "figure4_worst.png"),
        figure5(dataset, results, chosen, folder / "figure5.png"),
    ]
    if method in LIKELIHOODS:
        image = dataset.read("rgb", [chosen[len(chosen) // 2]])
        photo = torch.from_numpy(linear_from_srgb(image.astype(np.float32) / 255)).float()
        chosen_fit = replace(settings or ExplainSettings(), likelihood=LIKELIHOODS[method])
        paths.append(
            fit_animation(photo[0], recognizer(photo), object_class, chosen_fit, folder / "fit.webp")
        )
    return paths
