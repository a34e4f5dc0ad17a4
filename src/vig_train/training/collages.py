"""Pictures of several objects, put together from images of single ones.

Every other one is a mosaic of images (Bochkovskiy et al. 2020); the others have objects and pieces of images
pasted onto an image without one.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch.nn import functional

from vig.photo.masks import box_of
from vig_train.training.augmentation import Augmentation
from vig_train.training.examples import Examples

SIDE = 304  # side of a picture, pixels
TILES, TILES_SHARES = (1, 2, 3), (0.4, 0.4, 0.2)
"""Images along the side of a quarter of a mosaic, and how often."""
PICTURES = 16  # pictures that are put together at once, of the same images

Box = tuple[float, float, float, float, float]
"""Left, top, right, bottom in a picture's pixels, and the share of the object that is seen."""


@dataclass(frozen=True)
class Tile:
    """An image for a picture.

    Attributes:
        image: (3, S, S) sRGB in [0, 1].
        object: (S, S) share of each pixel that the object takes, hidden or not.
        box: Round it, in sides of the image, and the share of it that is seen; None where there is no object.
    """

    image: torch.Tensor
    object: torch.Tensor
    box: Box | None

    def boxes_at(self, left: float, top: float, side: float) -> list[Box]:
        """Return its box in a picture into which it is put; none where it has no object."""
        if self.box is None:
            return []
        x0, y0, x1, y1, seen = self.box
        return [(left + side * x0, top + side * y0, left + side * x1, top + side * y1, seen)]


def draw_pictures(
    examples: Examples, rng: np.random.Generator, mirror: bool = True
) -> tuple[torch.Tensor, list[list[Box]]]:
    """Return `PICTURES` pictures (N, 3, SIDE, SIDE), sRGB in [0, 1], and the boxes of each one's objects."""
    # 96 images are augmented at a time.
    chosen = rng.choice(len(examples), min(96, len(examples)), replace=False)
    tiles = _tiles(examples[torch.from_numpy(chosen)], rng, mirror)
    without = [tile for tile in tiles if tile.box is None]
    endless = _draw_tiles(tiles, rng)
    pictures, boxes = [], []
    for number in range(PICTURES):
        if number % 2 and without:
            picture, placed = _paste_tiles(without[rng.integers(len(without))], endless, rng)
        else:
            picture, placed = _mosaic(endless, rng)
        pictures.append(picture)
        boxes.append(placed)
    return torch.stack(pictures), boxes


def _tiles(examples: Examples, rng: np.random.Generator, mirror: bool) -> list[Tile]:
    """Return augmented images as tiles."""
    augment = Augmentation() if mirror else replace(Augmentation(), flip=0.0)
    batch = augment(examples, rng)
    side = batch.images.shape[2]
    shares = functional.interpolate(batch.mask, size=(side, side), mode="bilinear")
    tiles = []
    for image, share, present in zip(batch.images, shares, batch.present, strict=True):
        whole = 1 - share[2]
        box = box_of((whole > 0.5).numpy()) if present else None
        seen = float(share[0].sum() / whole.sum().clamp_min(1.0))
        corners = None
        if box is not None:
            x, y, w, h = box
            corners = (x / side, y / side, (x + w) / side, (y + h) / side, seen)
        tiles.append(Tile(image, whole, corners))
    return tiles


def _draw_tiles(tiles: list[Tile], rng: np.random.Generator) -> Iterator[Tile]:
    """Yield tiles at random, without end."""
    while True:
        yield tiles[rng.integers(len(tiles))]


def _mosaic(tiles: Iterator[Tile], rng: np.random.Generator) -> tuple[torch.Tensor, list[Box]]:
    """Return images side by side, in quarters of their own sizes."""
    picture, boxes = torch.zeros(3, SIDE, SIDE), []
    for left in (0, SIDE // 2):
        for top in (0, SIDE // 2):
            count = int(rng.choice(TILES, p=TILES_SHARES))
            edges = np.linspace(0, SIDE // 2, count + 1).astype(int)
            for x, end in zip(edges, edges[1:], strict=False):
                for y in edges[:-1]:
                    tile, side = next(tiles), int(end - x)
                    rows, columns = slice(top + y, top + y + side), slice(left + x, left + x + side)
                    picture[:, rows, columns] = _resize(tile.image, side)
                    boxes += tile.boxes_at(left + x, top + y, side)
    return picture, boxes


def _paste_tiles(
    ground: Tile, tiles: Iterator[Tile], rng: np.random.Generator
) -> tuple[torch.Tensor, list[Box]]:
    """Return objects, and pieces of images, on an image without an object."""
    picture, boxes = _resize(ground.image, SIDE), list[Box]()
    pasted = (48.0, 220.0)  # sides of images that are pasted, pixels
    # One to five images on a picture.
    for _ in range(int(rng.integers(1, 5 + 1))):
        tile = next(tiles)
        side = int(math.exp(rng.uniform(math.log(pasted[0]), math.log(pasted[1]))))
        left, top = (int(each) for each in rng.integers(-side // 4, SIDE - side + side // 4 + 1, 2))
        placed, square = tile.boxes_at(left, top, side), (left, top, left + side, top + side, 1.0)
        # Three in ten images with an object are pasted whole, with soft edges.
        alone = bool(placed) and rng.random() > 0.3
        cover = tile.object if alone else _soft_square(len(tile.object))
        rows, columns = slice(max(top, 0), top + side), slice(max(left, 0), left + side)
        inside = slice(max(-top, 0), SIDE - top), slice(max(-left, 0), SIDE - left)
        image, cover = _resize(tile.image, side)[:, *inside], _resize(cover[None], side)[:, *inside]
        picture[:, rows, columns] = torch.lerp(picture[:, rows, columns], image, cover)
        covering = placed[0] if alone else square
        boxes = [(*box[:4], box[4] * (1 - _share_inside(box, covering))) for box in boxes]
        boxes += [(*box[:4], box[4] * _share_inside(box, (0, 0, SIDE, SIDE, 1.0))) for box in placed]
    return picture, boxes


def _share_inside(box: Box, other: Box) -> float:
    """Return the share of a box that lies in another."""
    across = max(0.0, min(box[2], other[2]) - max(box[0], other[0])) / (box[2] - box[0])
    down = max(0.0, min(box[3], other[3]) - max(box[1], other[1])) / (box[3] - box[1])
    return across * down


def _soft_square(side: int) -> torch.Tensor:
    """Return (S, S) cover of a piece with soft edges."""
    off = (torch.arange(side) + 0.5 - side / 2).abs() / (side / 2)
    # The edge is .15 halves of the image's side wide.
    return ((1 - torch.maximum(off[:, None], off[None])) / 0.15).clamp(0, 1)


def _resize(image: torch.Tensor, side: int) -> torch.Tensor:
    return functional.interpolate(image[None], (side, side), mode="bilinear", antialias=True)[0]
