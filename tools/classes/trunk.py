"""Training of the trunk that all classes share, on hundreds of kinds of things at once.

    python -m tools.classes.trunk OUT --meshes CATALOGUES [--images N] [--epochs N] [--start WEIGHTS]

Each image shows a packaged prop, a model of a furniture catalogue, or an object of a packaged class, before
a ground, among other things, mostly covered in part. The network learns where its front is, its elevation,
roll and mean colour, and which pixels show it: one head for all kinds, as in Orient Anything (Wang et al.
2024), so that what the trunk learns holds for kinds that it has not seen. Fronts are those of the catalogues.

OUT/trunk.safetensors is a trunk as `vig.recognition.weights.TRUNK_FILE`. Images are kept in OUT, and
the training resumes after each epoch, on a GPU where there is one. Catalogues (`sweethome3d-furniture` of
Debian, 130 MB; without Scopia's 70 MB) are unpacked once, in three minutes. With 16 cores 100,000 images take
some five minutes; on two cores and no GPU 20,000 take a quarter of an hour and an epoch of these as long.
Heads are to be trained anew on another trunk: weights files name the one that they go with.
"""

import argparse
import functools
import math
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from vig.io.checks import read_tensors
from vig.io.errors import UserError
from vig.io.progress import Meter
from vig.parallel import map_in_processes
from vig.recognition.network import NetworkSettings
from vig.recognition.weights import TRUNK_PREFIXES
from vig.scene import IMAGE_SIZE, Latents, ObjectClass, regressed_layout
from vig_train.network.weights import save_tensors
from vig_train.training.examples import Examples
from vig_train.training.training import TrainingSettings, train_on_examples
from vig_world import Split
from vig_world.assets.coats import any_colour
from vig_world.assets.models import packaged_props, vary
from vig_world.assets.things import Prop
from vig_world.studio.cutouts import model_cutouts, render_view
from vig_world.studio.grounds import cast_shadow, draw_ground
from vig_world.studio.layers import Layer, continue_border, photograph, place_of
from vig_world.studio.studio import Studio, StudioSettings
from vig_world.studio.things import draw_thing, occlude

CHUNK = 128
"""Images of a file."""
CLASSES = ("teapot", "mug", "car")
CLASS_SHARE, PROP_SHARE = 0.25, 0.2
"""Shares of the images that show objects of the packaged classes, and packaged props."""
LAYOUT = regressed_layout(1)
"""Numbers that are learned; those that a kind lacks, shape and light, are 0."""


class ManyKinds:
    """Draws images of many kinds of things of a split: image and truth as `Examples` hold them."""

    def __init__(self, meshes: str, split: Split, seed: int) -> None:
        self.split, self.seed, self.settings = split, seed, StudioSettings(level=0.35)
        self.models = model_cutouts(meshes, split, "")
        self.model = functools.cache(self.models.thing)  # some 2 GB of 600 models
        self.props = [(kind, model) for kind, each in packaged_props(split).items() for model in each]
        self.studios = [Studio(ObjectClass.load(name), self.settings, split) for name in CLASSES]

    def draw(self, index: int) -> dict[str, np.ndarray]:
        """Return image (H, W, 3), azimuth, numbers (M,), roll, visible and hidden (H, W)."""
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, index, 72]))
        kind = rng.random()
        if kind < CLASS_SHARE:
            image = self.studios[int(rng.integers(len(CLASSES)))].draw(self.seed, index)
            latents = Latents.from_vector(torch.from_numpy(image.latents)[None])
            return {
                "images": image.image,
                "azimuth": latents.azimuth[0].numpy(),
                "numbers": _numbers(float(latents.elevation), latents.albedo[0].numpy()),
                "roll": np.float32(image.roll),
                "visible": image.visible,
                "hidden": image.hidden,
            }
        return self._draw_thing(rng, kind < CLASS_SHARE + PROP_SHARE)

    def _draw_thing(self, rng: np.random.Generator, packaged: bool) -> dict[str, np.ndarray]:
        settings = self.settings
        shown = self._thing(rng, packaged)
        azimuth = rng.uniform(0, 2 * math.pi)
        low, high = ((-4, 15), (15, 42), (42, 89))[int(rng.choice(3, p=[0.35, 0.4, 0.25]))]
        elevation = math.radians(rng.uniform(low, high))
        rolled = rng.random() < settings.rolled
        roll = float(rng.uniform(-1, 1) * settings.most_roll if rolled else rng.normal(0, settings.roll))
        # Fronts of catalogues look along -y, those of classes along +x.
        distance = math.exp(rng.uniform(math.log(3.2), math.log(12)))  # nearer views leave the picture
        cutout = render_view(rng, shown, (azimuth - math.pi / 2, elevation, roll), IMAGE_SIZE, distance)
        ground = draw_ground(rng, self.split, roll)
        layer = _placed(rng, cutout)
        place = place_of(layer.cover)
        albedo = _mean_colour(layer)
        picture = cast_shadow(rng, ground, layer.cover, place)
        colours = [albedo, any_colour(rng)]
        for _ in range(int(rng.choice([0, 1, 2, 3], p=[0.4, 0.3, 0.2, 0.1]))):
            picture = draw_thing(rng, self.split, colours, place, False, self.models).over(picture)
        picture = layer.over(picture)
        visible = layer.cover
        if rng.random() < settings.occluded:
            things = (self.split, colours, place, self.models)
            picture, visible = occlude(rng, picture, layer.cover, settings.most_hidden, *things)
        image = photograph(rng, picture)
        if rng.random() < settings.continued:
            image = continue_border(rng, image, layer.cover > 0)
        return {
            "images": image,
            "azimuth": np.float32(azimuth),
            "numbers": _numbers(elevation, albedo),
            "roll": np.float32(roll),
            "visible": np.round(255 * visible).astype(np.uint8),
            "hidden": (np.round(255 * layer.cover) - np.round(255 * visible)).astype(np.uint8),
        }

    def _thing(self, rng: np.random.Generator, packaged: bool) -> Prop:
        if packaged:
            family, model = self.props[int(rng.integers(len(self.props)))]
            return Prop(family, vary(model.read(), rng))
        for name in rng.permutation(self.models.files):
            if (shown := self.model(str(name))) is not None:
                return shown
        raise UserError(f"{self.models.root}: expected models that can be drawn; none can. Give others.")


def _numbers(elevation: float, albedo: np.ndarray) -> np.ndarray:
    """Return regressed numbers (M,), with neither shape nor light."""
    parts = {"shape": np.zeros(1), "elevation": [elevation], "albedo": albedo, "light": np.zeros(9)}
    rows = {name: torch.tensor(np.asarray(part, np.float32))[None] for name, part in parts.items()}
    return LAYOUT.join(rows)[0].numpy()


def _placed(rng: np.random.Generator, cutout: np.ndarray) -> Layer:
    """Return a view of a thing (H, W, 4) linear, in the middle of a picture, about as boxes frame it.

    A thing that is not seen at all (a sheet from its edge) is an empty layer.
    """
    if not cutout[..., 3].any():
        return Layer(
            np.zeros((IMAGE_SIZE, IMAGE_SIZE, 3), np.float32), np.zeros((IMAGE_SIZE,) * 2, np.float32)
        )
    small = rng.random() < 0.1
    side = rng.uniform(0.3, 0.6) if small else 0.714 * math.exp(rng.normal(0, 0.11))
    shift = rng.uniform(-0.25, 0.25, 2) if small else rng.normal(0, 0.05, 2)
    rows, columns = np.nonzero(cutout[..., 3])
    cutout = cutout[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    height, width = cutout.shape[:2]
    factor = side * IMAGE_SIZE / max(height, width)
    scaled = torch.nn.functional.interpolate(
        torch.from_numpy(cutout.transpose(2, 0, 1))[None],
        (max(1, round(height * factor)), max(1, round(width * factor))),
        mode="bilinear",
        antialias=True,
    )[0].numpy()
    canvas = np.zeros((4, 3 * IMAGE_SIZE, 3 * IMAGE_SIZE), np.float32)
    high, wide = scaled.shape[1:]
    row = round((1.5 + shift[1]) * IMAGE_SIZE - high / 2)
    column = round((1.5 + shift[0]) * IMAGE_SIZE - wide / 2)
    canvas[:, row : row + high, column : column + wide] = scaled
    canvas = canvas[:, IMAGE_SIZE : 2 * IMAGE_SIZE, IMAGE_SIZE : 2 * IMAGE_SIZE]
    colour = canvas[:3] / np.maximum(canvas[3], 1e-6)
    gain = np.exp(rng.normal(0, 0.25)) * np.exp(rng.normal(0, 0.05, 3))
    return Layer((colour.transpose(1, 2, 0) * gain).astype(np.float32), canvas[3].clip(0, 1))


def _mean_colour(layer: Layer) -> np.ndarray:
    covered = layer.cover > 0.5
    return layer.colour[covered].mean(0).clip(0, 1) if covered.any() else np.full(3, 0.5)


def _prepare(shared: tuple[str, str, int]) -> Callable[[tuple[Split, int]], None]:
    folder, meshes, seed = shared
    drawn: dict[Split, ManyKinds] = {}

    def work(item: tuple[Split, int]) -> None:
        split, chunk = item
        if split not in drawn:
            drawn[split] = ManyKinds(meshes, split, seed)
        many = drawn[split]
        rows = [many.draw(index) for index in range(chunk * CHUNK, (chunk + 1) * CHUNK)]
        columns = {name: torch.from_numpy(np.stack([row[name] for row in rows])) for name in rows[0]}
        save_tensors(_path(Path(folder), item), columns)

    return work


def _path(folder: Path, item: tuple[Split, int]) -> Path:
    return folder / f"{item[0]}-{item[1]:05d}.safetensors"


def draw(
    folder: Path, meshes: str, counts: dict[Split, int], seed: int, workers: int
) -> dict[Split, Examples]:
    """Return so many images of each split, or a few more; those whose files are there are not drawn again."""
    folder.mkdir(parents=True, exist_ok=True)
    items = [(split, chunk) for split, count in counts.items() for chunk in range(-(-count // CHUNK))]
    missing = [item for item in items if not _path(folder, item).exists()]
    with Meter(CHUNK * len(items), CHUNK * (len(items) - len(missing)), unit="images") as meter:
        for _ in map_in_processes(_prepare, (str(folder), meshes, seed), missing, workers):
            meter.advance(CHUNK)
    parts: dict[Split, list[Examples]] = {}
    for item in items:
        parts.setdefault(item[0], []).append(Examples(**read_tensors(_path(folder, item), "pt")[0]))
    return {split: Examples.concatenate(each) for split, each in parts.items()}


def main(arguments: list[str] | None = None) -> None:
    """Draw, train, and write the trunk."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--meshes", required=True)
    parser.add_argument("--images", type=int, default=24_000)
    parser.add_argument("--epochs", type=int, default=6)
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--frozen", type=int, default=1, help="stages that stay as they are in --start")
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--start", type=Path, help="weights whose trunk it begins with")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args(arguments)
    counts: dict[Split, int] = {"train": options.images, "validation": max(CHUNK, options.images // 20)}
    source = f"{model_cutouts(options.meshes, 'train', '').fingerprint}-{options.seed}"
    drawn = draw(options.out / f"images-{source}", options.meshes, counts, options.seed, options.workers)
    settings = TrainingSettings(
        epochs=options.epochs,
        batch=options.batch,
        start=options.start,
        trunk_only=True,
        frozen=options.frozen,
        learning_rate=options.rate,
        network=replace(NetworkSettings(), modes=1, squeezed=112, features=512),
        seed=options.seed,
        threads=options.workers,
    )
    train_count, held_out = len(drawn["train"]), len(drawn["validation"])
    chosen, validated = torch.arange(train_count), torch.arange(train_count, train_count + held_out)
    examples = Examples.concatenate([drawn["train"], drawn["validation"]])
    run = f"{settings.fingerprint([])} {train_count} {source}"
    path = train_on_examples(examples, chosen, validated, options.out, settings, run, progress=True)
    tensors, _ = read_tensors(path)
    trunk = {name.removeprefix("network."): value for name, value in tensors.items()}
    kept = {
        name: torch.from_numpy(np.array(value))
        for name, value in trunk.items()
        if name.startswith(TRUNK_PREFIXES)
    }
    save_tensors(options.out / "trunk.safetensors", kept)
    print(options.out / "trunk.safetensors")


if __name__ == "__main__":
    main()
