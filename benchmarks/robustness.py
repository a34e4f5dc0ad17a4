"""Strange scenes in numbers: `python -m benchmarks.robustness [--count 10000] [--seed 0]`.

Random latents far outside what a fit visits, eyes inside or behind the object, objects out of the frame or
filling it, images from 1 x 1 up: values, gradients and normal matrices must be finite. Prints how many were
tried and what was not finite; exits with 1 if anything was.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

import numpy as np
import torch

from vig.likelihood import GAUSSIAN, ROBUST, Likelihood, Photos
from vig.likelihood.kernels.geometry import Geometry
from vig.scene import Camera, ObjectClass

SIZES = ((1, 1), (1, 40), (33, 7), (48, 64), (75, 75), (150, 150))


@dataclass(frozen=True)
class Tally:
    """How many scenes were tried, showed any of the object, and gave a number that is not finite."""

    tried: int
    seen: int
    broken: int


def try_scenes(count: int, seed: int, device: str = "cpu") -> Tally:
    """Evaluate `count` random scenes in single precision."""
    rng = np.random.default_rng(seed)
    teapot = ObjectClass.load("teapot")
    geometry = Geometry(teapot.shape_model, torch.float32, device)
    tried = seen = broken = 0
    while tried < count:
        height, width = SIZES[rng.integers(len(SIZES))]
        focal = width * np.exp(rng.normal(0.1, 1.0))
        centre = rng.uniform(-0.5, 1.5, 2) * (width, height)
        distance = rng.choice([0.4, 0.05, 0.0, -0.3, 3.0])
        camera = Camera(width, height, focal, centre[0], centre[1], distance, teapot.target_height)
        number = min(50, count - tried)
        photo = torch.from_numpy(rng.uniform(0, 1, (1, height, width, 3)))
        model = ROBUST if rng.random() < 0.7 else GAUSSIAN
        likelihood = Likelihood(geometry, camera, Photos(photo, model.log_prior(height, width)[None]))
        points = torch.from_numpy(_points(rng, number, geometry.rows.modes)).float()
        sigma = torch.from_numpy(np.exp(rng.normal(-3, 1, number))).float()
        found = likelihood.at(points, torch.zeros(number, dtype=torch.int32), sigma, images=True)
        finite = torch.ones(number, dtype=torch.bool)
        for tensor in vars(found).values():
            finite &= torch.isfinite(tensor).reshape(number, -1).all(1).cpu()
        tried += number
        broken += int((~finite).sum())
        seen += int((found.coverage.reshape(number, -1).amax(1) > 0).sum())
    return Tally(tried, seen, broken)


def _points(rng: np.random.Generator, count: int, modes: int) -> np.ndarray:
    """Points (count, P'): shape up to many deviations, any pose, colour beyond [0, 1], any light."""
    spread = np.exp(rng.normal(0, 1, (count, 1)))
    return np.concatenate(
        [
            rng.normal(size=(count, modes)) * spread,
            rng.uniform(-7, 7, (count, 2)),
            rng.normal(0.5, 1.0, (count, 3)),
            rng.normal(size=(count, 9)) * spread * 3,
            rng.normal(size=(count, 3)) * 0.3,
        ],
        axis=1,
    )


def main() -> None:
    """Try, print, and fail if anything broke."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cpu")
    arguments = parser.parse_args()
    tally = try_scenes(arguments.count, arguments.seed, arguments.device)
    print(f"{tally.tried} scenes, {tally.seen} with something in view, {tally.broken} not finite")
    sys.exit(1 if tally.broken else 0)


if __name__ == "__main__":
    main()
