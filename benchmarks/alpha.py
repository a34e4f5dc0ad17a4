"""alpha learned from a dataset: `python -m benchmarks.alpha --dataset D [--count N] [--map FILE]`.

Prints the mean visible share of all pixels that the object covers; writes the share at each pixel of the
image as a `.npy` file, which `ExplainSettings(visible_prior=torch.from_numpy(...))` takes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch

from vig.dataset import read_dataset
from vig.files import atomic_write
from vig.likelihood import visible_map, visible_share


def main() -> None:
    """Read masks evenly spread over the split, print alpha, and write the map where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dataset", type=Path, required=True)
    parser.add_argument("--split", default="train")
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--map", type=Path)
    arguments = parser.parse_args()
    dataset = read_dataset(arguments.dataset, arguments.split)
    chosen = np.unique(np.linspace(0, len(dataset) - 1, arguments.count).astype(int))
    visible, amodal = (torch.from_numpy(dataset.read(kind, chosen)) for kind in ("mask_visib", "mask"))
    print(f"alpha {visible_share(visible, amodal):.4f} over {len(chosen)} images")
    if arguments.map:
        with atomic_write(arguments.map) as temporary, open(temporary, "wb") as file:
            np.save(file, visible_map(visible, amodal).numpy())


if __name__ == "__main__":
    main()
