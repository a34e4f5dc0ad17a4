"""Augmentation of a batch, so that a network trained on drawn images holds on photographs.

Flips, framing, roll, things pasted in front, uneven light, and a camera: exposure, colour, blur, noise.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch.nn import functional

from vig.recognition.network import mirror_prediction
from vig_train.training.examples import Examples
from vig_train.training.pasting import CutoutLibrary
from vig_train.training.targets import Targets, cell_shares

GAMMA = 2.2  # sRGB is nearly linear light to the power of one over this


@dataclass(frozen=True)
class Batch(Targets):
    """Input of a step of training, with its targets.

    Attributes:
        images: (B, 3, H, W) sRGB in [0, 1].
        mask: (B, 3, h, w) shares of the mask head's cells.
    """

    images: torch.Tensor
    mask: torch.Tensor


@dataclass(frozen=True)
class Augmentation:
    """Amounts of change.

    Attributes:
        flip: Share of images that are mirrored.
        reframe: Share of images that are shifted, magnified and turned, as boxes drawn by hand are.
        shift: Standard deviation of the shift, in widths.
        magnify: Standard deviation of the log magnification.
        turn: Standard deviation of the turn, radians.
        turned: Share of those whose turn is uniform up to `most_turn`, radians, instead.
        cut_out: Share of images that have a piece of another pasted over.
        pasted: Share of images that get cut-outs before their object, where there is a library of them.
        relight: Standard deviation of the log of a smooth field of light.
        exposure: Standard deviation in stops.
        balance: Standard deviation of log white balance.
        grey: Share of images without colour.
        blur: Share of batches that are blurred.
        most_blur: Largest blur, pixels.
        noise: Largest standard deviation of noise, sRGB.
    """

    flip: float = 0.5
    reframe: float = 0.6
    shift: float = 0.05
    magnify: float = 0.1
    turn: float = 0.08
    turned: float = 0.15
    most_turn: float = 0.6
    cut_out: float = 0.25
    pasted: float = 0.6
    relight: float = 0.12
    exposure: float = 0.15
    balance: float = 0.03
    grey: float = 0.02
    blur: float = 0.4
    most_blur: float = 0.9
    noise: float = 0.03

    def __call__(
        self, examples: Examples, rng: np.random.Generator, library: CutoutLibrary | None = None
    ) -> Batch:
        """Return randomly changed examples, on their device, which is the library's, too."""
        images = examples.images.permute(0, 3, 1, 2).float().div(255)
        masks = torch.stack([examples.visible, examples.hidden], 1).float().div(255)
        present = examples.present()
        azimuth, numbers, roll = examples.azimuth, examples.numbers, examples.roll
        flipped = torch.from_numpy(rng.random(len(images)) < self.flip).to(images.device)
        mirrored_azimuth, mirrored_numbers = map(
            torch.from_numpy, mirror_prediction(azimuth.cpu().numpy(), numbers.cpu().numpy())
        )
        azimuth = torch.where(flipped, mirrored_azimuth, azimuth)
        numbers = torch.where(flipped[:, None], mirrored_numbers, numbers)
        roll = torch.where(flipped, -roll, roll)
        images, masks, turn = self._reframe(images, masks, flipped, rng)
        if library is None:
            images, masks = self._paste(images, masks, rng)
        else:
            images, masks = library.paste(images, masks, self.pasted, rng)
        images = self._photograph(images, rng).contiguous(memory_format=torch.channels_last)
        return Batch(azimuth, numbers, roll + turn, present, images, cell_shares(*masks.unbind(1)))

    def _reframe(
        self, images: torch.Tensor, masks: torch.Tensor, flipped: torch.Tensor, rng: np.random.Generator
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Mirror, shift, magnify and turn each image with its masks; return the turns (B,), too."""
        count = len(images)
        reframed = rng.random(count) < self.reframe
        turned_far = rng.random(count) < self.turned
        turn = reframed * np.where(
            turned_far, rng.uniform(-1, 1, count) * self.most_turn, rng.normal(0, self.turn, count)
        )
        size = np.exp(reframed * rng.normal(0, self.magnify, count))
        matrix = np.zeros((count, 2, 3), np.float32)
        # From output to input: a picture turned clockwise is read counter-clockwise.
        matrix[:, 0, 0], matrix[:, 0, 1] = np.cos(turn) / size, np.sin(turn) / size
        matrix[:, 1, 0], matrix[:, 1, 1] = -np.sin(turn) / size, np.cos(turn) / size
        matrix[:, :, 2] = reframed[:, None] * rng.normal(0, 2 * self.shift, (count, 2))
        matrix[:, 0] *= np.where(flipped.cpu().numpy(), -1, 1)[:, None]
        grid = functional.affine_grid(
            torch.from_numpy(matrix).to(images), list(images.shape), align_corners=False
        )
        # The filled border must not reveal that the picture was turned.
        outside = "border" if rng.random() < 0.5 else "reflection"
        warped = functional.grid_sample(images, grid, padding_mode=outside, align_corners=False)
        warped_masks = functional.grid_sample(masks, grid, padding_mode="zeros", align_corners=False)
        return warped, warped_masks, torch.from_numpy(turn.astype(np.float32)).to(images)

    def _paste(
        self, images: torch.Tensor, masks: torch.Tensor, rng: np.random.Generator
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Paste pieces of the batch's images over others; covered parts of the object are hidden."""
        count, _, height, width = images.shape
        pasted_on = rng.random(count) < self.cut_out
        if not pasted_on.any() or count < 2:
            return images, masks
        targets = np.flatnonzero(pasted_on)
        pieces = torch.from_numpy(blobs(len(targets), height, width, rng)).to(images)[:, None]
        sources = torch.from_numpy((targets + rng.integers(1, count, len(targets))) % count).to(images.device)
        target_index = torch.from_numpy(targets).to(images.device)
        images, masks = images.clone(), masks.clone()
        images[target_index] = torch.lerp(
            images[target_index], images[sources].roll(int(rng.integers(width)), 3), pieces
        )
        newly_hidden = masks[target_index, 0] * pieces[:, 0]
        masks[target_index, 0] -= newly_hidden
        masks[target_index, 1] += newly_hidden
        return images, masks

    def _photograph(self, images: torch.Tensor, rng: np.random.Generator) -> torch.Tensor:
        """Apply uneven light, exposure and white balance, then blur and noise."""
        count, _, height, width = images.shape
        gain = rng.normal(0, self.exposure * np.log(2), (count, 1)) + rng.normal(0, self.balance, (count, 3))
        field = torch.from_numpy(rng.normal(0, self.relight, (count, 1, 4, 4))).to(images)
        field = field + torch.from_numpy(gain[:, :, None, None]).to(images)
        light = functional.interpolate((field / GAMMA).exp(), (height, width), mode="bilinear")
        images = images * light
        grey = torch.from_numpy(rng.random(count) < self.grey).to(images.device)
        if grey.any():
            images[grey] = images[grey].mean(1, keepdim=True).expand(-1, 3, -1, -1)
        if rng.random() < self.blur:
            images = _blur(images, float(rng.uniform(0.2, self.most_blur)))
        noise = torch.randn_like(images) * float(rng.uniform(0, self.noise))
        return (images + noise).clamp(0, 1)


def blobs(count: int, height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Return random convex pieces (count, H, W) float32 in {0, 1}: ellipses and boxes, turned."""
    centre = rng.uniform(0.1, 0.9, (count, 2)) * [width, height]
    reach = np.exp(rng.uniform(np.log(0.05), np.log(0.3), (count, 2))) * width
    angle, power = rng.uniform(0, np.pi, count), rng.choice([2.0, 8.0], count)
    x = np.arange(width)[None, None] + 0.5 - centre[:, 0, None, None]
    y = np.arange(height)[None, :, None] + 0.5 - centre[:, 1, None, None]
    cos, sin = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    along, across = np.abs(cos * x + sin * y), np.abs(cos * y - sin * x)
    power = power[:, None, None]
    inside: np.ndarray = (along / reach[:, 0, None, None]) ** power + (
        across / reach[:, 1, None, None]
    ) ** power < 1
    return inside.astype(np.float32)


def _blur(images: torch.Tensor, deviation: float) -> torch.Tensor:
    """Blur images (B, 3, H, W) by a Gaussian of `deviation` pixels."""
    offsets = torch.arange(-2, 3, device=images.device, dtype=images.dtype)
    kernel = torch.softmax(-0.5 * (offsets / deviation) ** 2, 0)
    padded = functional.pad(images, (2, 2, 2, 2), mode="replicate")
    height, width = images.shape[2:]
    rows = sum((kernel[i] * padded[:, :, i : i + height] for i in range(5)), padded.new_zeros(1))
    return sum((kernel[i] * rows[:, :, :, i : i + width] for i in range(5)), padded.new_zeros(1))
