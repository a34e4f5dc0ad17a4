"""Predictions for photos: hypotheses with weights, uncertainty, and a mask."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import torch

from vig.recognition.network import latents_of, layout_of_numbers
from vig.scene import LatentLayout, Latents, Symmetry

LEAST_MASK, MASK_STEP, NUMBER_STEP, DEVIATION_STEP = 0.02, 1 / 8, 1 / 512, 1 / 16
"""Least probability of a mask, and steps of its logarithm (nats), of numbers (units of the latents) and of a
deviation's logarithm, see `Prediction.round_for_search`. Between AVX2 and AVX-512 masks differ by 4e-8, so
that 2 % of photos have a pixel on another step."""
START_STEP = 1 / 4096
"""Steps of the points that searches start from, in units of the latents."""


def round_to_grid(numbers: torch.Tensor, step: float) -> torch.Tensor:
    """Round to multiples of `step`, a power of two, so that results are exact."""
    return (numbers / step).round() * step


@dataclass(frozen=True)
class Prediction:
    """What the network predicts for N photos, before any fit.

    Attributes:
        azimuth: (N, bins) probabilities of equal bins, the first centred at half a bin, of the circle, or of
            the part of it in which views of the class differ: half of it, or a single bin.
        numbers: (N, M) mean of the regressed numbers, see `layout`; light in the heading frame.
        deviation: (N, M) standard deviations of these.
        mask: (N, H, W, 3) probabilities of each pixel's `MASK_CLASSES`.
        roll: (N,) clockwise turn of the photo, radians.
        presence: (N,) probability that the photo shows the object.
        symmetry: Of the class.
    """

    azimuth: torch.Tensor
    numbers: torch.Tensor
    deviation: torch.Tensor
    mask: torch.Tensor
    roll: torch.Tensor
    presence: torch.Tensor
    symmetry: Symmetry = field(default=Symmetry.NONE, kw_only=True)

    def __len__(self) -> int:
        return len(self.azimuth)

    @property
    def tensors(self) -> tuple[torch.Tensor, ...]:
        """All but the symmetry."""
        return self.azimuth, self.numbers, self.deviation, self.mask, self.roll, self.presence

    def folded(self, symmetry: Symmetry) -> Prediction:
        """The same for a class with a symmetry: bins of the whole circle that look the same are added."""
        if symmetry is Symmetry.NONE:
            return self
        bins = self.azimuth.shape[1] // symmetry.fold if symmetry.fold else 1
        return replace(self, azimuth=self.azimuth.unflatten(1, (-1, bins)).sum(1), symmetry=symmetry)

    @property
    def layout(self) -> LatentLayout:
        """Of the regressed numbers."""
        return layout_of_numbers(self.numbers.shape[1])

    def best(self) -> Latents:
        """The most probable explanation of each photo: (N,) latents."""
        _, azimuth = self.modes(1)
        return latents_of(self.numbers, azimuth[:, 0])

    @functools.cached_property
    def _modes(self) -> dict[bool, tuple[torch.Tensor, torch.Tensor]]:
        """The most peaks that `modes` found, broad and others; several steps of a fit ask for the same."""
        return {}

    def modes(self, count: int, broad: bool = True) -> tuple[torch.Tensor, torch.Tensor]:
        """The `count` best separate peaks of azimuth: log weight (N, count) and radians (N, count).

        Of views that look the same there is one; where all do, a single one at 0: (N, 1).

        A peak is the circular mean over its bin and the two beside it on either hand; a `broad` one also over
        those that follow, up to a quarter turn, for as long as they have half of its height: where a handle
        is out of sight, all views that hide it. Its bins are then taken out before the next is sought.
        """
        if not self.symmetry.fold:
            return torch.zeros(len(self), 1, dtype=torch.float64), torch.zeros(len(self), 1)
        if broad in self._modes and self._modes[broad][0].shape[1] >= count:
            log_weight, azimuths = self._modes[broad]
            return log_weight[:, :count], azimuths[:, :count]
        bins = self.azimuth.shape[1]
        centres = (torch.arange(bins) + 0.5) * (2 * math.pi / bins)
        left = self.azimuth.clone().double()
        weights, angles = [], []
        reach = max(2, bins // 4 if broad else 0)
        offsets = torch.arange(-reach, reach + 1)
        for _ in range(count):
            smooth = sum((left.roll(offset, 1) for offset in range(-2, 3)), torch.zeros_like(left))
            near = (smooth.argmax(1)[:, None] + offsets) % bins
            high = smooth.gather(1, near)
            high = high >= 0.5 * high[:, reach : reach + 1]
            high[:, reach - 2 : reach + 3] = True
            # Of each side all bins up to the first that is lower.
            before, after = (
                high[:, : reach + 1].flip(1).int().cumprod(1).flip(1),
                high[:, reach:].int().cumprod(1),
            )
            member = torch.cat([before, after[:, 1:]], 1).double()
            mass = left.gather(1, near) * member
            total = mass.sum(1)
            at = centres[near].double()
            angle = torch.atan2((mass * at.sin()).sum(1), (mass * at.cos()).sum(1))
            weights.append(torch.log(total.clamp_min(1e-9)))
            angles.append(torch.where(total > 0, angle, at[:, reach]))
            left = left.scatter(1, near, left.gather(1, near) * (1 - member))
        azimuths = torch.remainder(torch.stack(angles, 1), 2 * math.pi).float() / self.symmetry.fold
        self._modes[broad] = torch.stack(weights, 1), azimuths
        return self._modes[broad]

    def round_for_search(self) -> Prediction:
        """The same prediction in steps far above rounding, as searches start from it.

        Networks add up in another order on each kind of processor, and searches amplify a last digit. Masks
        are in steps of `MASK_STEP` nats, 0 below `LEAST_MASK`; numbers of `NUMBER_STEP`; the logarithms of
        deviations of `DEVIATION_STEP`. Azimuth, by which ends are only compared, stays as it is.
        """
        mask, log_deviation = self.mask.double(), self.deviation.double().log()
        coarse = round_to_grid(mask.clamp_min(LEAST_MASK).log(), MASK_STEP).exp()
        rounded = replace(
            self,
            mask=torch.where(mask < LEAST_MASK, 0.0, coarse).to(self.mask),
            numbers=round_to_grid(self.numbers, NUMBER_STEP),
            deviation=round_to_grid(log_deviation, DEVIATION_STEP).exp().to(self.deviation),
        )
        rounded.__dict__["_modes"] = self._modes
        return rounded

    @functools.cached_property
    def _smooth(self) -> torch.Tensor:
        """Probability (bins,) float64 that the first photo's azimuth lies in a bin or two on either hand."""
        azimuth = self.azimuth[0].double()
        return torch.stack([azimuth.roll(offset) for offset in range(-2, 3)]).sum(0)

    def log_mass(self, azimuth: torch.Tensor) -> torch.Tensor:
        """Log probability that the first photo's azimuth lies within 2.5 bins of each angle (B,), float64.

        Linear between bins, and at least log 0.001, so that no view is ruled out.
        """
        bins, fold = self.azimuth.shape[1], self.symmetry.fold
        if not fold:
            return torch.zeros_like(azimuth, dtype=torch.float64)
        at = torch.remainder(azimuth.double() * fold * bins / (2 * math.pi) - 0.5, bins)
        low = at.floor().long() % bins
        share = at - at.floor()
        mass = self._smooth[low] * (1 - share) + self._smooth[(low + 1) % bins] * share
        return mass.clamp_min(1e-3).log()

    def azimuth_offsets(self, azimuth: torch.Tensor) -> torch.Tensor:
        """Radians (bins,) by which each bin of the azimuth lies off one (); of views alike the least."""
        bins = self.azimuth.shape[1]
        centres = (torch.arange(bins) + 0.5) * (2 * math.pi / bins / max(self.symmetry.fold, 1))
        offsets: torch.Tensor = self.symmetry.difference(centres, azimuth)
        return offsets

    def __getitem__(self, index: slice) -> Prediction:
        return Prediction(*(tensor[index] for tensor in self.tensors), symmetry=self.symmetry)

    def clone(self) -> Prediction:
        """The same in tensors of its own."""
        return Prediction(*(tensor.clone() for tensor in self.tensors), symmetry=self.symmetry)

    @staticmethod
    def joined(parts: Sequence[Prediction]) -> Prediction:
        """Concatenate."""
        columns = zip(*(part.tensors for part in parts), strict=True)
        return Prediction(*map(torch.cat, columns), symmetry=parts[0].symmetry)
