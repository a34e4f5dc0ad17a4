"""Training of the map of objects of whole photos.

Pictures of several objects go through the trunk once; the map is trained on its features.
"""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional

from vig.io.checks import read_tensors, reading
from vig.recognition.object_map import BOX_SIDES, MAP_STRIDE
from vig_train.network.decoder import ObjectMap
from vig_train.network.network import RecognitionNetwork, bfloat16
from vig_train.network.weights import read_network, save_tensors
from vig_train.training.collages import PICTURES, SIDE, Box, draw_pictures
from vig_train.training.examples import Examples
from vig_train.training.loop import Trainer
from vig_train.training.presence import fit_presence
from vig_train.training.targets import TensorRows

CELLS = SIDE // MAP_STRIDE  # a side of a picture's map


@dataclass(frozen=True)
class MapTargets(TensorRows):
    """Targets of the map for N pictures.

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
    def stack(parts: "list[MapTargets]") -> "MapTargets":
        """Stack."""
        return MapTargets(
            *(torch.stack(values) for values in zip(*(vars(part).values() for part in parts), strict=True))
        )

    def mirror(self) -> "MapTargets":
        """Return the targets of pictures flipped left to right."""
        flipped = MapTargets(*(value.flip(-1) for value in vars(self).values()))
        return replace(flipped, box=flipped.box * flipped.box.new_tensor([-1, 1, 1, 1])[:, None, None])


@dataclass(frozen=True)
class MapTraining:
    """Training of a network's map of objects, all else staying as it is.

    Attributes:
        examples: Images of single objects, and some without.
        pictures: Number of pictures put together of them, in sixteens; each takes 140 kB.
        seed: Seed of pictures and order.
        mirror: Whether they may be mirrored.
        advance: Is called with the number of pictures that were made.
    """

    examples: Examples
    pictures: int
    seed: int
    mirror: bool = True
    advance: Callable[[int], None] = lambda pictures: None

    def run(self, network: RecognitionNetwork) -> None:
        """Train the map of a network in place."""
        network.eval()
        maps, targets = self._through_trunk(network)
        network.object_map.train()
        passes, batch = 12, 32  # each pass takes a sixteenth of the time in which the pictures are made

        def batches() -> Iterator[tuple[torch.Tensor, MapTargets]]:
            rng = np.random.default_rng([self.seed, 6])
            for _ in range(passes):
                for chosen in torch.from_numpy(rng.permutation(len(maps))).split(batch):
                    seen, wanted = maps[chosen].float(), targets[chosen]
                    flipped = self.mirror and rng.random() < 0.5
                    yield (seen.flip(3), wanted.mirror()) if flipped else (seen, wanted)

        def loss(pair: tuple[torch.Tensor, MapTargets]) -> dict[str, torch.Tensor]:
            return {"map": map_loss(network.object_map(pair[0]), pair[1])}

        parameters, steps = network.object_map.parameters(), passes * -(-len(maps) // batch)
        Trainer.adamw(parameters, loss, 2e-3, steps).steps(batches())
        network.eval()

    def _through_trunk(self, network: RecognitionNetwork) -> tuple[torch.Tensor, MapTargets]:
        """Return the trunk's features of pictures (N, C, h, w) float16, and the map's targets."""
        maps, targets = [], []
        for number in range(-(-self.pictures // PICTURES)):
            rng = np.random.default_rng([self.seed, number, 5])
            torch.manual_seed(int(rng.integers(2**31)))
            pictures, boxes = draw_pictures(self.examples, rng, self.mirror)
            with torch.inference_mode(), bfloat16(pictures.device):
                coarse = network.coarse_maps(pictures.contiguous(memory_format=torch.channels_last))
            maps.append(coarse.half())
            targets += [targets_of(each) for each in boxes]
            self.advance(len(pictures))
        return torch.cat(maps), MapTargets.stack(targets)


def add_object_map(start: Path, path: Path, training: MapTraining) -> None:
    """Write weights with a newly trained map, and a presence head fitted to its images; else as in `start`.

    Raises:
        UserError: `start` is no weights file.
    """
    network = read_network(start)
    settings = network.settings
    torch.manual_seed(training.seed)
    map_channels = 96  # channels of a map, which has 50,000 weights
    network.object_map = ObjectMap(sum(settings.channels[-2:]), map_channels)
    training.run(network)
    fit_presence(network, training.examples, training.seed)
    with reading(start, "recognition weights", "Take a file of `vig train`."):
        tensors, metadata = read_tensors(start, "pt")
    own = {
        f"network.{name}": value
        for name, value in network.state_dict().items()
        if name.startswith(("object_map.", "others."))
    }
    tensors = {name: value for name, value in tensors.items() if not name.startswith("network.object_map.")}
    tensors |= {name: value.half() if value.is_floating_point() else value for name, value in own.items()}
    settings = replace(settings, object_map=map_channels)
    save_tensors(path, tensors, metadata | {"settings": json.dumps(asdict(settings))})


def map_loss(numbers: torch.Tensor, targets: MapTargets) -> torch.Tensor:
    """Return the focal loss of centres (Law and Deng 2018), for each, and the mean error of boxes near them.

    numbers: (N, 5, h, w), see `ObjectMap`.
    """
    logit = numbers[:, 0]
    at_centre = targets.centre == 1
    probability = logit.sigmoid()
    # Exponents of the focal loss, of how wrong a cell is and how far from a centre (Law and Deng 2018).
    centre_focus, miss_focus = 2, 4
    hit = (1 - probability) ** centre_focus * functional.logsigmoid(logit)
    miss = (1 - targets.centre) ** miss_focus * probability**centre_focus * functional.logsigmoid(-logit)
    centres = -torch.where(at_centre, hit, miss)[targets.counts].sum() / at_centre.sum().clamp_min(1)
    # From .2 on, in cells or in logarithms, errors of boxes count linearly.
    errors = functional.smooth_l1_loss(numbers[:, 1:], targets.box, reduction="none", beta=0.2).sum(1)
    return centres + errors[targets.near].sum() / targets.near.sum().clamp_min(1)


def targets_of(boxes: list[Box]) -> MapTargets:
    """Return the targets of the map for a picture with these objects."""
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
        # An object with a visible share below .12 counts neither as present nor as absent.
        known = BOX_SIDES[0] <= max(x1 - x0, y1 - y0) <= BOX_SIDES[1] and seen >= 0.12
        if not known or not (0 <= x < CELLS and 0 <= y < CELLS):
            counts &= here < 0.1
            continue
        mine = (
            ((right - x).abs() < max(0.22 * w, 0.51))
            & ((down - y).abs() < max(0.22 * h, 0.51))
            & (here > centre)
        )
        size = torch.tensor([math.log(w), math.log(h)])
        numbers = torch.stack(torch.broadcast_tensors(x - right, y - down, *size))
        box, near = torch.where(mine, numbers, box), near | mine
        centre = torch.maximum(centre, here)
        found.append((int(y), int(x)))
    for row, column in found:
        centre[row, column], counts[row, column] = 1.0, True
    return MapTargets(centre, counts, box, near)
