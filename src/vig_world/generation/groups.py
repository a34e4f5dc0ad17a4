"""Makes photographs of several objects that hide one another, with their truth.

A folder of groups holds `photos/000012.png`; of object 1 of that photo `masks/000012_1.png`, whole, and
`masks_visible/000012_1.png`; `boxes.json`, as `vig fit --boxes` reads it; `truth.jsonl`, one line a photo:

    {"photo": "000012.png", "before": [[0, 1]], "objects": [{"class", "box", "azimuth_deg", "elevation_deg",
     "hidden_fraction", "K", "camera_from_object", "shape", "albedo"}]}

where before [i, j] says that object i hides some of object j, counted from 0, as the objects are listed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vig.io.checks import reading
from vig.io.errors import UserError
from vig.photo.images import write_png
from vig.photo.masks import box_of
from vig.scene import ObjectClass, linear_from_srgb
from vig_world.composition.group import GroupSpec, photo_stream, sample_group
from vig_world.dataset.spec import Split
from vig_world.generation.files import write_json
from vig_world.library import Library
from vig_world.raster.view import View
from vig_world.renderers.photo import photograph
from vig_world.renderers.rasterized import render
from vig_world.threads import one_thread

WIDTH, HEIGHT = 480, 360
FINER = 2
"""Pixels drawn along a side of each pixel of the image, so that the edges between objects are blended."""
HIDES = 12
"""Pixels of one object that another hides to be before it."""


@dataclass(frozen=True)
class Group:
    """A photograph of N objects.

    Attributes:
        spec: The scene.
        views: The camera in each object's frame.
        photo: (H, W, 3) uint8 sRGB, through a camera model.
        amodal: (N, H, W) bool, each object alone.
        visible: (N, H, W) bool, each as seen.
        occludes: (N, N) bool, whether object i hides some of object j, `HIDES` pixels or more.
    """

    spec: GroupSpec
    views: tuple[View, ...]
    photo: np.ndarray
    amodal: np.ndarray
    visible: np.ndarray
    occludes: np.ndarray

    @property
    def boxes(self) -> list[list[int]]:
        """Return x, y, width, height in pixels round each whole object, within the photo."""
        return [list(box_of(mask) or ()) for mask in self.amodal]

    def truth(self) -> list[dict[str, Any]]:
        """Return plain values of each object; see the module."""
        hidden = 1 - self.visible.sum((1, 2)) / self.amodal.sum((1, 2))
        objects = []
        for member, view, box, share in zip(self.spec.members, self.views, self.boxes, hidden, strict=True):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = view.rotation, view.translation
            scene = member.scene
            objects.append(
                {"class": member.class_name, "box": box, "azimuth_deg": math.degrees(scene.azimuth),
                 "elevation_deg": math.degrees(scene.elevation), "hidden_fraction": float(share),
                 "K": view.camera.K.tolist(), "camera_from_object": pose.tolist(),
                 "shape": list(scene.shape), "albedo": list(scene.albedo)}
            )  # fmt: skip
        return objects


def make_group(
    library: Library,
    classes: Sequence[ObjectClass],
    seed: int,
    index: int,
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> Group:
    """Group number `index` of a seed, a photo of width x height pixels: a pure function of its arguments.

    Each object is drawn in its own frame, with room and props; each pixel is that of the nearest
    object. The room has the darkest shadow of any; objects cast none on each other.
    """
    spec = sample_group(library, classes, seed, index, size[0] / size[1])
    by_name = {each.name: each for each in classes}
    views = spec.views(classes, *size)
    drawn = [
        render(library, member.scene, by_name[member.class_name], view.scaled(FINER))
        for member, view in zip(spec.members, views, strict=True)
    ]
    uncovered = np.stack([one.visible for one in drawn])
    depths = np.stack([np.where(one.visible, one.depth, np.inf) for one in drawn])
    pictures = np.stack([linear_from_srgb(one.image.astype(np.float32) / 255) for one in drawn])
    nearest = depths.argmin(0)
    darkest = pictures.sum(-1).argmin(0)
    chosen = np.where(uncovered.any(0), nearest, darkest)
    linear = np.take_along_axis(pictures, chosen[None, ..., None], 0)[0]
    amodal = np.stack([_halved(one.amodal) >= 0.5 for one in drawn])
    shares = np.stack([_halved(mask & (nearest == number)) for number, mask in enumerate(uncovered)])
    most = shares.argmax(0)
    visible = np.stack([(share >= 0.5) & (most == number) for number, share in enumerate(shares)])
    hides = uncovered[:, None] & uncovered & (depths[:, None] < depths)
    photo, _ = photograph(_halved(linear), photo_stream(seed, index, library.split))
    return Group(spec, tuple(views), photo, amodal, visible & amodal, hides.sum((2, 3)) >= FINER**2 * HIDES)


def write_groups(
    out: Path,
    count: int,
    seed: int,
    split: Split,
    classes: Sequence[ObjectClass],
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> Iterator[int]:
    """Write groups into a folder, and yield the number of each as it is there.

    Those of an earlier call with the same seed, split, classes and size are left as they are.

    Raises:
        UserError: The folder holds groups of another recipe, or a scene could not be drawn.
    """
    recipe = {"seed": seed, "split": split, "classes": [each.name for each in classes], "size": list(size)}
    truths = _told(out / "truth.jsonl", recipe)
    library = Library(split)
    try:
        out.mkdir(parents=True, exist_ok=True)
        file = open(out / "truth.jsonl", "a", encoding="utf-8")
    except OSError as error:
        raise UserError(f"cannot write '{out}': {error.strerror}; choose another folder.") from error
    with file:
        for index in range(count):
            name = f"{index:06d}.png"
            if name not in truths:
                with one_thread():
                    group = make_group(library, classes, seed, index, size)
                write_png(out / "photos" / name, group.photo)
                for kind, masks in (("masks", group.amodal), ("masks_visible", group.visible)):
                    for number, mask in enumerate(masks, 1):
                        path = out / kind / f"{index:06d}_{number}.png"
                        write_png(path, np.repeat(mask[..., None], 3, 2).astype(np.uint8) * 255)
                pairs = np.argwhere(group.occludes).tolist()
                truths[name] = {"photo": name, "before": pairs, "objects": group.truth(), "recipe": recipe}
                file.write(json.dumps(truths[name]) + "\n")
                file.flush()
            yield index
    boxes = {
        name: [{"box": each["box"], "class": each["class"]} for each in truths[name]["objects"]]
        for name in sorted(truths)
    }
    write_json(out / "boxes.json", boxes)


def _told(path: Path, recipe: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return lines of an earlier call by their photos; half a line, as a kill leaves it, goes."""
    if not path.exists():
        return {}
    with reading(path, "the truth of groups", "Choose another folder."):
        text = path.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]
        lines = [json.loads(line) for line in whole.splitlines()]
        if any(line["recipe"] != recipe for line in lines):
            raise ValueError("its groups are of another seed, split, size or other classes")
        if whole != text:
            path.write_text(whole, encoding="utf-8")
        return {line["photo"]: line for line in lines}


def _halved(image: np.ndarray) -> np.ndarray:
    """Return the mean over cells of FINER x FINER pixels of an image (H, W) or (H, W, C)."""
    height, width = image.shape[0] // FINER, image.shape[1] // FINER
    mean: np.ndarray = image.reshape(height, FINER, width, FINER, *image.shape[2:]).mean(axis=(1, 3))
    return mean
