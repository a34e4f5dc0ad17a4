"""Predictions for photos: hypotheses with weights, uncertainty, and a mask."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vig.recognition.network import latents_of, layout_of_numbers
from vig.scene import LatentLayout, Latents, Symmetry

MIN_MASK, MASK_STEP, NUMBER_STEP, DEVIATION_STEP = 0.02, 1 / 8, 1 / 512, 1 / 16
"""Least probability of a mask, and steps of its logarithm (nats), of numbers (units of the latents) and of a
deviation's logarithm, see `Prediction.round_for_search`. Between AVX2 and AVX-512 masks differ by 4e-8, so
that 2 % of photos have a pixel on another step."""
START_STEP = 1 / 4096
"""Steps of the points that searches start from, in units of the latents."""


def bin_centres(bins: int, fold: int = 1) -> np.ndarray:
    """Return the azimuths (bins,) float32 in the middle of equal bins of the circle, or of a part of it."""
    return (np.arange(bins, dtype=np.float32) + np.float32(0.5)) * np.float32(
        2 * math.pi / bins / max(fold, 1)
    )


def round_to_grid(numbers: np.ndarray, step: float) -> np.ndarray:
    """Return the numbers rounded to multiples of `step`, a power of two, so that results are exact."""
    return np.asarray(np.round(numbers / step) * step)


@dataclass(frozen=True)
class Prediction:
    """The network's predictions for N photos, before any fit.

    Attributes:
        azimuth: (N, bins) probabilities of equal bins, the first centred at half a bin, of the circle, or of
            the part of it in which views of the class differ: half of it, or a single bin.
        numbers: (N, M) mean of the regressed numbers, see `layout`; light in the heading frame.
        deviation: (N, M) standard deviations of these.
        mask: (N, H, W, 3) probabilities of each pixel's `MASK_CLASSES`.
        roll: (N,) clockwise turn of the photo, radians.
        presence: (N,) probability that the photo shows the object.
        symmetry: Symmetry of the class.
    """

    azimuth: np.ndarray
    numbers: np.ndarray
    deviation: np.ndarray
    mask: np.ndarray
    roll: np.ndarray
    presence: np.ndarray
    symmetry: Symmetry = field(default=Symmetry.NONE, kw_only=True)

    def __len__(self) -> int:
        return len(self.azimuth)

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """Return the arrays, without the symmetry."""
        return self.azimuth, self.numbers, self.deviation, self.mask, self.roll, self.presence

    def fold(self, symmetry: Symmetry) -> Prediction:
        """Return the prediction for a symmetric class: the sums of bins of the circle that look the same."""
        if symmetry is Symmetry.NONE:
            return self
        bins = self.azimuth.shape[1] // symmetry.fold if symmetry.fold else 1
        return replace(self, azimuth=self.azimuth.reshape(len(self), -1, bins).sum(1), symmetry=symmetry)

    @property
    def layout(self) -> LatentLayout:
        """Return the layout of the regressed numbers."""
        return layout_of_numbers(self.numbers.shape[1])

    def best(self) -> Latents:
        """Return the most probable explanation of each photo: (N,) latents."""
        _, azimuth = self.modes(1)
        return latents_of(self.numbers, azimuth[:, 0])

    @functools.cached_property
    def _modes(self) -> dict[bool, tuple[np.ndarray, np.ndarray]]:
        """Return the most peaks that `modes` found, broad and others; steps of a fit ask for the same."""
        return {}

    def modes(self, count: int, broad: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Return the `count` best separate peaks of azimuth: log weight (N, count) and radians (N, count).

        Of views that look the same there is one; where all do, a single one at 0: (N, 1).

        A peak is the circular mean over its bin and the two beside it on either hand; a `broad` one also over
        those that follow, up to a quarter turn, for as long as they have half of its height: where a handle
        is out of sight, all views that hide it. Its bins are then taken out before the next is sought.
        """
        if not self.symmetry.fold:
            return np.zeros((len(self), 1)), np.zeros((len(self), 1), np.float32)
        if broad in self._modes and self._modes[broad][0].shape[1] >= count:
            log_weight, azimuths = self._modes[broad]
            return log_weight[:, :count], azimuths[:, :count]
        bins = self.azimuth.shape[1]
        centres = bin_centres(bins)
        left = self.azimuth.astype(np.float64)
        weights, angles = [], []
        reach = max(2, bins // 4 if broad else 0)
        offsets = np.arange(-reach, reach + 1)
        for _ in range(count):
            smooth = np.sum([np.roll(left, offset, 1) for offset in range(-2, 3)], axis=0)
            near = (smooth.argmax(1)[:, None] + offsets) % bins
            high = np.take_along_axis(smooth, near, 1)
            high = high >= 0.5 * high[:, reach : reach + 1]
            high[:, reach - 2 : reach + 3] = True
            # From each side all bins up to the first that is lower.
            before, after = (
                high[:, reach::-1].cumprod(1)[:, ::-1],
                high[:, reach:].cumprod(1),
            )
            member = np.concatenate([before, after[:, 1:]], 1).astype(np.float64)
            mass = np.take_along_axis(left, near, 1) * member
            total = mass.sum(1)
            at = centres[near].astype(np.float64)
            angle = np.arctan2((mass * np.sin(at)).sum(1), (mass * np.cos(at)).sum(1))
            weights.append(np.log(np.maximum(total, 1e-9)))
            angles.append(np.where(total > 0, angle, at[:, reach]))
            np.put_along_axis(left, near, np.take_along_axis(left, near, 1) * (1 - member), 1)
        azimuths = (np.stack(angles, 1) % (2 * math.pi)).astype(np.float32) / np.float32(self.symmetry.fold)
        self._modes[broad] = np.stack(weights, 1), azimuths
        return self._modes[broad]

    def round_for_search(self) -> Prediction:
        """Return the same prediction in steps far above rounding, as searches start from it.

        Networks add up in another order on each kind of processor, and searches amplify a last digit. Masks
        are in steps of `MASK_STEP` nats, 0 below `MIN_MASK`; numbers of `NUMBER_STEP`; the logarithms of
        deviations of `DEVIATION_STEP`. Azimuth, by which ends are only compared, stays as it is.
        """
        mask, log_deviation = self.mask.astype(np.float64), np.log(self.deviation.astype(np.float64))
        coarse = np.exp(round_to_grid(np.log(np.maximum(mask, MIN_MASK)), MASK_STEP))
        rounded = replace(
            self,
            mask=np.where(mask < MIN_MASK, 0.0, coarse).astype(self.mask.dtype),
            numbers=round_to_grid(self.numbers, NUMBER_STEP),
            deviation=np.exp(round_to_grid(log_deviation, DEVIATION_STEP)).astype(self.deviation.dtype),
        )
        rounded.__dict__["_modes"] = self._modes
        return rounded

    @functools.cached_property
    def _smooth(self) -> np.ndarray:
        """Return the probability (bins,) float64 of the first photo's azimuth in a bin or two either side."""
        azimuth = self.azimuth[0].astype(np.float64)
        return np.asarray(np.sum([np.roll(azimuth, offset) for offset in range(-2, 3)], axis=0))

    def log_mass(self, azimuth: np.ndarray) -> np.ndarray:
        """Return log probability of the first photo's azimuth within 2.5 bins of each angle (B,), float64.

        Linear between bins, and at least log 0.001, so that no view is ruled out.
        """
        bins, fold = self.azimuth.shape[1], self.symmetry.fold
        if not fold:
            return np.zeros(np.shape(azimuth))
        at = (azimuth.astype(np.float64) * fold * bins / (2 * math.pi) - 0.5) % bins
        low = np.floor(at).astype(np.int64) % bins
        share = at - np.floor(at)
        mass = self._smooth[low] * (1 - share) + self._smooth[(low + 1) % bins] * share
        return np.asarray(np.log(np.maximum(mass, 1e-3)))

    def azimuth_offsets(self, azimuth: np.ndarray) -> np.ndarray:
        """Return radians (bins,) by which each bin of azimuth lies off one (); of views alike the least."""
        bins = self.azimuth.shape[1]
        centres = bin_centres(bins, self.symmetry.fold)
        return np.asarray(self.symmetry.difference(centres, azimuth))

    def __getitem__(self, index: slice) -> Prediction:
        return Prediction(*(array[index] for array in self.arrays), symmetry=self.symmetry)

    def clone(self) -> Prediction:
        """Return a copy with arrays of its own."""
        return Prediction(*(array.copy() for array in self.arrays), symmetry=self.symmetry)

    @staticmethod
    def concatenate(parts: Sequence[Prediction]) -> Prediction:
        """Concatenate the predictions of several batches."""
        columns = zip(*(part.arrays for part in parts), strict=True)
        return Prediction(*map(np.concatenate, columns), symmetry=parts[0].symmetry)
