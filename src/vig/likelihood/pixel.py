"""The pixel likelihood, Eq. 2 and 3: what it means, and its settings.

At a pixel that the object covers: log(visible N(c; mu, s^2 I) + hidden U), with U = 1 on the unit cube of
linear RGB and N the product over the three channels. At any other pixel: log(background U). The three
prior weights are (alpha, 1 - alpha, 1) in the paper's robust model, (1, 0, 1) in its Gaussian one; with a
recognition model's class probabilities of each pixel, they may differ from pixel to pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

NEVER = -1e30
"""Stands for log 0 in a prior: finite, so that no infinity meets another."""


LOG_UNIT = 3 * math.log(math.sqrt(2 * math.pi))
"""Log normaliser of three channels' Gaussian of standard deviation 1."""


@dataclass(frozen=True)
class PixelModel:
    """Settings of the pixel likelihood.

    Attributes:
        sigma: Standard deviation of the noise, linear RGB.
        alpha: Prior of an object's pixel being visible, in (0, 1]; 1 is the Gaussian model.
    """

    sigma: float
    alpha: float

    def __post_init__(self) -> None:
        if not self.sigma > 0:
            raise ValueError(f"sigma must be a positive standard deviation in linear RGB; got {self.sigma}")
        if not 0 < self.alpha <= 1:
            raise ValueError(f"alpha must be a probability in (0, 1]; got {self.alpha}")

    def log_prior(self, height: int, width: int) -> torch.Tensor:
        """The same log prior (visible, hidden, background) at each pixel: (H, W, 3) float64."""
        hidden = math.log1p(-self.alpha) if self.alpha < 1 else NEVER
        return torch.tensor([math.log(self.alpha), hidden, 0.0], dtype=torch.float64).expand(height, width, 3)


GAUSSIAN = PixelModel(sigma=0.05, alpha=1.0)
"""The paper's Gaussian pixel model, Eq. 2: every pixel of the object is visible."""

ROBUST = PixelModel(sigma=0.03, alpha=0.55)
"""The paper's robust pixel model, Eq. 3. alpha is learned, as the paper proposes: the mean share of the
teapot that is visible in the training images. The paper's code has 0.9, under which fits end farther from the
truth (docs/occlusion.md)."""


def mixture(
    observed: torch.Tensor, rendered: torch.Tensor, log_prior: torch.Tensor, sigma: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Log-likelihood of pixels that the object covers and the posterior of their being visible (Eq. 3).

    observed, rendered: (..., 3) linear RGB. log_prior: (..., 3) as `PixelModel.log_prior`. Both results
    (...). The plain reference of what the kernels compute.
    """
    square = ((observed - rendered) ** 2).sum(-1)
    inlier = log_prior[..., 0] - square / (2 * sigma**2) - 3 * math.log(sigma * math.sqrt(2 * math.pi))
    both = torch.stack([inlier, log_prior[..., 1]], dim=-1)
    return both.logsumexp(-1), both.softmax(-1)[..., 0]
