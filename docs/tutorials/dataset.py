# %% [markdown]
# # A dataset, BOP, and a network of your own
#
# The generator needs no download: it makes rooms, objects and light, and every
# label is known exactly. This tutorial makes a small dataset, reads it in BOP's
# format, and trains a network on it: which pixels of a picture show the teapot?

# %%
import json
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
import torch
from PIL import Image
from torch import nn

folder = Path(tempfile.mkdtemp())


def run(command: str) -> None:
    """A command of vig, without what it prints."""
    arguments = [sys.executable, "-m", "vig", *shlex.split(command)]
    subprocess.run(arguments, check=True, stdout=subprocess.DEVNULL)


run(f"dataset make --out {folder}/pots --count 240 --split train --seed 5")
run(f"dataset make --out {folder}/pots --count 40 --split test --seed 5")
run(f"dataset export {folder}/pots --split test --to coco --out {folder}/coco")

# %% [markdown]
# All labels of an image are a row of a table; pictures, masks and poses are
# where BOP's tools expect them.

# %%
table = parquet.read_table(folder / "pots" / "train" / "latents.parquet")
for row in (
    table.select(["azimuth", "elevation", "occlusion", "cause", "finish"])
    .slice(0, 5)
    .to_pylist()
):
    print(row)
scene = folder / "pots" / "test" / "000000"
pose = json.loads((scene / "scene_gt.json").read_text())["0"][0]
print("rotation, row by row:", np.round(pose["cam_R_m2c"], 3))
print("translation, mm:", np.round(pose["cam_t_m2c"], 1))
coco = json.loads(next((folder / "coco").rglob("*.json")).read_text())
print(
    len(coco["images"]),
    "images and",
    len(coco["annotations"]),
    "annotations for COCO",
)

# %%
pictures = sorted((folder / "pots" / "train" / "000000" / "rgb").iterdir())[:16]
sheet = np.array([np.asarray(Image.open(path)) for path in pictures]).reshape(
    2, 8, 150, 150, 3
)
Image.fromarray(sheet.transpose(0, 2, 1, 3, 4).reshape(300, 1200, 3))


# %% [markdown]
# The splits share no asset: rooms, objects and designs of the test split are not
# in the training split.


# %%
def read(split: str) -> tuple[torch.Tensor, torch.Tensor]:
    """Pictures (N, 3, 50, 50) and masks of the visible object (N, 50, 50)."""
    place = folder / "pots" / split / "000000"
    names = sorted(path.stem for path in (place / "rgb").iterdir())
    seen = [
        Image.open(place / "rgb" / f"{name}.png").resize((50, 50)) for name in names
    ]
    masks = [
        Image.open(place / "mask_visib" / f"{name}_000000.png").resize((50, 50))
        for name in names
    ]
    stacked = (
        torch.tensor(np.array([np.asarray(one) for one in seen])).permute(
            0, 3, 1, 2
        )
        / 255.0
    )
    return stacked, torch.tensor(
        np.array([np.asarray(mask) > 127 for mask in masks])
    ).float()


torch.manual_seed(0)
torch.set_num_threads(2)
layers: list[nn.Module] = []
for inside, outside, dilation in (
    (5, 16, 1),
    (16, 24, 2),
    (24, 24, 4),
    (24, 24, 8),
    (24, 24, 16),
):
    layers += [
        nn.Conv2d(inside, outside, 3, padding=dilation, dilation=dilation),
        nn.BatchNorm2d(outside),
        nn.ReLU(),
    ]
network = nn.Sequential(*layers, nn.Conv2d(24, 1, 1))
across = torch.linspace(-1, 1, 50)
place = torch.stack(torch.meshgrid(across, across, indexing="ij"))


def predict(pictures: torch.Tensor) -> torch.Tensor:
    """Log odds (N, 50, 50); the network sees where a pixel is, too."""
    return network(
        torch.cat([pictures, place.expand(len(pictures), -1, -1, -1)], dim=1)
    )[:, 0]


def overlap(masks: torch.Tensor, truth: torch.Tensor) -> float:
    """Mean IoU."""
    both, either = (
        (masks * truth).sum((1, 2)),
        torch.maximum(masks, truth).sum((1, 2)),
    )
    return float((both / either.clamp(min=1)).mean())


pictures, masks = read("train")
unseen, truth = read("test")
optimizer = torch.optim.Adam(network.parameters(), lr=0.005)
for _ in range(24):
    for batch in torch.randperm(len(pictures)).split(20):
        optimizer.zero_grad()
        nn.functional.binary_cross_entropy_with_logits(
            predict(pictures[batch]), masks[batch]
        ).backward()
        optimizer.step()
network.eval()
with torch.no_grad():
    guessed = (predict(unseen) > 0).float()
usual = (masks.mean(0) > 0.5).float().expand_as(truth)
print(f"IoU of unseen pictures by the usual place: {overlap(usual, truth):.2f}")
print(f"IoU of unseen pictures by the network: {overlap(guessed, truth):.2f}")

# %% [markdown]
# This took 240 images and half a minute; accuracy grows with both. More images,
# path-traced ones (`--tier cycles`) and your own panoramas and objects:
# [datasets](../../dataset/), [the generated scenes](../../world/). vig's network
# is trained by `vig train`.
