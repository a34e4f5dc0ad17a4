"""Consistency of a sample's labels, pictures and spec: each fact is recomputed."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.ndimage import binary_erosion

from vig.scene import SHAPE_LIMIT, ObjectClass, latent_layout
from vig.scene.light import L_COUNT
from vig_world.assets.target import target_vertices
from vig_world.dataset.format import DEPTH_SCALES, STANDARD_SIZE, Size, image_paths, read_info
from vig_world.dataset.spec import SceneSpec
from vig_world.generation import bop
from vig_world.generation.check import merged_samples
from vig_world.generation.describe import assets_used
from vig_world.raster.draw import SAMPLES
from vig_world.raster.picture import CANVAS
from vig_world.raster.view import View

CLOSE = 1e-9
FLIPPED = 0.01
"""Largest share of the silhouette's pixels by which the mask may differ from a projection of the mesh."""
NORMAL_STEP = 0.01
"""Largest difference of the length of stored normals from 1: three components, each rounded by 0.004."""
TURNED_AWAY, FACING = 0.1, 0.99
"""Cosine of a normal that is turned away from the camera; share of normals that are not, interpolated as they
are between vertices."""
WITHIN = 0.9
"""Least share of visible pixels, but for the outermost, with a depth within the object."""


def label_problems(
    item: dict[str, Any], spec: SceneSpec, pictures: dict[str, np.ndarray], object_class: ObjectClass
) -> Iterator[str]:
    """Yield problems of a sample's labels, a line each; raises KeyError and the like when some are missing.

    Args:
        item: The records `row`, `camera`, `gt` and `gt_info` as merged.
        pictures: The images `rgb`, `depth`, `mask` and `mask_visib` as stored; and `normal`, if there is one.
    """
    for kind in ("mask", "mask_visib"):
        if not np.isin(pictures[kind], (0, 255)).all():
            yield f"{kind} has values other than 0 and 255"
    alone, visible = pictures["mask"] > 0, pictures["mask_visib"] > 0
    if (visible & ~alone).any():
        yield "mask_visib is not within mask"
    if not alone.any():
        yield "mask is empty"
        return
    yield from _latent_problems(item["row"], spec)
    height, width = alone.shape
    view = View.of_scene(spec, object_class, (width, height))
    yield from _pose_problems(item, view)
    vertices = target_vertices(spec, object_class)
    canvas = silhouette(object_class, vertices, spec, (width, height))
    yield from _visibility_problems(item["gt_info"][0], alone, visible, pictures["depth"], canvas)
    yield from _share_problems(item["row"], item["gt_info"][0], alone, visible)
    inner = binary_erosion(visible)  # a pixel at an edge has the depth of its nearest surface
    scale = item["camera"]["depth_scale"]
    millimetres = pictures["depth"][inner] * scale
    z = 1000 * (vertices @ view.rotation[2] + view.translation[2])
    inside = (millimetres > z.min() - scale) & (millimetres < z.max() + scale)
    if inner.any() and inside.mean() < WITHIN:
        yield f"depth: only {inside.mean():.0%} of the visible pixels are within the object's depth"
    if "normal" in pictures:
        yield from normal_problems(pictures["normal"], pictures["depth"], view)


def silhouette(
    object_class: ObjectClass, vertices: np.ndarray, spec: SceneSpec, size: Size = STANDARD_SIZE
) -> np.ndarray:
    """Return the object (V, 3) alone on the canvas of 3 x 3 frames: (3H, 3W) bool, half a pixel or more.

    By the differentiable renderer, which shares no code with those that make pictures.
    """
    view = View.of_scene(spec, object_class, size).widen(CANVAS)
    canvas = np.zeros((CANVAS * size[1], CANVAS * size[0]), bool)
    top, bottom, left, right = (int(edge[0]) for edge in view.windows(vertices[None].astype(np.float64)))
    height, width = bottom - top, right - left
    if height > 0 and width > 0:
        whole = view.camera
        camera = replace(whole, width=width, height=height, cx=whole.cx - left, cy=whole.cy - top)
        window = View(camera, view.rotation, view.translation).scale(SAMPLES)
        depth = window.depth(vertices, object_class.shape_model.faces)
        samples = np.isfinite(depth).reshape(height, SAMPLES, width, SAMPLES)
        canvas[top:bottom, left:right] = samples.sum(axis=(1, 3)) >= SAMPLES**2 / 2
    return canvas


def _latent_problems(row: dict[str, Any], spec: SceneSpec) -> Iterator[str]:
    names = latent_layout(len(spec.shape)).labels
    latents = np.array([row[name] for name in names], np.float64)
    shape, (azimuth, elevation), albedo, light = np.split(latents, np.cumsum([len(spec.shape), 2, 3]))
    if not np.isfinite(latents).all():
        yield "a latent is not finite"
    if (np.abs(shape) > SHAPE_LIMIT).any():
        yield f"shape is not within {SHAPE_LIMIT:g} standard deviations"
    if not (0 <= azimuth < 2 * np.pi + 1e-6 and 0 <= elevation <= np.pi / 2 + 1e-6):
        yield f"azimuth {azimuth:.3f} or elevation {elevation:.3f} is out of range"
    if not ((albedo >= 0) & (albedo <= 1)).all():
        yield "albedo is not in [0, 1]"
    if light[0] <= 0:
        yield "the light has no mean"
    stored = spec.latents()[:-L_COUNT]
    if not np.array_equal(stored, latents[:-L_COUNT].astype(np.float32)):
        yield "latents differ from the spec's"
    for name, value in (("index", spec.index), ("seed", spec.seed), ("target_occlusion", spec.target)):
        if row[name] != value:
            yield f"{name} {row[name]} differs from the spec's {value}"
    if row["assets"] != assets_used(spec):
        yield "the list of assets differs from the spec's"


def _pose_problems(item: dict[str, Any], view: View) -> Iterator[str]:
    truth, camera = item["gt"][0], item["camera"]
    rotation = np.array(truth["cam_R_m2c"]).reshape(3, 3)
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > CLOSE or np.linalg.det(rotation) < 0:
        yield "cam_R_m2c is not a rotation"
    if camera["depth_scale"] not in DEPTH_SCALES:
        yield f"depth_scale {camera['depth_scale']} is none of {DEPTH_SCALES}"
    expected = {**bop.pose(view), **bop.scene_camera(view, camera["depth_scale"])}
    stored = {**truth, **camera}
    for name, value in expected.items():
        if np.shape(stored[name]) != np.shape(value) or not np.allclose(stored[name], value, 0, 1e-6):
            yield f"{name} does not agree with azimuth, elevation and the camera"


def _visibility_problems(
    info: dict[str, Any], alone: np.ndarray, visible: np.ndarray, depth: np.ndarray, canvas: np.ndarray
) -> Iterator[str]:
    height, width = alone.shape
    middle = slice(height, 2 * height), slice(width, 2 * width)
    frame = canvas[middle]
    flipped = np.count_nonzero(frame != alone) / alone.sum()
    if flipped > FLIPPED:
        yield f"mask: {flipped:.1%} of its pixels are not where the mesh projects"
    whole = canvas.copy()
    whole[middle] = alone
    exact = not flipped
    for name, value in bop.visibility(whole, alone, visible, depth).items():
        outside = name in ("bbox_obj", "px_count_all", "visib_fract")
        slack = 0.0 if exact or not outside else max(2.0, 2 * FLIPPED * info["px_count_all"])
        if name == "visib_fract":
            slack /= info["px_count_all"]
        if not np.allclose(info[name], value, 0, slack + CLOSE):
            yield f"{name} is {info[name]}; masks, depth and mesh give {value}"


def normal_problems(normal: np.ndarray, depth: np.ndarray, view: View) -> Iterator[str]:
    """Yield problems of a picture of normals (H, W, 3), with the depth image (H, W)."""
    known = normal.any(-1)
    if (known != (depth > 0)).any():
        yield "normal: it is not known where depth is"
    directions = normal[known] / 127.5 - 1
    if (np.abs(np.linalg.norm(directions, axis=1) - 1) > NORMAL_STEP).any():
        yield "normal: some are not of unit length"
    rows, columns = np.nonzero(known)
    camera = view.camera
    rays = np.column_stack([columns + 0.5 - camera.cx, rows + 0.5 - camera.cy, [camera.focal] * len(rows)])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    if known.any() and ((directions * rays).sum(1) < TURNED_AWAY).mean() < FACING:
        yield "normal: too many are turned away from the camera"


def _share_problems(
    row: dict[str, Any], info: dict[str, Any], alone: np.ndarray, visible: np.ndarray
) -> Iterator[str]:
    hidden = 1 - visible.sum() / alone.sum()
    if abs(row["occlusion"] - hidden) > CLOSE:
        yield f"occlusion is {row['occlusion']:.4f}; the masks give {hidden:.4f}"
    shares = {name: row[f"share_{name}"] for name in ("occluder", "support", "truncation")}
    if min(shares.values()) < 0 or abs(sum(shares.values()) + row["visib_fract"] - 1) > CLOSE:
        yield "share_occluder, share_support, share_truncation and visib_fract do not add up to 1"
    if abs(row["visib_fract"] - info["px_count_visib"] / info["px_count_all"]) > CLOSE:
        yield "visib_fract is not px_count_visib / px_count_all"
    cut = 1 - alone.sum() / info["px_count_all"]
    if abs(shares["truncation"] - cut) > CLOSE or row["truncated"] != (cut > 0):
        yield f"share_truncation is {shares['truncation']:.4f}; {cut:.4f} of the silhouette is cut off"
    greatest = max(shares, key=lambda name: shares[name])
    if row["cause"] != (greatest if shares[greatest] > 0 else "none"):
        yield f"cause is {row['cause']}; the greatest share is the {greatest}'s"


def problems_of(root: Path, object_class: ObjectClass) -> list[str]:
    """Return the problems of all labels of a dataset's train split."""
    info, folder = read_info(root)["splits"]["train"], root / "train"
    problems: list[str] = []
    for item in merged_samples(root, "train", info["count"]):
        pictures = {
            kind: np.asarray(Image.open(folder / path))
            for kind, path in image_paths(Path(), item["row"]["index"], info["normals"]).items()
        }
        problems += label_problems(item, SceneSpec.from_json(item["spec"]), pictures, object_class)
    return problems


def seal(root: Path) -> None:
    """Write hashes of what is there now, so that only the labels can tell what is wrong."""
    folder = root / "train"
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "files.sha256")
    lines = [
        f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.relative_to(folder).as_posix()}\n" for p in files
    ]
    (folder / "files.sha256").write_text("".join(lines))
    info = json.loads((root / "info.json").read_text())
    info["splits"]["train"]["manifest_sha256"] = hashlib.sha256("".join(lines).encode()).hexdigest()
    (root / "info.json").write_text(json.dumps(info))
