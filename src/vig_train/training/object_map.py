"""Training of the map of objects of whole photos, on pictures put together from images of single objects.

Half of the pictures are mosaics of images (Bochkovskiy et al. 2020), the others have objects and pieces of
images pasted onto an image without one. They go through the trunk once; the map is trained on what it makes
of them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file
from torch.nn import functional

from vig.io.checks import read_tensors, reading
from vig.io.files import atomic_write
from vig.photo.masks import box_of
from vig.recognition import Recognizer
from vig.recognition.network import RecognitionNetwork, bfloat16
from vig.recognition.object_map import BOX_SIDES, MAP_STRIDE, ObjectMap
from vig_train.training.augmentation import Augmentation
from vig_train.training.examples import Examples
from vig_train.training.schedule import Schedule

SIDE = 304
"""Of a picture, pixels."""
CELLS = SIDE // MAP_STRIDE
TILES = (1, 2, 3)
"""Images along the side of a quarter of a mosaic."""
TILES_SHARES = (0.4, 0.4, 0.2)
PASTED = (48.0, 220.0)
"""Sides of images that are pasted, pixels."""
MOST_PASTED = 5
PIECE_SHARE = 0.3
"""Share of pasted images with an object of which not the object alone is pasted, but all, with soft edges."""
IMAGES = 96
"""That are augmented at a time."""
PICTURES = 16
"""That are made of them."""
LEAST_SHOWN = 0.12
"""Share of an object, or of its box, that is seen: with less it counts neither as there nor as absent."""
MAP_CHANNELS = 96
"""Of a map; it has 50,000 weights."""
PASSES = 12
"""Over the pictures; each takes a sixteenth of the time in which they are made."""
BATCH = 32
LEARNING_RATE = 2e-3
"""The highest."""
CENTRE_FOCUS, MISS_FOCUS = 2, 4
"""Exponents of the focal loss, of how wrong a cell is and how far from a centre (Law and Deng 2018)."""
BOX_UNIT = 0.2
"""Error of a box, in cells or in logarithms, from which it counts linearly."""

Box = tuple[float, float, float, float, float]
"""Left, top, right, bottom in a picture's pixels, and the share of the object that is seen."""


@dataclass(frozen=True)
class Targets:
    """What the map of N pictures should say.

    Attributes:
        centre: (N, h, w) 1 where a centre lies, falling off about it.
        counts: (N, h, w) whether a cell's centre counts.
        box: (N, 4, h, w) as `NUMBERS` of a cell.
        near: (N, h, w) whether a cell's box counts.
    """

    centre: torch.Tensor
    counts: torch.Tensor
    box: torch.Tensor
    near: torch.Tensor

    @staticmethod
    def joined(parts: list[Targets]) -> Targets:
        """Stacked."""
        return Targets(
            *(torch.stack(values) for values in zip(*(vars(part).values() for part in parts), strict=True))
        )

    def __getitem__(self, chosen: torch.Tensor) -> Targets:
        return Targets(*(value[chosen] for value in vars(self).values()))

    def mirrored(self) -> Targets:
        """Of pictures flipped left to right."""
        flipped = Targets(*(value.flip(-1) for value in vars(self).values()))
        return replace(flipped, box=flipped.box * flipped.box.new_tensor([-1, 1, 1, 1])[:, None, None])


def train_object_map(
    network: RecognitionNetwork,
    examples: Examples,
    pictures: int,
    seed: int,
    mirror: bool = True,
    advance: Callable[[int], None] = lambda pictures: None,
) -> None:
    """Train a network's map in place, all else staying as it is.

    Args:
        network: With a map.
        examples: Images of single objects, and some without.
        pictures: That are put together of them; each takes 140 kB.
        seed: Of pictures and order.
        mirror: Whether they may be mirrored.
        advance: Is called with the number of pictures that were made.
    """
    network.eval()
    maps, targets = _pictures_through_trunk(network, examples, pictures, seed, mirror, advance)
    network.object_map.train()
    optimizer = torch.optim.AdamW(
        network.object_map.parameters(), LEARNING_RATE, weight_decay=2e-2, fused=True
    )
    rng, rate, step = (
        np.random.default_rng([seed, 6]),
        Schedule(LEARNING_RATE, PASSES * -(-len(maps) // BATCH)),
        0,
    )
    for _ in range(PASSES):
        for chosen in torch.from_numpy(rng.permutation(len(maps))).split(BATCH):
            seen, wanted = maps[chosen].float(), targets[chosen]
            if mirror and rng.random() < 0.5:
                seen, wanted = seen.flip(3), wanted.mirrored()
            for group in optimizer.param_groups:
                group["lr"] = rate(step)
            optimizer.zero_grad()
            map_loss(network.object_map(seen), wanted).backward()
            optimizer.step()
            step += 1
    network.eval()


def add_object_map(
    start: Path,
    path: Path,
    examples: Examples,
    pictures: int,
    seed: int,
    mirror: bool = True,
    advance: Callable[[int], None] = lambda pictures: None,
) -> None:
    """Write weights with a newly trained map; all else is as in `start`. See `train_object_map`.

    Raises:
        UserError: `start` is no weights file.
    """
    recognizer = Recognizer(start)
    network, settings = recognizer.network, recognizer.network.settings
    torch.manual_seed(seed)
    network.object_map = ObjectMap(sum(settings.channels[-2:]), MAP_CHANNELS)
    train_object_map(network, examples, pictures, seed, mirror, advance)
    with reading(start, "recognition weights", "Take a file of `vig train`."):
        tensors, metadata = read_tensors(start, "pt")
    own = {f"network.object_map.{name}": value for name, value in network.object_map.state_dict().items()}
    tensors = {name: value for name, value in tensors.items() if not name.startswith("network.object_map.")}
    tensors |= {name: value.half() if value.is_floating_point() else value for name, value in own.items()}
    described = json.dumps(asdict(replace(settings, object_map=MAP_CHANNELS)))
    with atomic_write(path) as temporary:
        save_file(tensors, temporary, metadata=metadata | {"settings": described})


def map_loss(numbers: torch.Tensor, targets: Targets) -> torch.Tensor:
    """Focal loss of centres (Law and Deng 2018), for each of them, and the mean error of boxes near them.

    numbers: (N, 5, h, w), see `ObjectMap`.
    """
    logit = numbers[:, 0]
    at_centre = targets.centre == 1
    probability = logit.sigmoid()
    hit = (1 - probability) ** CENTRE_FOCUS * functional.logsigmoid(logit)
    miss = (1 - targets.centre) ** MISS_FOCUS * probability**CENTRE_FOCUS * functional.logsigmoid(-logit)
    centres = -torch.where(at_centre, hit, miss)[targets.counts].sum() / at_centre.sum().clamp_min(1)
    errors = functional.smooth_l1_loss(numbers[:, 1:], targets.box, reduction="none", beta=BOX_UNIT).sum(1)
    return centres + errors[targets.near].sum() / targets.near.sum().clamp_min(1)


def targets_of(boxes: list[Box]) -> Targets:
    """What the map of a picture with these objects should say."""
    middle = torch.arange(CELLS) + 0.5
    down, right = middle[:, None], middle[None]
    centre, counts = torch.zeros(CELLS, CELLS), torch.ones(CELLS, CELLS, dtype=torch.bool)
    box, near = torch.zeros(4, CELLS, CELLS), torch.zeros(CELLS, CELLS, dtype=torch.bool)
    found = []
    for x0, y0, x1, y1, seen in boxes:
        w, h = (x1 - x0) / MAP_STRIDE, (y1 - y0) / MAP_STRIDE
        x, y = (x0 + x1) / 2 / MAP_STRIDE, (y0 + y1) / 2 / MAP_STRIDE
        spread = ((right - x) / (0.12 * w + 0.25)) ** 2 + ((down - y) / (0.12 * h + 0.25)) ** 2
        here = torch.exp(-0.5 * spread)
        known = BOX_SIDES[0] <= max(x1 - x0, y1 - y0) <= BOX_SIDES[1] and seen >= LEAST_SHOWN
        if not known or not (0 <= x < CELLS and 0 <= y < CELLS):
            counts &= here < 0.1
            continue
        mine = (
            ((right - x).abs() < max(0.22 * w, 0.51))
            & ((down - y).abs() < max(0.22 * h, 0.51))
            & (here > centre)
        )
        numbers = torch.stack(
            [x - right + 0 * down, y - down + 0 * right, *torch.full((2, CELLS, CELLS), 0.0)]
        )
        numbers[2], numbers[3] = math.log(w), math.log(h)
        box, near = torch.where(mine, numbers, box), near | mine
        centre = torch.maximum(centre, here)
        found.append((int(y), int(x)))
    for row, column in found:
        centre[row, column], counts[row, column] = 1.0, True
    return Targets(centre, counts, box, near)


# -- pictures ---------------------------------------------------------------------------------------------


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

    def placed(self, left: float, top: float, side: float) -> list[Box]:
        """Its box in a picture at whose place it is put; none where it has no object."""
        if self.box is None:
            return []
        x0, y0, x1, y1, seen = self.box
        return [(left + side * x0, top + side * y0, left + side * x1, top + side * y1, seen)]


def _pictures_through_trunk(
    network: RecognitionNetwork,
    examples: Examples,
    count: int,
    seed: int,
    mirror: bool,
    advance: Callable[[int], None],
) -> tuple[torch.Tensor, Targets]:
    """Pictures' maps (N, C, h, w) float16, and what the map should say."""
    maps, targets = [], []
    for number in range(-(-count // PICTURES)):
        rng = np.random.default_rng([seed, number, 5])
        torch.manual_seed(int(rng.integers(2**31)))
        pictures, boxes = draw_pictures(examples, rng, mirror)
        with torch.inference_mode(), bfloat16(pictures.device):
            maps.append(network.coarse_maps(pictures.contiguous(memory_format=torch.channels_last)).half())
        targets += [targets_of(each) for each in boxes]
        advance(len(pictures))
    return torch.cat(maps), Targets.joined(targets)


def draw_pictures(
    examples: Examples, rng: np.random.Generator, mirror: bool = True
) -> tuple[torch.Tensor, list[list[Box]]]:
    """`PICTURES` pictures (N, 3, SIDE, SIDE), sRGB in [0, 1], and the boxes of each one's objects."""
    chosen = rng.choice(len(examples), min(IMAGES, len(examples)), replace=False)
    tiles = _tiles(examples[torch.from_numpy(chosen)], rng, mirror)
    without = [tile for tile in tiles if tile.box is None]
    endless = (tiles[rng.integers(len(tiles))] for _ in iter(int, 1))
    pictures, boxes = [], []
    for number in range(PICTURES):
        if number % 2 and without:
            picture, placed = _pasted(without[rng.integers(len(without))], endless, rng)
        else:
            picture, placed = _mosaic(endless, rng)
        pictures.append(picture)
        boxes.append(placed)
    return torch.stack(pictures), boxes


def _tiles(examples: Examples, rng: np.random.Generator, mirror: bool) -> list[Tile]:
    """Augmented images."""
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


def _mosaic(tiles: Iterator[Tile], rng: np.random.Generator) -> tuple[torch.Tensor, list[Box]]:
    """Images side by side, in quarters of their own sizes."""
    picture, boxes = torch.zeros(3, SIDE, SIDE), []
    for left in (0, SIDE // 2):
        for top in (0, SIDE // 2):
            count = int(rng.choice(TILES, p=TILES_SHARES))
            edges = np.linspace(0, SIDE // 2, count + 1).astype(int)
            for x, end in zip(edges, edges[1:], strict=False):
                for y in edges[:-1]:
                    tile, side = next(tiles), int(end - x)
                    rows, columns = slice(top + y, top + y + side), slice(left + x, left + x + side)
                    picture[:, rows, columns] = _resized(tile.image, side)
                    boxes += tile.placed(left + x, top + y, side)
    return picture, boxes


def _pasted(ground: Tile, tiles: Iterator[Tile], rng: np.random.Generator) -> tuple[torch.Tensor, list[Box]]:
    """Objects, and pieces of images, on an image without an object."""
    picture, boxes = _resized(ground.image, SIDE), list[Box]()
    for _ in range(int(rng.integers(1, MOST_PASTED + 1))):
        tile = next(tiles)
        side = int(math.exp(rng.uniform(math.log(PASTED[0]), math.log(PASTED[1]))))
        left, top = (int(each) for each in rng.integers(-side // 4, SIDE - side + side // 4 + 1, 2))
        placed, square = tile.placed(left, top, side), (left, top, left + side, top + side, 1.0)
        alone = bool(placed) and rng.random() > PIECE_SHARE
        cover = tile.object if alone else _soft_square(len(tile.object))
        rows, columns = slice(max(top, 0), top + side), slice(max(left, 0), left + side)
        inside = slice(max(-top, 0), SIDE - top), slice(max(-left, 0), SIDE - left)
        image, cover = _resized(tile.image, side)[:, *inside], _resized(cover[None], side)[:, *inside]
        picture[:, rows, columns] = torch.lerp(picture[:, rows, columns], image, cover)
        covering = placed[0] if alone else square
        boxes = [(*box[:4], box[4] * (1 - _share_inside(box, covering))) for box in boxes]
        boxes += [(*box[:4], box[4] * _share_inside(box, (0, 0, SIDE, SIDE, 1.0))) for box in placed]
    return picture, boxes


def _share_inside(box: Box, other: Box) -> float:
    """Share of a box that lies in another."""
    across = max(0.0, min(box[2], other[2]) - max(box[0], other[0])) / (box[2] - box[0])
    down = max(0.0, min(box[3], other[3]) - max(box[1], other[1])) / (box[3] - box[1])
    return across * down


def _soft_square(side: int) -> torch.Tensor:
    """(S, S) cover of a piece with soft edges."""
    off = (torch.arange(side) + 0.5 - side / 2).abs() / (side / 2)
    return ((1 - torch.maximum(off[:, None], off[None])) / 0.15).clamp(0, 1)


def _resized(image: torch.Tensor, side: int) -> torch.Tensor:
    resized: torch.Tensor = functional.interpolate(
        image[None], (side, side), mode="bilinear", antialias=True
    )[0]
    return resized
