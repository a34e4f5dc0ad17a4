"""Does a model of self-shadow and bounce light lower errors? Both ways on path-traced images of known truth.

    VIG_BLENDER_PYTHON=blender/bin/python python -m benchmarks.self_shadow --out runs/self_shadow [--count 48]

needs Blender (docs/cycles.md). Settings: the object `alone` in its panorama, on a plain `support`, and the
whole `scene` with room and props; and, not path-traced, the `raster` tier's image of that scene. Two tables:
residuals inside the object at the true latents under several models of shading (not for `raster`); errors of
fits with the default settings, from the recognition model and from the truth, without and with the transfer
table.
The light that is true is the one that arrives at the object's place with the object removed.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import binary_erosion

from benchmarks.ground_transfer import GroundTransfer
from vig.dataset.metrics import (
    angle_error_deg,
    appearance_error,
    illumination_error,
    segmentation_iou,
    shape_error_mm,
)
from vig.dataset.spec import SceneSpec
from vig.files import atomic_write
from vig.inference import ExplainSettings, explain_one, objective_of
from vig.optimizers.levenberg_marquardt import LevenbergMarquardt
from vig.optimizers.optimizer import Budget
from vig.recognition import Recognizer
from vig.render import rasterize
from vig.scene import (
    EXPOSURE_L00,
    Latents,
    ObjectClass,
    exposed,
    grey,
    linear_from_srgb,
    project_panorama,
    rotate_z,
    srgb_from_linear,
)
from vig_world.assets.target import target_vertices
from vig_world.composition.sampling import sample
from vig_world.library import Library
from vig_world.packs.transfer import ALBEDO, BOUNCES, Occlusion, neighbours_of, unoccluded
from vig_world.renderers.cycles.appearance import lambertian
from vig_world.renderers.cycles.message import compose
from vig_world.renderers.cycles.process import Worker
from vig_world.renderers.cycles.renderer import PROBE_HEIGHT, PROBE_SAMPLES, WORKER, arriving, find_python
from vig_world.renderers.rasterized import render
from vig_world.renderers.view import View

SETTINGS = ("alone", "support", "scene", "raster")
MOST_OCCLUSION = 0.5
GROUND_GUESS = 0.4
RAY_SIDE = 20
PLATE_HALF, PLATE_BELOW = 0.8, 0.0005
"""Metres: half a side of the plain support, and how far it lies under the object, lest the two flicker."""
TIMEOUT = 600.0
"""Seconds for one scene."""
METRICS = ("azimuth_deg", "elevation_deg", "appearance", "albedo", "illumination", "shape_mm", "iou", "nats")


@dataclass(frozen=True)
class Traced:
    """A path-traced image. image (H, W, 3): linear RGB as a camera exposed by a grey card gets it, unclipped.
    photo: the same, clipped and in 8-bit steps. local, above (9, 3): light at the object's place, and of the
    panorama, in the image's exposure. visible (H, W) bool: pixels that show the object. support: its albedo.
    """

    spec: SceneSpec
    image: np.ndarray
    photo: torch.Tensor
    local: np.ndarray
    above: np.ndarray
    visible: np.ndarray
    support: float

    def truth(self) -> Latents:
        """The true latents, with the local light in grey."""
        vector = self.spec.latents()
        vector[-9:] = exposed(grey(self.local))
        return Latents.from_vector(torch.from_numpy(vector)[None])


def scenes(library: Library, object_class: ObjectClass, seed: int) -> Iterator[SceneSpec]:
    """The test scenes of a seed that hide at most half of the object."""
    for index in count():
        spec = sample(library, object_class, seed, index)
        if spec.occlusion <= MOST_OCCLUSION:
            yield spec


def support_albedo(spec: SceneSpec) -> float:
    """Of the plain support in the setting `support`."""
    rng = np.random.default_rng(np.random.SeedSequence([spec.seed, spec.index]))
    return float(rng.uniform(0.1, 0.7))


def trace(
    worker: Worker, library: Library, spec: SceneSpec, object_class: ObjectClass, setting: str, samples: int
) -> dict[str, np.ndarray]:
    """Path trace a scene: `image` (H, W, 3) linear, and `local` (9, 3), the light at the object's place."""
    header, arrays = compose(library, spec, object_class, "diffuse")
    if setting != "scene":
        header["things"] = header["things"][:1]
    if setting == "support":
        plate = lambertian(np.full(3, support_albedo(spec)))
        header["things"].append({"material": plate, "shell": False, "target": False})
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32) * PLATE_HALF
        arrays["1_vertices"] = np.column_stack([corners, np.full(4, -PLATE_BELOW, np.float32)])
        arrays["1_normals"] = np.tile(np.array([0, 0, 1], np.float32), (4, 1))
        arrays["1_faces"] = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    header["samples"] = samples
    header["probe"] |= {"height": PROBE_HEIGHT, "samples": PROBE_SAMPLES}
    answer, pictures = worker.ask(header, arrays, TIMEOUT)
    if "error" in answer:
        raise RuntimeError(answer["error"])
    local = arriving(pictures["probe"], arrays["panorama"], spec.panorama_angle)
    return {"image": pictures["image"], "local": local}


def trace_missing(
    out: Path, setting: str, specs: list[SceneSpec], object_class: ObjectClass, arguments: argparse.Namespace
) -> None:
    """Trace the scenes of a setting of which `out` has no file."""
    (out / setting).mkdir(parents=True, exist_ok=True)
    missing = [spec for spec in specs if not (out / setting / f"{spec.index:05d}.npz").exists()]
    if not missing:
        return
    library = Library("test")
    command = [find_python(arguments.blender_python), str(WORKER), str(arguments.threads)]
    with closing(Worker(command)) as worker:
        for spec in missing:
            found = trace(worker, library, spec, object_class, setting, arguments.samples)
            with atomic_write(out / setting / f"{spec.index:05d}.npz") as temporary:
                np.savez_compressed(temporary, **found)


def traced(out: Path, setting: str, specs: list[SceneSpec], object_class: ObjectClass) -> Iterator[Traced]:
    """Read the traced images of one setting."""
    library = Library("test")
    for spec in specs:
        picture, support = render(library, spec, object_class), support_albedo(spec)
        if setting == "raster":
            photo = torch.from_numpy(linear_from_srgb(picture.image.astype(np.float32) / 255)).float()
            light = np.repeat(np.array(spec.light)[:, None], 3, axis=1)
            yield Traced(spec, photo.numpy(), photo, light, light, picture.visible, support)
            continue
        visible = picture.visible if setting == "scene" else picture.amodal
        panorama = torch.from_numpy(project_panorama(library.surroundings(spec.panorama)).T.copy())
        above = rotate_z(panorama, spec.panorama_angle).numpy().T
        with np.load(out / setting / f"{spec.index:05d}.npz") as result:
            image, local = result["image"], result["local"]
        gain = EXPOSURE_L00 / local[0]
        photo = torch.from_numpy((image * gain).astype(np.float32)).clamp(0, 1)
        photo = linear_from_srgb((srgb_from_linear(photo) * 255).round() / 255)
        yield Traced(spec, image * gain, photo, local * gain, above * gain, visible, support)


def residuals(one: Traced, object_class: ObjectClass, setting: str) -> dict[str, list[float]]:
    """Relative RMS of the object's pixels: true RGB light; the same at its best exposure; grey light refitted
    by least squares; and that light's illumination error.
    """
    model, albedo = object_class.shape_model, np.array(one.spec.albedo)
    vertices = target_vertices(one.spec, object_class)
    rng = np.random.default_rng(one.spec.index)
    own = Occlusion.of(vertices, model.faces, RAY_SIDE, rng)
    neighbours = neighbours_of(model.faces, len(vertices))
    free = unoccluded(own.normals)

    def self_transfer(own_albedo: float, bounces: int) -> np.ndarray:
        return free + own.change(own_albedo, bounces, neighbours)

    assert object_class.transfer is not None
    table = object_class.transfer.astype(np.float64)
    from_table = free + np.tensordot([1.0, *one.spec.shape], table, axes=1)
    models = {
        "no shadow": [free] * 3,
        "self-shadow": [self_transfer(0.0, 0)] * 3,
        "self-shadow, one bounce": [self_transfer(a, 1) for a in albedo],
        "self-shadow, bounces": [self_transfer(a, BOUNCES) for a in albedo],
        f"the same, albedo {ALBEDO}": [self_transfer(ALBEDO, BOUNCES)] * 3,
        "the same, from the table": [from_table] * 3,
    }
    if setting == "support":
        over = GroundTransfer.of(own, vertices, model.faces, RAY_SIDE, rng)
        models["and ground, its albedo true"] = [over.transfer(a, one.support) for a in albedo]
        models[f"and ground, albedos {ALBEDO}, {GROUND_GUESS}"] = [over.transfer(ALBEDO, GROUND_GUESS)] * 3

    view = View.of(object_class, one.spec.azimuth, one.spec.elevation)
    fragments = rasterize(vertices, model.faces, view.rotation, view.translation, view.camera)
    inside = (fragments.face >= 0) & binary_erosion(one.visible)
    corners = model.faces[fragments.face[inside]]
    weights, image = fragments.barycentric[inside][..., None], one.image[inside]
    size = np.sqrt((image**2).mean())

    def off(rendered: np.ndarray) -> float:
        return float(np.sqrt(((rendered - image) ** 2).mean()) / size)

    results = {}
    for name, channels in models.items():
        light = one.above if "ground" in name else one.local
        at_vertices = [np.maximum(t @ light[:, i], 0) * albedo[i] for i, t in enumerate(channels)]
        rendered = np.stack([(v[corners] * weights[..., 0]).sum(1) for v in at_vertices], axis=1)
        scale = (rendered * image).sum() / (rendered**2).sum()
        seen = [(t[corners] * weights).sum(1) for t in channels]
        design = np.stack(seen, axis=1) * albedo[:, None]
        found = np.linalg.lstsq(design.reshape(-1, 9), image.ravel(), rcond=None)[0]
        wrong = illumination_error(found[None], exposed(grey(light))[None])[0]
        results[name] = [off(rendered), off(scale * rendered), off(design @ found), float(wrong)]
    return results


def fits(images: list[Traced], object_class: ObjectClass, from_truth: bool, self_shadow: bool) -> np.ndarray:
    """METRICS (N, 8) of fits with the default settings, or of one descent from the true latents."""
    recognizer, rows = Recognizer.of_class(object_class), []
    settings = ExplainSettings(self_shadow=self_shadow)
    model, zero = object_class.shape_model, torch.zeros(1, dtype=torch.int32)
    for one in images:
        prediction, truth = recognizer(one.photo[None]), one.truth()
        vertices = torch.from_numpy(target_vertices(one.spec, object_class))[None]
        if from_truth:
            objective = objective_of(one.photo, prediction, object_class, settings)
            end = LevenbergMarquardt()(
                objective, objective.point(truth), zero, settings.likelihood.sigma, Budget()
            )
            found, overlap, nats = objective.latents(end.points), np.nan, float(end.value[0])
        else:
            fit = explain_one(one.photo, prediction, object_class, settings)
            found, nats = fit.latents, fit.evidence
            overlap = segmentation_iou(fit.mask.numpy()[None], one.visible[None])[0]
        found = Latents.from_vector(found.to_vector().float())
        rows.append(
            [
                angle_error_deg(found.azimuth, truth.azimuth)[0],
                angle_error_deg(found.elevation, truth.elevation)[0],
                appearance_error(found.albedo, truth.albedo)[0],
                float((found.albedo - truth.albedo).abs().mean()),
                illumination_error(found.light, truth.light)[0],
                shape_error_mm(model.vertices(found.shape), vertices)[0],
                overlap,
                nats,
            ]
        )
    return np.array(rows)


def compare(without: np.ndarray, with_table: np.ndarray) -> dict[str, dict[str, float | list[float]]]:
    """Medians both ways; the median of paired differences with its 95 % bootstrap interval; share lower."""
    chosen = np.random.default_rng(0).integers(len(without), size=(4000, len(without)))
    result: dict[str, dict[str, float | list[float]]] = {}
    for column, name in enumerate(METRICS):
        before, after = without[:, column], with_table[:, column]
        if np.isnan(before).all():
            continue
        difference = after - before
        interval = np.percentile(np.median(difference[chosen], axis=1), [2.5, 97.5])
        result[name] = {
            "without": float(np.median(before)),
            "with": float(np.median(after)),
            "difference": float(np.median(difference)),
            "ci95": [float(end) for end in interval],
            "lower_share": float((difference < 0).mean()),
            "mean_without": float(before.mean()),
            "mean_with": float(after.mean()),
        }
    return result


def main() -> None:
    """Trace what is not there yet, compare, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blender-python", help="a Python that can import bpy; else VIG_BLENDER_PYTHON")
    parser.add_argument("--samples", type=int, default=128, help="paths per pixel")
    parser.add_argument("--threads", type=int, default=2, help="of Blender")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--count", type=int, default=48)
    parser.add_argument("--seed", type=int, default=2027)
    parser.add_argument("--settings", nargs="+", choices=SETTINGS, default=SETTINGS)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    object_class = ObjectClass.load("teapot")
    specs = list(islice(scenes(Library("test"), object_class, arguments.seed), arguments.count))
    report: dict[str, dict] = {}
    for setting in arguments.settings:
        if setting != "raster":
            trace_missing(arguments.out, setting, specs, object_class, arguments)
        images = list(traced(arguments.out, setting, specs, object_class))
        report[setting] = {}
        print(f"\n{setting}, {len(images)} images")
        if setting != "raster":
            each = [residuals(one, object_class, setting) for one in images]
            medians = {name: np.median([row[name] for row in each], axis=0).tolist() for name in each[0]}
            print("relative residual with the true light, at its best exposure, with a grey light refitted;")
            print("illumination error of that light")
            for name, values in medians.items():
                print(f"  {name:36}" + "".join(f"{value:9.4f}" for value in values))
            report[setting]["residuals"] = medians
        for start, from_truth in (("default fit", False), ("from the truth", True)):
            both = [fits(images, object_class, from_truth, chosen) for chosen in (False, True)]
            compared = report[setting][start] = compare(*both)
            print(f"{setting}, {start}: medians without, with; paired difference [95 %]; lower in; means")
            for name, row in compared.items():
                print(
                    f"  {name:14}{row['without']:11.4g}{row['with']:11.4g}{row['difference']:+11.3g}"
                    f" [{row['ci95'][0]:+.3g}, {row['ci95'][1]:+.3g}]{row['lower_share']:7.2f}"
                    f"{row['mean_without']:11.4g}{row['mean_with']:11.4g}",
                    flush=True,
                )
    if arguments.json:
        arguments.json.write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
