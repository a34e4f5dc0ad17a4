"""Verifies a dataset: every file, and renderings with their labels against files."""

import hashlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vig.io.checks import parse_json, read_bytes, read_json, reading
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.dataset.format import (
    INFO,
    MANIFEST,
    MAX_SAMPLES,
    REMEDY,
    Size,
    complete_split,
    image_paths,
    inside,
    read_info,
)
from vig_world.dataset.read import decode_picture, read_specs
from vig_world.dataset.spec import WORLD_VERSION, SceneSpec
from vig_world.dataset.table import read_table
from vig_world.generation import bop
from vig_world.generation.files import read_scene
from vig_world.generation.job import Job, Maker
from vig_world.generation.keypoints import class_of
from vig_world.library import OwnAssets
from vig_world.threads import one_thread

THREADS = 2


@dataclass(frozen=True)
class Findings:
    """Findings of a check.

    Attributes:
        problems: One line each, in the order of the samples.
        samples: Number of checked samples.
        files: Number of checked files.
        rendered: Number of samples rendered again.
    """

    split: str
    problems: tuple[str, ...]
    samples: int
    files: int
    rendered: int

    @property
    def clean(self) -> bool:
        """Return whether no problem was found."""
        return not self.problems

    def summary(self) -> str:
        """Return the findings in one sentence."""
        state = "clean" if self.clean else f"{len(self.problems)} problems"
        again = f", {self.rendered} rendered again" if self.rendered else ""
        return f"{self.split}: {self.samples} samples, {self.files} files{again}: {state}"


def check_dataset(
    path: str | Path,
    split: str | None = None,
    render: int = 0,
    object_class: ObjectClass | None = None,
    own: OwnAssets | None = None,
) -> Findings:
    """Check one split of a dataset: hashes, pictures, renderings; docs/dataset.md lists the facts.

    Args:
        path: Folder of the dataset.
        split: By default the only one.
        render: Number of samples, evenly spaced, that are rendered again from their specs and compared.
        object_class: The class it was made with, by default the packaged one of the recorded name.
        own: The custom assets it was made with, needed to render.

    Raises:
        UserError: When there is no such dataset, or the class or the assets differ.
    """
    root = Path(path)
    if render < 0:
        raise UserError(f"render must be at least 0; got {render}")
    split = complete_split(root, split)
    settings = read_info(root)["splits"][split]
    object_class = class_of(root, split, object_class)
    folder = root / split
    hashes = _manifest(folder, settings)
    size, normals = tuple(settings["size"]), settings["normals"]
    problems = [*_file_problems(folder, hashes), *_model_problems(root, object_class, size)]
    try:
        merged = merged_samples(root, split, settings["count"])
    except (OSError, ValueError, KeyError) as error:
        problems.append(f"the tables cannot be read or do not have {settings['count']} samples: {error}")
        return Findings(split, tuple(problems), 0, len(hashes), 0)
    problems += _setting_problems(root, split, settings, merged)
    with one_thread(), ThreadPoolExecutor(THREADS) as pool:
        checked = pool.map(lambda item: list(_sample_problems(folder, hashes, item, size, normals)), merged)
        problems += [problem for found in checked for problem in found]
    again = np.unique(np.linspace(0, len(merged) - 1, min(render, len(merged))).round().astype(int))
    if len(again):
        own = own or OwnAssets()
        if own.fingerprints() != settings["own_assets"]:
            raise UserError(
                f"'{root}' was made with {len(settings['own_assets'])} custom assets, which differ from"
                " those given; name their folders with --envmaps, --props and --furniture."
            )
        made_by = (settings["world_version"], WORLD_VERSION)
        if made_by[0] != made_by[1]:
            raise UserError(
                f"expected scenes of world version {made_by[1]}; '{root}' has version {made_by[0]}."
                " Check without --render, or with the release that made it."
            )
        # Before version 0.3 path-traced objects of the paper's world had finishes.
        options = {name: value for name, value in settings["options"].items() if name != "finish"}
        job = Job(settings["seed"], split, settings["tier"], object_class, options, own)  # type: ignore[arg-type]
        job = replace(job, photo=settings["photo"], world=settings["world"], size=size, normals=normals)
        problems += _render_problems(job, folder, [merged[index] for index in again])
    return Findings(split, tuple(problems), len(merged), len(hashes), len(again))


def _setting_problems(
    root: Path, split: str, settings: dict[str, Any], merged: list[dict[str, Any]]
) -> Iterator[str]:
    """Yield disagreements of info.json and BOP's targets with the samples."""
    if any(item["row"]["seed"] != settings["seed"] for item in merged):
        yield f"{INFO}: its seed differs from that of some sample"
    if any((item["row"]["photo"] is not None) != settings["photo"] for item in merged):
        yield f"{INFO}: its photo setting differs from that of some sample"
    if split == "test":
        expected = bop.localisation_targets([item["gt_info"][0] for item in merged])
        try:
            same = read_json(inside(root, bop.TARGETS), 256 * MAX_SAMPLES) == expected
        except (OSError, ValueError):
            same = False
        if not same:
            yield f"{bop.TARGETS}: missing, or does not list the samples of which enough is visible"


def _manifest(folder: Path, settings: dict[str, Any]) -> dict[str, str]:
    """Return names and hashes of the split's files. Raises UserError when the list itself is damaged."""
    path = folder / MANIFEST
    with reading(path, "the list of a dataset's files", REMEDY):
        data = read_bytes(inside(folder, MANIFEST), 512 * settings["count"] + 4096)
        lines = (line.split("  ", 1) for line in data.decode().splitlines())
        hashes = {name: value for value, name in lines}
        for name in hashes:
            inside(folder, name)
    if hashlib.sha256(data).hexdigest() != settings.get("manifest_sha256"):
        raise UserError(f"'{path}' was changed after it was written; make the dataset again.")
    return hashes


def _file_problems(folder: Path, hashes: dict[str, str]) -> Iterator[str]:
    """Yield extra files, and tables that have changed; pictures are checked sample by sample."""
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    for name in sorted(there - hashes.keys() - {MANIFEST}):
        yield f"{name}: an unexpected file"
    for name, value in hashes.items():
        if not name.endswith(".png"):
            yield from _read(folder, name, value)[1]


def _model_problems(root: Path, object_class: ObjectClass, size: Size) -> Iterator[str]:
    """Yield problems of the files that all splits share."""
    for name, expected in bop.shared_files(object_class, size).items():
        try:
            same = read_bytes(inside(root, name), 64 << 20) == expected
        except (OSError, ValueError):
            same = False
        if not same:
            yield f"{name}: missing or not that of the class"


def _read(folder: Path, name: str, value: str | None) -> tuple[bytes, list[str]]:
    """Return a file's content, and the problems of it as a file."""
    try:
        data = read_bytes(inside(folder, name), 1 << 31)
    except (OSError, ValueError) as error:
        return b"", [f"{name}: {getattr(error, 'strerror', None) or error}"]
    if value is None:
        return data, [f"{name}: not in {MANIFEST}"]
    changed = hashlib.sha256(data).hexdigest() != value
    return data, [f"{name}: changed since it was written (its hash differs)"] if changed else []


def merged_samples(root: Path, split: str, count: int) -> list[dict[str, Any]]:
    """Return each sample's row, spec and BOP entries; ValueError when the tables do not have `count` each."""
    rows = read_table(root, split).to_pylist()
    if [row["index"] for row in rows] != list(range(count)):
        raise ValueError("the table's indices are not 0, 1, 2 ...")
    specs, scene = read_specs(root / split, count), read_scene(root / split, count)
    return [{"row": row, "spec": spec, **each} for row, spec, each in zip(rows, specs, scene, strict=True)]


def _sample_problems(
    folder: Path, hashes: dict[str, str], item: dict[str, Any], size: Size, normals: bool
) -> Iterator[str]:
    """Yield the problems of one sample."""
    index = item["row"]["index"]
    pictures = {}
    for kind, path in image_paths(Path(), index, normals).items():
        data, problems = _read(folder, path.as_posix(), hashes.get(path.as_posix()))
        yield from problems
        try:
            pictures[kind] = decode_picture(data, kind, size)
        except ValueError as error:
            yield f"{path}: {error}"
            return
        except Exception:  # a decoder may raise anything on a damaged file
            yield f"{path}: an unreadable picture"
            return
    alone, visible = pictures["mask"], pictures["mask_visib"]
    if not np.isin([alone, visible], (0, 255)).all() or (visible > alone).any() or not alone.any():
        yield f"sample {index}: its masks are not of 0 and 255, the whole one around the visible one"
    try:
        SceneSpec.from_json(item["spec"])
    except ValueError as error:
        yield f"sample {index}: its spec cannot be read ({error})"


def _render_problems(job: Job, folder: Path, items: list[dict[str, Any]]) -> Iterator[str]:
    """Render samples again from their specs: the rasteriser's to the pixel, a path tracer's labels."""
    maker = Maker(job)
    try:
        for item in items:
            try:
                spec = SceneSpec.from_json(item["spec"])
            except ValueError:
                continue  # reported already
            try:
                files = maker.files(spec)
            except UserError:  # the renderer cannot run here
                raise
            except (ValueError, KeyError, TypeError, IndexError) as error:
                yield f"sample {spec.index}: cannot be made again from its spec ({error})"
                continue
            described = parse_json(files.popitem()[1])
            for kind, path in image_paths(Path(), spec.index, job.normals).items():
                name, exact = path.as_posix(), job.tier == "raster" or kind != "rgb"
                if exact and not _same_pixels(files[name], _read(folder, name, None)[0], kind, job.size):
                    yield f"{path}: differs when rendered again from its spec"
            row = described["row"]
            for key in ("gt", "gt_info", "camera"):
                if described[key] != item[key]:
                    yield f"sample {spec.index}: rendered again from its spec, its {key} differs"
            if row != item["row"]:
                names = ", ".join(sorted(name for name in row if row[name] != item["row"].get(name)))
                yield f"sample {spec.index}: rendered again from its spec, these columns differ: {names}"
            if maker.sample(spec.index, spec.rejected.get("scene", 0)) != spec:
                yield f"sample {spec.index}: its scene differs when drawn again from its seed"
    finally:
        maker.close()


def _same_pixels(made: bytes, stored: bytes, kind: str, size: Size) -> bool:
    """Return whether two image files show the same, however they are compressed."""
    try:
        return np.array_equal(decode_picture(made, kind, size), decode_picture(stored, kind, size))
    except (OSError, ValueError):  # it is damaged, which is reported elsewhere
        return False
