"""The prior of an object's pixel being visible, Eq. 3's alpha, learned from masks: one number or a map."""

from __future__ import annotations

import torch

from vig.likelihood.pixel import NEVER

MAP_PRIOR_COUNT = 20.0
"""Pixels of mean visibility that each pixel of a map is given beforehand."""


def visible_share(visible: torch.Tensor, amodal: torch.Tensor) -> float:
    """alpha as the mean visible share: of all pixels that objects cover, those that are seen.

    visible, amodal (N, H, W): masks, bool, of what is seen of each object and of all that it covers; or
    posteriors in [0, 1], and then this is EM's update of alpha. ValueError when nothing is covered.
    """
    _check(visible, amodal)
    covered = amodal.double().sum()
    if covered == 0:
        raise ValueError("expected masks that cover something; all of amodal is 0")
    return float((visible.double() * amodal.double()).sum() / covered)


def visible_map(visible: torch.Tensor, amodal: torch.Tensor) -> torch.Tensor:
    """alpha at each pixel of the image: (H, W) float64, from masks (N, H, W) as `visible_share`.

    Where few objects were, the map leans towards the mean visible share.
    """
    mean = visible_share(visible, amodal)
    seen = (visible.double() * amodal.double()).sum(0) + MAP_PRIOR_COUNT * mean
    return seen / (amodal.double().sum(0) + MAP_PRIOR_COUNT)


def log_prior_of(alpha: torch.Tensor) -> torch.Tensor:
    """Log prior (H, W, 3) of each pixel visible, hidden, background from a map alpha (H, W) in (0, 1]."""
    if alpha.ndim != 2 or not ((alpha > 0) & (alpha <= 1)).all():
        raise ValueError(f"alpha must be a map (H, W) of probabilities in (0, 1]; got {tuple(alpha.shape)}")
    visible = alpha.double()
    hidden = torch.where(visible < 1, torch.log1p(-visible), NEVER)
    return torch.stack([visible.log(), hidden, torch.zeros_like(visible)], dim=-1)


def _check(visible: torch.Tensor, amodal: torch.Tensor) -> None:
    if visible.ndim != 3 or visible.shape != amodal.shape:
        raise ValueError(
            f"expected two sets of masks (N, H, W); got {tuple(visible.shape)} and {tuple(amodal.shape)}"
        )
