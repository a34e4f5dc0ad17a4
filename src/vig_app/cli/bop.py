"""`vig bop`: poses of known objects in a data set in BOP's format, as bop_toolkit scores them."""

import math
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from vig import Explainer, Hints
from vig.io.checks import MAX_TABLE, read_json, reading
from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig.io.printing import end, note
from vig.io.progress import Meter
from vig.known_object.packs import pack_of_mesh
from vig.known_object.picture import WEIGHTS
from vig.parallel import map_in_processes
from vig.photo.masks import read_mask
from vig_app.cli.common import BopCommand
from vig_app.exports.formats.bop import MILLIMETRES, POSE_COLUMNS, pose_line
from vig_app.labels import Runs, coco_runs

IMAGES = [(folder, suffix) for folder in ("rgb", "gray") for suffix in (".png", ".jpg", ".tif", ".tiff")]


@dataclass(frozen=True)
class Instance:
    """One object in an image: its number in BOP, and where it is seen.

    Attributes:
        number: BOP's obj_id.
        mask: A file, or run lengths.
        score: Of its detection.
    """

    number: int
    mask: Path | Runs
    score: float = 1.0

    def visible(self) -> np.ndarray:
        """Return the pixels (H, W) bool in which it is seen; UserError where they cannot be read."""
        return read_mask(self.mask) if isinstance(self.mask, Path) else self.mask.mask(*self.mask.box[2:])


@dataclass(frozen=True)
class BopImage:
    """One image of a scene, with its intrinsics (3, 3) as nine numbers."""

    scene: int
    number: int
    photo: Path
    camera: tuple[float, ...]
    instances: tuple[Instance, ...]


def bop(settings: BopCommand) -> int:
    """Write the poses of all targets; returns the exit code."""
    images = list(images_of(settings))
    numbers = sorted({instance.number for image in images for instance in image.instances})
    meshes = settings.meshes or settings.dataset / "models"
    packs: dict[int, Path] = {}
    for number in numbers:
        try:
            packs[number] = pack_of_mesh(*mesh_of(meshes, number), note)
        except UserError as error:  # the other objects are found
            if len(numbers) == 1:
                raise
            note(f"object {number}: {error}")
    name = f"vig_{settings.dataset.resolve().name}-{settings.split}.csv"
    missed, poses = 0, 0
    with atomic_write(settings.out / name) as temporary, open(temporary, "w", encoding="utf-8") as file:
        print(POSE_COLUMNS, file=file)
        with Meter(len(images), 0, sys.stderr.isatty(), "images") as meter:
            for lines, problems in map_in_processes(prepare, packs, iter(images), settings.workers):
                for line in lines:
                    print(line, file=file)
                for problem in problems:
                    note(problem)
                poses, missed = poses + len(lines), missed + len(problems)
                meter.advance(1)
    result = {"poses": poses, "missed": missed, "file": str(settings.out / name)} if settings.json else None
    end(settings.out, f"found {poses} poses in {len(images)} images: {name}", result)
    return 0 if poses else 2


def images_of(settings: BopCommand) -> Iterator[BopImage]:
    """Yield the images with targets; UserError where a file is missing or damaged."""
    path = settings.targets or settings.dataset / "test_targets_bop19.json"
    sought: dict[tuple[int, int], dict[int, int]] = defaultdict(lambda: defaultdict(int))
    with reading(path, "targets of BOP", 'Write a list of {"scene_id", "im_id", "obj_id", "inst_count"}.'):
        for entry in read_json(path, MAX_TABLE):
            image = int(entry["scene_id"]), int(entry["im_id"])
            sought[image][int(entry["obj_id"])] += int(entry.get("inst_count", 1))
        if not sought:
            raise ValueError("an empty list")
    found = None if settings.detections is None else detections_of(settings.detections)
    scene_file = cache(lambda folder, name: read_json(folder / name, MAX_TABLE))
    for (scene, number), counts in sorted(sought.items()):
        folder = settings.dataset / settings.split / f"{scene:06}"
        with reading(folder, f"image {number} of a scene of BOP", "Check --split and the targets."):
            camera = tuple(map(float, scene_file(folder, "scene_camera.json")[str(number)]["cam_K"]))
            paths = [folder / kind / f"{number:06}{suffix}" for kind, suffix in IMAGES]
            photo = next((path for path in paths if path.exists()), paths[0])
            if found is None:
                truth = scene_file(folder, "scene_gt.json")[str(number)]
                masks = [folder / "mask_visib" / f"{number:06}_{n:06}.png" for n in range(len(truth))]
                instances = [Instance(int(e["obj_id"]), mask) for e, mask in zip(truth, masks, strict=True)]
            else:
                instances = found.get((scene, number), [])
        chosen = [
            instance
            for object_number, count in counts.items()
            for instance in [each for each in instances if each.number == object_number][:count]
        ]
        yield BopImage(scene, number, photo, camera, tuple(chosen))


def detections_of(path: Path) -> dict[tuple[int, int], list[Instance]]:
    """Return the detections of each scene's image, the surest first; UserError where they are damaged."""
    found = defaultdict(list)
    remedy = 'Write a list of {"scene_id", "image_id", "category_id", "score", "segmentation": run lengths}.'
    with reading(path, "detections of BOP", remedy):
        for entry in read_json(path, MAX_TABLE):
            runs = coco_runs(entry["segmentation"])
            runs.check()
            instance = Instance(int(entry["category_id"]), runs, float(entry["score"]))
            found[int(entry["scene_id"]), int(entry["image_id"])].append(instance)
    return {image: sorted(each, key=lambda one: -one.score) for image, each in found.items()}


def mesh_of(folder: Path, number: int) -> tuple[Path, float]:
    """Return the mesh of an object and its longest side, metres; UserError where either is not known."""
    path = folder / "models_info.json"
    with reading(path, f"the size of object {number}", "Write size_x, size_y, size_z in millimetres."):
        info = read_json(path, MAX_TABLE)[str(number)]
        length = max(float(info[f"size_{axis}"]) for axis in "xyz") / MILLIMETRES
    return folder / f"obj_{number:06}.ply", length


def prepare(packs: dict[int, Path]) -> Callable[[BopImage], tuple[list[str], list[str]]]:
    """Return the work of a process: the lines of an image, and what went wrong in it."""

    @cache
    def explainer_of(number: int) -> Explainer:
        if number not in packs:
            raise UserError("its mesh cannot be used")
        return Explainer(packs[number])

    def work(image: BopImage) -> tuple[list[str], list[str]]:
        began, poses, problems = time.perf_counter(), [], []
        for instance in image.instances:
            try:
                explanation = explainer_of(instance.number).explain(
                    image.photo, K=image.camera, hints=Hints(mask=instance.visible())
                )
            except UserError as error:
                problems.append(
                    f"scene {image.scene}, image {image.number}, object {instance.number}: {error}"
                )
                continue
            # 8.0: a usual score, without its sign
            likely = 0.5 + 0.5 * math.tanh((explanation.fit.evidence / WEIGHTS.pixels + 8.0) / 2)
            pose = explanation.camera_from_mesh
            assert pose is not None
            poses.append((instance.number, instance.score * likely, pose))
        seconds = time.perf_counter() - began  # BOP counts the time of the whole image
        lines = [
            pose_line(image.scene, image.number, number, score, pose, seconds)
            for number, score, pose in poses
        ]
        return lines, problems

    return work
