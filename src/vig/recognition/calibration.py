"""What makes a network's stated uncertainties hold on scenes and designs that it has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch.nn import functional

PREFIX = "calibration."
WITHIN_90 = 1.6449
"""Standard deviations on either side that hold 90 % of a Gaussian."""
LEAST_FACTOR = 0.5


@dataclass(frozen=True)
class Calibration:
    """Corrections of a network's word.

    azimuth_temperature, mask_temperature (): what logits are divided by (Guo et al. 2017). deviation (M,):
    factors of the stated standard deviations.
    """

    azimuth_temperature: torch.Tensor
    mask_temperature: torch.Tensor
    deviation: torch.Tensor

    @staticmethod
    def none(numbers: int) -> Calibration:
        """Takes a network at its word."""
        return Calibration(torch.ones(()), torch.ones(()), torch.ones(numbers))

    @staticmethod
    def of(tensors: dict[str, torch.Tensor], numbers: int) -> Calibration:
        """From the tensors of a weights file; of one that was not calibrated, `none`."""
        found = {k.removeprefix(PREFIX): v for k, v in tensors.items() if k.startswith(PREFIX)}
        if not found:
            return Calibration.none(numbers)
        shapes = {"azimuth_temperature": (), "mask_temperature": (), "deviation": (numbers,)}
        if {name: tuple(value.shape) for name, value in found.items()} != shapes:
            raise ValueError("the calibration does not fit the network")
        for value in found.values():
            if not value.is_floating_point() or not ((value > 1e-3) & (value < 1e3)).all():
                raise ValueError("the calibration's factors must be from 0.001 to 1000")
        return Calibration(**found)

    def tensors(self) -> dict[str, torch.Tensor]:
        """As they go into a weights file."""
        return {PREFIX + name: value for name, value in vars(self).items()}


def temperature(logits: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
    """The temperature () under which logits (N, C) give soft labels (N, C) the greatest likelihood."""
    tried = torch.logspace(-0.5, 0.7, 121)
    losses = [functional.cross_entropy(logits / t, labels) for t in tried]
    return tried[int(torch.stack(losses).argmin())]


def widening(error: torch.Tensor, deviation: torch.Tensor) -> torch.Tensor:
    """Factors (M,) of deviations (N, M) after which 90 % of errors (N, M) lie within 90 % intervals.

    At least `LEAST_FACTOR`: what never varies, as L00 at a set exposure, is not known infinitely well.
    """
    return (torch.quantile(error.abs() / deviation, 0.9, dim=0) / WITHIN_90).clamp_min(LEAST_FACTOR)
