"""Makes the packaged example photos (`src/vig_app/examples`): path-traced, photographed test scenes.

    VIG_BLENDER_PYTHON=blender/bin/python python examples/make_examples.py      # to install: docs/world.md

writes photos, masks, truth.json and shapes.safetensors and prints a table, in some five minutes. The photos
are chosen by a rule, before anything is fitted to them: for each level of LEVELS in turn, the first sample of
SEED

- that hides as much of the object as the level says, give or take TOLERANCE, in the masks;
- whose elevation is that of a usual photograph (ELEVATIONS), and whose object lies whole within the frame;
- whose object is neither under- nor overexposed in the photo (LUMA, MAX_CLIPPED);
- whose design, eighth of the circle of azimuths, panorama, room and occluders none of the photos before has.
"""

import argparse
import json
import math
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import numpy as np
from safetensors.numpy import save_file

from vig.io.files import atomic_write
from vig.parallel import set_thread_count
from vig.photo.images import write_png
from vig.scene import ObjectClass
from vig_app.examples import FOLDER
from vig_world.assets.target import target_vertices
from vig_world.composition.sampling import sample, target_occlusion
from vig_world.dataset.spec import SceneSpec
from vig_world.generation.job import take_photo
from vig_world.library import Library
from vig_world.raster.picture import Picture
from vig_world.renderers.cycles import CyclesRenderer
from vig_world.renderers.rasterized import render

CLASS_NAME, SPLIT, SEED = "teapot", "test", 20261122
LEVELS = (0.0, 0.15, 0.3, 0.45, 0.5, 0.6, 0.7, 0.75)
TOLERANCE = 0.01
ELEVATIONS = (10, 50)
"""Degrees."""
LUMA = (0.2, 0.75)
"""Bounds of the mean luma of the object's visible pixels, in [0, 1], sRGB."""
MAX_CLIPPED = 0.05
"""Share of these pixels of which a channel may be at white."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=FOLDER)
    parser.add_argument("--samples", type=int, default=128, help="paths per pixel")
    arguments = parser.parse_args()

    set_thread_count(1)
    object_class, library = ObjectClass.load(CLASS_NAME), Library(SPLIT)
    photos: list[dict] = []
    used: set[str] = set()
    shapes: dict[str, np.ndarray] = {}
    print("photo           sample  hidden  azimuth  elevation  design")
    with CyclesRenderer(library, object_class, samples=arguments.samples, threads=2) as cycles:
        for number, level in enumerate(LEVELS, 1):
            for spec in candidates(library, object_class, level):
                if used & marks(spec):
                    continue
                picture, _ = take_photo(cycles.render(spec), spec)
                if well_exposed(picture):
                    break
                print(f"    sample {spec.index} is passed over for its exposure", flush=True)
            used |= marks(spec)
            about = describe(f"{number:02d}_{occluder(spec)}", spec, picture)
            write(arguments.out, about["name"], picture)
            photos.append(about)
            shapes[about["name"]] = np.ascontiguousarray(target_vertices(spec, object_class))
            print(
                f"{about['name']:16}{spec.index:6}{about['occlusion']:8.3f}{about['azimuth_deg']:9.1f}"
                f"{about['elevation_deg']:11.1f}{spec.design:8}",
                flush=True,
            )
    described = {"format": 1, "class": CLASS_NAME, "photos": photos}
    with atomic_write(arguments.out / "truth.json") as temporary:
        temporary.write_text(json.dumps(described, indent=1) + "\n")
    with atomic_write(arguments.out / "shapes.safetensors") as temporary:
        save_file(shapes, temporary)
    print(arguments.out)


def candidates(library: Library, object_class: ObjectClass, level: float) -> Iterator[SceneSpec]:
    """Samples of SEED that fit a level as far as can be seen without path tracing, in their order."""
    for index in count():
        if abs(target_occlusion(SEED, index, SPLIT) - level) > 2 * TOLERANCE:
            continue
        spec = sample(library, object_class, SEED, index)
        if not ELEVATIONS[0] <= math.degrees(spec.elevation) <= ELEVATIONS[1]:
            continue
        picture = render(library, spec, object_class)
        if abs(picture.occlusion - level) <= TOLERANCE and not picture.shares["truncation"]:
            yield spec


def marks(spec: SceneSpec) -> set[str]:
    """What no other photo may share with this one."""
    eighth = int(spec.azimuth / (math.pi / 4))
    own = {f"{spec.design=}", f"{eighth=}", f"{spec.panorama=}", f"{spec.room.layout=}"}
    return own | {prop.family for prop in spec.props if prop.role == "occluder"}


def well_exposed(picture: Picture) -> bool:
    """Whether the object's visible pixels are neither too dark nor too bright, and hardly any is clipped."""
    pixels = picture.image[picture.visible] / 255
    luma = float((pixels @ [0.2126, 0.7152, 0.0722]).mean())
    return LUMA[0] <= luma <= LUMA[1] and (pixels.max(axis=1) == 1).mean() <= MAX_CLIPPED


def occluder(spec: SceneSpec) -> str:
    """What hides the object: the family of the prop that was placed last to do so."""
    families = [prop.family for prop in spec.props if prop.role == "occluder"]
    return families[-1] if families else "open" if spec.target < TOLERANCE else "furniture"


def describe(name: str, spec: SceneSpec, picture: Picture) -> dict:
    """A photo's entry of truth.json."""
    return {
        "name": name,
        "seed": spec.seed,
        "index": spec.index,
        "split": spec.split,
        "occlusion": picture.occlusion,
        "azimuth_deg": math.degrees(spec.azimuth),
        "elevation_deg": math.degrees(spec.elevation),
        "albedo": list(spec.albedo),
        "shape": list(spec.shape),
        "design": spec.design,
        "light": picture.light.tolist(),
    }


def write(out: Path, name: str, picture: Picture) -> None:
    """Write a photo and its masks."""
    write_png(out / f"{name}.png", picture.image)
    write_png(out / "masks" / f"{name}_amodal.png", picture.amodal)
    write_png(out / "masks" / f"{name}_visible.png", picture.visible)


if __name__ == "__main__":
    main()
