"""Cut-outs pasted before the objects of a batch: every step of a training hides other parts by other things.

Pasted objects make detectors and segmenters robust (Dwibedi et al. 2017; Ghiasi et al. 2021). The shares and
sizes below were set by looking at the images that they give, not by results of training with them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from PIL import Image
from torch.nn import functional

from vig_train.training.targets import TensorRows
from vig_world import Split
from vig_world.studio.cutouts import ModelCutouts, draw_cutout

SIDE, MARGIN = 128, 16  # pixels a side of a cut-out's picture, and those that are free about it
COUNT = 4096  # cut-outs that a training has
MORE = (1.0, 0.5, 0.3)  # shares of the pasted images that get a first, a second and a third one
MIN_HIDDEN, MAX_HIDDEN = 0.1, 0.85
"""An image's cut-outs hide no more of its object than a share drawn between these."""
SIZES = (0.25, 1.2)  # size of a cut-out, in sides of the object's box
NOWHERE = (25.0, 125.0)  # the box, from and to, of an object that is not in the image, pixels


Source = Callable[..., torch.Tensor]  # random numbers of any shape


@dataclass(frozen=True, eq=False)
class CutoutLibrary(TensorRows):
    """Cut-outs to paste.

    Attributes:
        rgba: (N, 4, SIDE, SIDE) uint8, sRGB and coverage.
    """

    rgba: torch.Tensor

    @staticmethod
    def draw(
        seed: int, split: Split, class_name: str, models: ModelCutouts | None, count: int = COUNT
    ) -> "CutoutLibrary":
        """Return so many cut-outs of a split's things and models that are not of a class."""
        rng = np.random.default_rng(np.random.SeedSequence([seed, 72]))
        pictures = np.zeros((count, SIDE, SIDE, 4), np.uint8)
        for picture in pictures:
            # Three quarters are of models in files, where there are such.
            of_file = models is not None and rng.random() < 0.75
            drawn = models.draw(rng) if models and of_file else draw_cutout(rng, split, class_name)
            cutout = drawn.convert("RGBA")
            cutout.thumbnail((SIDE - 2 * MARGIN,) * 2, Image.Resampling.LANCZOS)
            left, top = ((SIDE - length) // 2 for length in cutout.size)
            picture[top : top + cutout.height, left : left + cutout.width] = np.asarray(cutout)
        return CutoutLibrary(torch.from_numpy(pictures).permute(0, 3, 1, 2).contiguous())

    def paste(
        self, images: torch.Tensor, masks: torch.Tensor, share: float, rng: np.random.Generator
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return images (B, 3, H, W) with cut-outs before a share of their objects, and their masks.

        Args:
            images: sRGB in [0, 1].
            masks: (B, 2, H, W) shares of each pixel in which the object is seen, and in which it is hidden.
            share: Share of the images that get any.
            rng: Source of all randomness.
        """
        uniform, normal = _sources(rng, images)
        count = len(images)
        area, seen = masks.sum((1, 2, 3)), masks[:, 0].sum((1, 2))
        middle, lengths = _boxes(masks.sum(1))
        mean = (images * masks[:, :1]).sum((2, 3)) / seen.clamp_min(1)[:, None]
        least_left = 1 - MIN_HIDDEN - (MAX_HIDDEN - MIN_HIDDEN) * uniform(count)
        chosen = uniform(count) < share
        for share_of_these in MORE:
            size = lengths.amax(1) * SIZES[0] * (SIZES[1] / SIZES[0]) ** uniform(count)
            places = middle + lengths * 1.2 * (uniform(count, 2) - 0.5)
            colour, cover = self._draw_cutouts(places, size, rng, images)
            own = (colour * cover).sum((2, 3)) / cover.sum((2, 3)).clamp_min(1)
            gain = torch.exp(0.2 * normal(count, 1) + 0.06 * normal(count, 3))
            # A quarter of the cut-outs get the object's mean colour.
            alike = (uniform(count) < 0.25) & (seen > 0)
            towards = ((mean + 0.03) / (own + 0.03)) ** (0.5 + 0.5 * uniform(count, 1))
            gain = torch.where(alike[:, None], towards, gain)[:, :, None, None]
            left = (masks[:, :1] * (1 - cover)).sum((1, 2, 3))
            taken = chosen & (uniform(count) < share_of_these) & ((left > least_left * area) | (area == 0))
            cover = cover * taken[:, None, None, None]
            # A share of .4 of the cut-outs softly darkens its surroundings.
            dark = 0.4 * uniform(count) * (uniform(count) < 0.4)
            images = images * (1 - dark[:, None, None, None] * _beside(cover))
            images = images + cover * ((colour * gain).clamp(0, 1) - images)
            newly_hidden = masks[:, :1] * cover
            masks = masks + torch.cat([-newly_hidden, newly_hidden], 1)
        return images, masks

    def _draw_cutouts(
        self, places: torch.Tensor, size: torch.Tensor, rng: np.random.Generator, like: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Draw colour (B, 3, H, W) and coverage (B, 1, H, W) of cut-outs about places (B, 2), pixels."""
        uniform, normal = _sources(rng, like)
        count, _, height, width = like.shape
        index = torch.from_numpy(rng.integers(len(self.rgba), size=count)).to(like.device)
        picture = self.rgba[index].to(like.dtype) / 255
        picture = torch.cat([picture[:, :3] * picture[:, 3:], picture[:, 3:]], 1)
        upright = uniform(count) < 0.85
        angle = torch.where(upright, 0.14 * normal(count), 2 * math.pi * uniform(count))
        flip = torch.where(uniform(count) < 0.5, -1.0, 1.0)
        # From output to input, both in [-1, 1]; the cut-out is smaller than its picture by the margin.
        scale = size / width * SIDE / (SIDE - 2 * MARGIN)
        cos, sin = torch.cos(angle) / scale, torch.sin(angle) / scale
        x, y = (2 * places / places.new_tensor([width, height]) - 1).unbind(1)
        across = torch.stack([cos, sin, -cos * x - sin * y], 1) * flip[:, None]
        down = torch.stack([-sin, cos, sin * x - cos * y], 1)
        grid = functional.affine_grid(
            torch.stack([across, down], 1), [count, 4, height, width], align_corners=False
        )
        drawn = functional.grid_sample(picture, grid, align_corners=False)
        return drawn[:, :3] / drawn[:, 3:].clamp_min(1e-3), drawn[:, 3:]


def _sources(rng: np.random.Generator, like: torch.Tensor) -> tuple[Source, Source]:
    """Return uniform and normal numbers of any shape as tensors."""

    def uniform(*shape: int) -> torch.Tensor:
        return torch.from_numpy(rng.random(shape)).to(like)

    def normal(*shape: int) -> torch.Tensor:
        return torch.from_numpy(rng.normal(size=shape)).to(like)

    return uniform, normal


def _boxes(cover: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return middles (B, 2) and lengths (B, 2), in x and y, of covers (B, H, W); see `NOWHERE`."""
    least, most = [], []
    for axis in (1, 2):
        on = (cover > 0.5).any(axis).float()
        there, last = on.amax(1) > 0, on.shape[1] - on.flip(1).argmax(1).float()
        least.append(torch.where(there, on.argmax(1).float(), NOWHERE[0]))
        most.append(torch.where(there, last, NOWHERE[1]))
    low, high = torch.stack(least, 1), torch.stack(most, 1)
    return (low + high) / 2, high - low


def _beside(cover: torch.Tensor) -> torch.Tensor:
    """Return a soft shadow below and to the right of a cover (B, 1, H, W)."""
    shifted = functional.pad(cover, (2, 0, 3, 0))[:, :, : cover.shape[2], : cover.shape[3]]
    return functional.avg_pool2d(shifted, 13, 1, 6)
