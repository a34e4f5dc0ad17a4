"""Makes the photos of `vig demo` (`src/vig_app/demo`): eight test scenes, path traced and photographed.

    VIG_BLENDER_PYTHON=blender/bin/python python examples/make_demo.py --traced traced      # docs/world.md

writes photos, masks, truth.json and shapes.safetensors, in 65 to 83 seconds of a core a photo. What has been
path traced lies in the folder `--traced` and is not traced again.

They are a show, not a benchmark: their scenes were chosen by eye among some 440 rasterised ones
(`--sheet SHEET.png` draws those chosen), as photos that a person would take; the folder's README says more.
"""

import argparse
import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image
from safetensors.numpy import save_file

from vig.io.files import atomic_write
from vig.parallel import set_thread_count
from vig.photo.images import write_png
from vig.scene import ObjectClass
from vig_app.demo import FOLDER
from vig_world.assets.target import target_vertices
from vig_world.composition.sampling import sample
from vig_world.dataset.spec import SceneSpec
from vig_world.library import Library
from vig_world.raster.view import View
from vig_world.renderers.cycles import CyclesRenderer
from vig_world.renderers.photo import PhotoSettings, photograph
from vig_world.renderers.rasterized import render
from vig_world.streams import stream

SPLIT, SIZE, QUALITY = "test", 800, 90
SMALLER = 0.72
"""Factor of the object's size in the frame, so that some of what surrounds it is seen."""
LEVELS = (0.0, 0.12, 0.25, 0.35)
"""Shares to be hidden, of the samples in turn."""
CAMERA_STREAM = 2**20 + 46
"""Number of the random stream of the cameras."""
MIN_ELECTRONS = 6000.0
"""A pixel at white, so that noise is that of a bright room."""


@dataclass(frozen=True)
class Shot:
    """A photo: its name, a title, what it is asked for, the sample that it shows, and its exposure, stops."""

    name: str
    title: str
    asked: str
    shows: str
    seed: int
    index: int
    exposure: float = 0.1
    samples: int = 24


SHOTS = (
    Shot("01_orange", "An orange teapot", "teapot", "teapot", 4613, 96),
    Shot("02_tulips", "A teapot behind tulips", "teapot", "teapot", 4613, 1355),
    Shot("03_apple", "A mug behind an apple", "mug", "mug", 4612, 9),
    Shot("04_milk", "A teapot behind a milk carton", "teapot", "teapot", 4613, 234, exposure=-0.6),
    Shot("05_egg_cup", "A mug behind an egg", "mug", "mug", 4612, 429, exposure=0.35),
    Shot("06_bowl", "A teapot behind a bowl", "teapot", "teapot", 4613, 765),
    Shot("07_tomato", "A mug whose handle cannot be seen", "mug", "mug", 4612, 77),
    Shot("08_no_pot", "A photo without a teapot", "teapot", "mug", 4612, 119),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=FOLDER)
    parser.add_argument("--traced", type=Path, default=Path("traced"), help="folder of traced pictures")
    parser.add_argument("--sheet", type=Path, help="only rasterise the scenes, into this picture")
    arguments = parser.parse_args()

    set_thread_count(1)
    library = Library(SPLIT)
    if arguments.sheet:
        write_png(arguments.sheet, sheet(library))
        return
    arguments.traced.mkdir(parents=True, exist_ok=True)
    photos, shapes = [], {}
    for shot in SHOTS:
        object_class, spec = scene(library, shot)
        path = arguments.traced / f"{shot.shows}_{shot.seed}_{shot.index}.npz"
        if not path.exists():
            trace(library, object_class, spec, shot, path)
        with np.load(path) as traced:
            about = describe(shot, spec, traced)
            write(arguments.out, shot, spec, traced)
        photos.append(about)
        shapes[shot.name] = target_vertices(spec, object_class).astype(np.float16)
        print(f"{shot.name:12}{about['occlusion']:6.2f}{about['azimuth_deg']:7.1f}", flush=True)
    with atomic_write(arguments.out / "truth.json") as temporary:
        temporary.write_text(json.dumps({"format": 1, "photos": photos}, indent=1) + "\n")
    with atomic_write(arguments.out / "shapes.safetensors") as temporary:
        save_file(shapes, temporary)
    print(arguments.out)


def scene(library: Library, shot: Shot) -> tuple[ObjectClass, SceneSpec]:
    """The class and the scene of a shot."""
    object_class = ObjectClass.load(shot.shows)
    target = LEVELS[shot.index % len(LEVELS)]
    return object_class, sample(library, object_class, shot.seed, shot.index, smaller=SMALLER, target=target)


def trace(library: Library, object_class: ObjectClass, spec: SceneSpec, shot: Shot, path: Path) -> None:
    """Path trace a scene into a file of arrays."""
    with CyclesRenderer(library, object_class, samples=shot.samples, threads=2, size=SIZE) as cycles:
        picture = cycles.render(spec)
    arrays = {name: getattr(picture, name) for name in ("visible", "amodal", "light")}
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, linear=picture.linear.astype(np.float16), **arrays)


def describe(shot: Shot, spec: SceneSpec, traced: np.lib.npyio.NpzFile) -> dict:
    """A photo's entry of truth.json."""
    return {
        "name": shot.name,
        "title": shot.title,
        "asked": shot.asked,
        "shows": shot.shows,
        "seed": spec.seed,
        "index": spec.index,
        "split": spec.split,
        "occlusion": 1 - int(traced["visible"].sum()) / int(traced["amodal"].sum()),
        "azimuth_deg": math.degrees(spec.azimuth),
        "elevation_deg": math.degrees(spec.elevation),
        "albedo": list(spec.albedo),
        "light": traced["light"].tolist(),
    }


def write(out: Path, shot: Shot, spec: SceneSpec, traced: np.lib.npyio.NpzFile) -> None:
    """Photograph a traced picture, and write the photo and its masks."""
    rng = stream(spec.seed, spec.index, spec.split, CAMERA_STREAM)
    drawn = PhotoSettings.draw(rng)
    electrons = max(drawn.electrons, MIN_ELECTRONS)
    settings = replace(
        drawn, exposure=shot.exposure, motion=0.0, electrons=electrons, quality=QUALITY, chroma=True
    )
    photo, _ = photograph(traced["linear"].astype(np.float32), rng, settings)
    with atomic_write(out / f"{shot.name}.jpg") as temporary:
        Image.fromarray(photo).save(temporary, "JPEG", quality=QUALITY, subsampling="4:2:0")
    for mask in ("visible", "amodal"):
        write_png(out / "masks" / f"{shot.name}_{mask}.png", traced[mask])


def sheet(library: Library, size: int = 300, columns: int = 4) -> np.ndarray:
    """The chosen scenes, rasterised, side by side: (H, W, 3) uint8."""
    pictures = []
    for shot in SHOTS:
        object_class, spec = scene(library, shot)
        view = View.of_scene(spec, object_class, size)
        pictures.append(render(library, spec, object_class, view).image)
    rows = [np.concatenate(pictures[n : n + columns], 1) for n in range(0, len(pictures), columns)]
    return np.concatenate(rows)


if __name__ == "__main__":
    main()
