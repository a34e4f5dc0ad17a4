"""Path-traces exported scenes for `benchmarks.self_shadow`: `python self_shadow_cycles.py FOLDER SETTING`.

Runs where `examples/render_cycles.py` runs and uses it. For every FOLDER/NAME.npz that
`vig.synthesis.build.export` wrote it leaves FOLDER/SETTING/NAME.npz with the arrays of that script.
SETTING is `alone` (the object in the panorama), `support` (on a plain Lambertian plate, 1.6 m square, of
the grey albedo `support_albedo` in NAME.json) or `scene` (everything).
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
import render_cycles as cycles

PLATE_HALF = 0.8
PLATE_BELOW = 0.0005
"""Metres under the object, so that the two do not flicker through each other."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("setting", choices=["alone", "support", "scene"])
    parser.add_argument("--samples", type=int, default=128)
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    (arguments.folder / arguments.setting).mkdir(exist_ok=True)
    cycles.MASK_SAMPLES = 32
    material = cycles.material

    def with_plate(about: dict, texture: np.ndarray) -> bpy.types.Material:
        return material({**about, "name": "target"} if about["name"] == "plate" else about, texture)

    cycles.material = with_plate
    for path in sorted(arguments.folder.glob("*.npz")):
        out = arguments.folder / arguments.setting / path.name
        if out.exists():
            continue
        described = json.loads(path.with_suffix(".json").read_text())
        with np.load(path) as stored:
            arrays = dict(stored)
        if arguments.setting != "scene":
            described["instances"] = described["instances"][:1]
        if arguments.setting == "support":
            described["instances"].append({"name": "plate", "kind": "paint", "roughness": 1.0})
            arrays.update(plate(described["support_albedo"]))
        results = cycles.trace(described, arrays, arguments.samples, arguments.threads, alone=False)
        partial = out.with_suffix(".partial.npz")
        np.savez_compressed(partial, **results)
        partial.rename(out)


def plate(albedo: float) -> dict[str, np.ndarray]:
    """Instance 1: a square under the object."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32) * PLATE_HALF
    return {
        "1_vertices": np.column_stack([corners, np.full(4, -PLATE_BELOW, np.float32)]),
        "1_faces": np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        "1_uv": np.zeros((4, 2), np.float32),
        "1_normals": np.tile(np.array([0, 0, 1], np.float32), (4, 1)),
        "1_texture": np.full((1, 1, 3), albedo, np.float32),
    }


if __name__ == "__main__":
    main()
