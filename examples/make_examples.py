"""Makes the packaged example photos (`src/vig/examples`): scenes of the generator, path-traced with Cycles.

Two environments, because Blender's module needs numpy < 2 and Python 3.11 and is under the GPL:

    python3.11 -m venv cycles && cycles/bin/pip install bpy==4.5.14 "numpy<2"      # Blender, nothing of vig
    python examples/make_examples.py --blender-python cycles/bin/python            # the one that vig is in
    python examples/make_examples.py --blender-python cycles/bin/python --check    # conventions, no photos

The first installs some 400 MB. The second writes photos, masks and truth.json, and prints a table; it takes
about five minutes on two cores. The third renders the first scene's object alone in its panorama and
compares it with vig's own model: light, albedo, silhouette.

The scenes are of the split "test": none of their props, textures and panoramas occurs in training. They
were picked by eye from raster previews, for plausibility and variety, before anything was fitted to them.
The packaged photos are scenes of the first version of the world (commit 291229e); the present one makes
other scenes of the same seeds, which this script writes when it is run today.

Exposure and white balance are a photographer's with a grey card: the panorama's scale is chosen, per colour
channel, so that L00 of the light that arrives at the object's place (object removed) is
`vig.scene.EXPOSURE_L00`. That local light, grey, is the truth of the latent `light`.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import torch

from vig.examples import FOLDER
from vig.files import atomic_write
from vig.images import write_png
from vig.render import rasterize
from vig.scene import (
    EXPOSURE_L00,
    ObjectClass,
    exposed,
    grey,
    irradiance,
    project_panorama,
    vertex_normals,
)
from vig.synthesis.build import export
from vig.synthesis.library import Library
from vig.synthesis.rendering import render
from vig.synthesis.sampling import sample
from vig.synthesis.spec import SceneSpec
from vig.synthesis.target import target_vertices
from vig.synthesis.view import View

CLASS_NAME = "teapot"
CHOSEN = {
    "01_open": (7, 20),
    "02_canister": (11, 90),
    "03_bottle": (11, 159),
    "04_plant": (11, 182),
    "05_beaker": (11, 171),
    "06_jug": (7, 158),
    "07_jar": (7, 196),
    "08_pot": (7, 38),
}
"""Name of each photo: seed and index of its scene in the split "test"."""

TRACER = Path(__file__).with_name("render_cycles.py")


def main() -> None:
    parser = argparse.ArgumentParser(description="Make the packaged example photos with Cycles.")
    parser.add_argument("--blender-python", type=Path, required=True, help="a Python that can import bpy")
    parser.add_argument("--out", type=Path, default=FOLDER)
    parser.add_argument("--samples", type=int, default=256, help="paths per pixel")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--check", action="store_true", help="compare Cycles with vig's model instead")
    arguments = parser.parse_args()

    object_class, library = ObjectClass.load(CLASS_NAME), Library("test")
    options = ["--samples", str(arguments.samples), "--threads", str(arguments.threads)]
    if arguments.check:
        spec = sample(library, object_class, *next(iter(CHOSEN.values())))
        traced = trace(library, spec, object_class, arguments.blender_python, [*options, "--alone"])
        check(spec, object_class, traced)
        return
    print("photo          hidden  azimuth  elevation  |probe - panorama|  mask IoU with raster")
    photos = []
    for name, (seed, index) in CHOSEN.items():
        spec = sample(library, object_class, seed, index)
        traced = trace(library, spec, object_class, arguments.blender_python, options)
        photos.append(develop(name, spec, traced, arguments.out))
        picture = render(library, spec, object_class)
        light = np.array(photos[-1]["light"])
        print(
            f"{name:14} {photos[-1]['occlusion']:6.3f} {photos[-1]['azimuth_deg']:8.1f}"
            f" {photos[-1]['elevation_deg']:10.1f} {np.linalg.norm(light - spec.light):19.3f}"
            f" {iou(masks(traced)[1], picture.visible):21.3f}",
            flush=True,
        )
    with atomic_write(arguments.out / "truth.json") as temporary:
        temporary.write_text(
            json.dumps({"format": 1, "class": CLASS_NAME, "photos": photos}, indent=1) + "\n"
        )
    print(arguments.out)


def trace(
    library: Library, spec: SceneSpec, object_class: ObjectClass, blender_python: Path, options: list[str]
) -> dict[str, np.ndarray]:
    """The arrays of `render_cycles.py` for a scene. Raises CalledProcessError when Blender fails."""
    with tempfile.TemporaryDirectory() as folder:
        scene, out = Path(folder) / "scene.npz", Path(folder) / "traced.npz"
        export(library, spec, object_class, scene)
        subprocess.run([blender_python, TRACER, scene, out, *options], check=True)
        with np.load(out) as arrays:
            return dict(arrays)


def masks(traced: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Amodal and visible mask (H, W) bool: pixels covered by at least half; visible is a part of amodal."""
    amodal = traced["amodal"] >= 0.5
    return amodal, amodal & (traced["visible"] >= 0.5)


def develop(name: str, spec: SceneSpec, traced: dict[str, np.ndarray], out: Path) -> dict:
    """Expose, write the photo and its masks into `out`, and return its entry of truth.json."""
    light = project_panorama(traced["probe"])
    gain = EXPOSURE_L00 / light[0]
    amodal, visible = masks(traced)
    write_png(out / f"{name}.png", traced["image"] * gain.astype(np.float32))
    write_png(out / "masks" / f"{name}_amodal.png", amodal)
    write_png(out / "masks" / f"{name}_visible.png", visible)
    return {
        "name": name,
        "seed": spec.seed,
        "index": spec.index,
        "split": spec.split,
        "occlusion": 1.0 - float(visible.sum()) / float(amodal.sum()),
        "azimuth_deg": math.degrees(spec.azimuth),
        "elevation_deg": math.degrees(spec.elevation),
        "albedo": list(spec.albedo),
        "shape": list(spec.shape),
        "light": exposed(grey(light * gain)).tolist(),
    }


def check(spec: SceneSpec, object_class: ObjectClass, traced: dict[str, np.ndarray]) -> None:
    """Print how the object alone, path-traced, compares with albedo x irradiance of the panorama's SH."""
    light = project_panorama(traced["probe"])
    found = exposed(grey(light))
    vertices, faces = target_vertices(spec, object_class), object_class.shape_model.faces
    normals = torch.from_numpy(vertex_normals(vertices, faces))
    received = [irradiance(torch.from_numpy(light[:, channel]), normals) for channel in range(3)]
    reflected = torch.stack(received, dim=1).numpy() * np.array(spec.albedo)

    view = View.of(object_class, spec.azimuth, spec.elevation)
    fragments = rasterize(vertices, faces, view.rotation, view.translation, view.camera)
    inside = (fragments.face >= 0) & (traced["amodal"] > 0.999)
    corners = reflected[faces[fragments.face[inside]]]
    expected = (corners * fragments.barycentric[inside][:, :, None]).sum(axis=1)
    ratio = traced["image"][inside] / expected

    fine = View.of(object_class, spec.azimuth, spec.elevation, 8 * view.camera.width)
    share = np.isfinite(fine.depth(vertices, faces)).reshape(view.camera.height, 8, view.camera.width, 8)
    silhouette = share.mean(axis=(1, 3)) >= 0.5
    print("light in Cycles / of the spec: largest difference", np.abs(found - spec.light).max().round(3))
    print("radiance in Cycles / albedo x irradiance: median", np.median(ratio, axis=0).round(3))
    print("    10th and 90th percentile", np.percentile(ratio, [10, 90]).round(3))
    print("silhouette in Cycles against the rasteriser's: IoU", iou(masks(traced)[0], silhouette).round(4))


def iou(one: np.ndarray, other: np.ndarray) -> np.float64:
    """Intersection over union of two masks (H, W) bool."""
    return (one & other).sum() / (one | other).sum()


if __name__ == "__main__":
    main()
