"""The output of a renderer of synthetic scenes."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

CANVAS = 3
"""The whole silhouette is drawn on a canvas this many times as wide and high as the image, as BOP does."""


@dataclass(frozen=True)
class Picture:
    """A rendered sample.

    Attributes:
        image: (H, W, 3) uint8 sRGB.
        depth: (H, W) float32 metres along the optical axis, the nearest of a pixel's samples.
        amodal, visible: (H, W) bool, pixels of the object alone and as seen; at least half of the pixel's
            samples. visible is a part of amodal.
        by_support: (H, W) bool, pixels of amodal that the room or its furniture hides; the other hidden ones
            are behind props.
        canvas: (3H, 3W) bool, the object alone on a canvas whose middle third is the image: pixels outside
            are cut off by the frame.
        light: (9,) float32, SH of incident radiance at the object's place, world frame, at the paper's
            exposure.
        normals: (H, W, 3) float32 unit normals in the camera's frame where `depth` was found, 0 where there
            is nothing; None where they were not asked for.
    """

    image: np.ndarray
    depth: np.ndarray
    amodal: np.ndarray
    visible: np.ndarray
    by_support: np.ndarray
    canvas: np.ndarray
    light: np.ndarray
    normals: np.ndarray | None = field(default=None, kw_only=True)

    @property
    def occlusion(self) -> float:
        """Return 1 - visible / alone, pixels within the frame, as in the paper."""
        return 1.0 - _count(self.visible) / _count(self.amodal)

    @cached_property
    def shares(self) -> dict[str, float]:
        """Return shares of the canvas's silhouette lost to an `occluder`, a `support` and to `truncation`."""
        whole = _count(self.canvas)
        hidden = self.amodal & ~self.visible
        support = _count(hidden & self.by_support)
        return {
            "occluder": (_count(hidden) - support) / whole,
            "support": support / whole,
            "truncation": 1.0 - _count(self.amodal) / whole,
        }

    @property
    def cause(self) -> str:
        """Return the greatest of `shares`, `none` when nothing is lost."""
        shares = self.shares
        cause = max(shares, key=lambda name: shares[name])
        return cause if shares[cause] > 0 else "none"


def _count(mask: np.ndarray) -> float:
    return float(np.count_nonzero(mask))
