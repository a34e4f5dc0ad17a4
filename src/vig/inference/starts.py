"""Where the descents begin: the recognition model's hypotheses, and points strewn round them."""

from __future__ import annotations

import math

import numpy as np
import torch

from vig.recognition import Prediction
from vig.recognition.targets import latents_of
from vig.scene import Latents
from vig.scene.layout import FRAMING

PEAKS = 4
LEAST_WEIGHT = 0.02
"""Peaks of azimuth with less probability are left out."""

SPREAD_AZIMUTH = math.radians(8.0)
SPREAD = 0.7
"""Share of the deviations that the recognition model states by which elevation and shape are strewn."""


def starts(prediction: Prediction, count: int, seed: int = 0) -> Latents:
    """`count` starts for one photo's prediction (N = 1), the first being the best guess itself.

    Each peak of azimuth gets a share of the starts near its probability, at least one; beyond the first,
    azimuth, elevation and shape are strewn by Gaussians. The same seed gives the same starts.
    """
    weights, angles = prediction.modes(PEAKS)
    probability = weights[0].exp()
    kept = int((probability / probability.sum() > LEAST_WEIGHT).sum().clamp(1, count))
    share = (probability[:kept] / probability[:kept].sum()).numpy()
    peaks = _allot(share, count)
    azimuth = angles[0, peaks]
    numbers = prediction.numbers.expand(count, -1).clone()
    layout = prediction.layout
    rng = np.random.default_rng(np.random.SeedSequence([seed, count]))
    strewn = np.array([i > 0 and peaks[i] in peaks[:i] for i in range(count)], np.float32)[:, None]
    noise = torch.from_numpy(
        rng.standard_normal((count, 2 + layout.count("shape"))).astype(np.float32) * strewn
    )
    moved = layout.indices("elevation", "shape")
    numbers[:, moved] += SPREAD * prediction.deviation[:, moved] * noise[:, 1:]
    return latents_of(numbers, azimuth + SPREAD_AZIMUTH * noise[:, 0])


def strewn_framing(count: int, seed: int = 0) -> torch.Tensor:
    """Framings (count, 3) for as many starts, the first 0, the others strewn by the prior's deviations."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, count, 1]))
    deviation = np.array(FRAMING.deviation, np.float32)
    noise = rng.standard_normal((count, FRAMING.size)).astype(np.float32)
    noise[0] = 0.0
    return torch.from_numpy(noise * deviation)


def _allot(share: np.ndarray, count: int) -> list[int]:
    """Indices of peaks for `count` starts: each once, then by what is owed most."""
    given = list(range(len(share)))
    numbers = np.ones(len(share))
    while len(given) < count:
        owed = int(np.argmax(share * (count + 1) - numbers))
        given.append(owed)
        numbers[owed] += 1
    return given[:count]
