"""The records of one sample in the merged files of a dataset."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from vig.scene import ObjectClass, latent_layout
from vig_world.dataset.format import DEPTH_SCALES, MAX_DEPTH, read_info
from vig_world.dataset.spec import SceneSpec
from vig_world.generation import bop
from vig_world.raster.picture import Picture
from vig_world.raster.view import View
from vig_world.renderers.photo import PhotoSettings


def depth_units(depth: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the depth (H, W) metres, inf = unknown, as a depth image holds it: (H, W) uint16, 0 = unknown;
    and the millimetres of a unit, of `DEPTH_SCALES`.
    """
    for scale in DEPTH_SCALES:
        scaled = np.round(np.where(np.isfinite(depth), depth * (1000 / scale), 0.0))
        if scaled.max() < MAX_DEPTH:
            break
    return scaled.clip(0, MAX_DEPTH).astype(np.uint16), scale


def normal_units(normals: np.ndarray) -> np.ndarray:
    """Return normals (H, W, 3), 0 = unknown, as an image: (H, W, 3) uint8, 127.5 + 127.5 times each."""
    units = np.rint(127.5 * (normals + 1)).astype(np.uint8)
    return np.where(normals.any(-1, keepdims=True), units, np.uint8(0))


def describe(
    spec: SceneSpec,
    picture: Picture,
    depth: tuple[np.ndarray, float],
    object_class: ObjectClass,
    photo: PhotoSettings | None = None,
) -> dict[str, Any]:
    """Return records of a sample in the merged files: keys camera, gt, gt_info (BOP), row (parquet), spec.

    Args:
        depth: The depth image as stored and its scale, see `depth_units`.
        photo: Settings of the camera model, if it was used.
    """
    height, width = depth[0].shape
    view = View.of_scene(spec, object_class, (width, height))
    info = bop.visibility(picture.canvas, picture.amodal, picture.visible, depth[0])
    shares = picture.shares
    latents = spec.latents()
    latents[-len(picture.light) :] = picture.light  # a path tracer's label differs from the spec's light
    named = dict(zip(latent_layout(len(spec.shape)).labels, latents.tolist(), strict=True))
    return {
        "camera": bop.scene_camera(view, depth[1]),
        "gt": [bop.pose(view)],
        "gt_info": [info],
        "row": {
            "index": spec.index,
            "seed": spec.seed,
            **named,
            "occlusion": picture.occlusion,
            "target_occlusion": spec.target,
            "visib_fract": info["visib_fract"],
            **{f"share_{name}": share for name, share in shares.items()},
            "cause": picture.cause,
            "hidden_by": [f"{prop.family}/{prop.asset}" for prop in spec.props if prop.role == "occluder"],
            "truncated": shares["truncation"] > 0,
            "size": info["px_count_all"] / picture.amodal.size,
            "panorama": spec.panorama,
            "layout": spec.room.layout,
            "zone": spec.room.zone,
            "design": spec.design,
            "assets": assets_used(spec),
            "finish": spec.finish,
            "roll": spec.lens.roll,
            "photo": None if photo is None else json.dumps(asdict(photo)),
        },
        "rejected": spec.rejected,
        "spec": spec.to_json(),
    }


def assets_used(spec: SceneSpec) -> list[str]:
    """Return the names of the numbered assets of a scene, as `split/catalogue/number`, sorted."""
    numbers = {"panorama": spec.panorama, "layout": spec.room.layout, "design": spec.design}
    names = {f"{kind}/{number}" for kind, number in numbers.items() if number >= 0}
    names |= {f"prop/{prop.family}/{prop.asset}" for prop in spec.props}
    names |= {f"surface/{each.kind}/{each.asset}" for _, each in spec.room.finishes}
    return sorted(f"{spec.split}/{name}" for name in names)


def describe_split(path: str | Path, split: str) -> dict[str, Any]:
    """Return statistics of a split: occlusion_deciles (10 counts), rejections by reason and per sample."""
    from vig_world.dataset.table import read_table

    settings = read_info(Path(path))["splits"][split]
    occlusion = read_table(Path(path), split, texts=False)["occlusion"]
    counts, _ = np.histogram(occlusion.to_numpy(), 10, (0, 1))
    counted = {name: settings[name] for name in ("rejections", "rejections_per_sample")}
    return {"occlusion_deciles": counts.tolist(), **counted}
