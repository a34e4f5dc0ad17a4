"""Makes a dataset on disk: in parallel, resumable, the same bytes whatever the number of workers."""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import shutil
import signal
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch
from PIL import Image
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from vig.dataset.format import (
    DEPTH_SCALE,
    FORMAT_VERSION,
    INFO,
    SCENE,
    class_fingerprint,
    describe,
    image_paths,
    read_info,
)
from vig.errors import UserError
from vig.files import atomic_write
from vig.scene import ObjectClass
from vig.synthesis.picture import Picture
from vig.synthesis.raster import render
from vig.synthesis.sampling import sample
from vig.synthesis.spec import SPLITS, Split

TIERS = ("raster",)
CHUNK = 8
"""Samples a worker takes at a time."""
_TEMPORARY = re.compile(r"\.[0-9a-f]{12}(\.\w+)?")


def make_dataset(
    out: str | Path,
    count: int,
    seed: int,
    tier: str = "raster",
    split: str = "train",
    workers: int | None = None,
    progress: bool = True,
    object_class: ObjectClass | None = None,
) -> Path:
    """Make (or go on making) `count` samples of a split in folder `out`; see `vig.dataset.format`.

    A run that was killed is completed by the same call: samples that are there stay. workers: processes;
    None takes one per CPU. progress: a bar on standard error. object_class: the packaged teapot by default.

    Returns:
        `out`.

    Raises:
        UserError: a wrong argument; `out` holds something else or a split made with other settings; the disk
            is full; a worker was killed.
        KeyboardInterrupt: after the samples in progress are done; call again to go on.
    """
    root = Path(out)
    if count < 1:
        raise UserError(f"count must be at least 1; got {count}")
    if not 0 <= seed < 2**63:
        raise UserError(f"seed must be from 0 to 2^63 - 1; got {seed}")
    if split not in SPLITS:
        raise UserError(f"split must be one of {', '.join(SPLITS)}; got '{split}'")
    if tier not in TIERS:
        raise UserError(f"tier must be one of {', '.join(TIERS)}; got '{tier}'")
    if workers is not None and workers < 1:
        raise UserError(f"workers must be at least 1; got {workers}")
    if object_class is None:
        object_class = ObjectClass.load("teapot")

    settings = {
        "class": object_class.name,
        "class_fingerprint": class_fingerprint(object_class),
        "seed": seed,
        "count": count,
        "tier": tier,
    }
    if _claim(root, split, settings):
        shutil.rmtree(root / split / "partial", ignore_errors=True)
        return root
    _sweep(root / split)
    missing = [index for index in range(count) if not _sidecar(root / split, index).is_file()]
    job = _Job(root / split, seed, split, object_class)
    _generate(job, missing, count, workers or os.cpu_count() or 1, progress)
    _merge(root, split, settings)
    return root


def _claim(root: Path, split: str, settings: dict[str, Any]) -> bool:
    """Write the split's settings into info.json, or check that they are the same; True if it is complete."""
    info: dict[str, Any] = {"vig_dataset": FORMAT_VERSION, "splits": {}}
    if root.is_dir() and any(root.iterdir()):
        info = read_info(root)
    elif root.exists() and not root.is_dir():
        raise UserError(f"expected a folder for the dataset; '{root}' is a file. Choose another name.")
    held = info["splits"].get(split)
    if held is None:
        info["splits"][split] = {**settings, "complete": False}
        _write_json(root / INFO, info)
        return False
    for key, value in settings.items():
        if held.get(key) != value:
            raise UserError(
                f"'{root}' already holds a {split} split with {key} {held.get(key)}; {value} was asked for. "
                "Choose another folder or the same settings."
            )
    return bool(held["complete"])


def _sweep(folder: Path) -> None:
    """Remove the temporary files that a killed run left."""
    for path in folder.rglob(".*") if folder.is_dir() else ():
        if _TEMPORARY.fullmatch(path.name):
            path.unlink(missing_ok=True)


class _Job:
    """What a worker needs to make any sample of a split."""

    def __init__(self, folder: Path, seed: int, split: Split, object_class: ObjectClass) -> None:
        self.folder, self.seed, self.split, self.object_class = folder, seed, split, object_class

    def make(self, indices: list[int]) -> int:
        """Make and write samples; the sidecar comes last and says that a sample is whole."""
        with _one_thread():
            for index in indices:
                spec = sample(self.object_class, self.seed, index, self.split)
                picture = render(spec, self.object_class)
                _write_images(picture, image_paths(self.folder, index))
                _write_json(_sidecar(self.folder, index), describe(spec, picture, self.object_class))
        return len(indices)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Sums in torch depend on the number of threads; bytes must not."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def _one_thread_in_children() -> Iterator[None]:
    """Processes started inside get one thread for linear algebra: the workers fill the CPUs already."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


_job: _Job | None = None


def _start_worker(job: _Job) -> None:
    global _job
    _job = job
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent; samples in progress are finished


def _work(indices: list[int]) -> int:
    assert _job is not None
    return _job.make(indices)


def _generate(job: _Job, missing: list[int], count: int, workers: int, progress: bool) -> None:
    chunks = [missing[i : i + CHUNK] for i in range(0, len(missing), CHUNK)]
    bar = Progress(
        TextColumn("samples"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        disable=not progress,
    )
    with bar, _one_thread_in_children():
        task = bar.add_task("samples", total=count, completed=count - len(missing))
        if min(workers, len(chunks)) <= 1:
            for index in missing:
                bar.advance(task, job.make([index]))
            return
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(min(workers, len(chunks)), context, _start_worker, (job,))
        try:
            for done in as_completed([pool.submit(_work, chunk) for chunk in chunks]):
                bar.advance(task, done.result())
        except BrokenProcessPool as error:
            raise UserError(
                "a worker process was killed, perhaps for want of memory; what is done stays. "
                "Run the same command again, with fewer workers."
            ) from error
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _write_images(picture: Picture, paths: dict[str, Path]) -> None:
    units = np.where(np.isfinite(picture.depth), picture.depth * (1000 / DEPTH_SCALE), 0.0)
    images = {
        "rgb": picture.image,
        "depth": np.round(units).clip(0, 65535).astype(np.uint16),
        "mask": picture.amodal.astype(np.uint8) * 255,
        "mask_visib": picture.visible.astype(np.uint8) * 255,
    }
    for name, path in paths.items():
        with atomic_write(path) as temporary:
            Image.fromarray(images[name]).save(temporary, compress_level=3)


def _sidecar(folder: Path, index: int) -> Path:
    return folder / "partial" / f"{index:06d}.json"


def _write_json(path: Path, data: Any) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(data))


def _merge(root: Path, split: str, settings: dict[str, Any]) -> None:
    """Turn the sidecars into the split's files and mark it complete."""
    folder = root / split
    records = [json.loads(_sidecar(folder, index).read_text()) for index in range(settings["count"])]
    for name, key in (("scene_camera", "camera"), ("scene_gt", "gt"), ("scene_gt_info", "gt_info")):
        merged = {str(index): record[key] for index, record in enumerate(records)}
        _write_json(folder / SCENE / f"{name}.json", merged)
    with atomic_write(folder / "specs.jsonl") as temporary:
        temporary.write_text("".join(record["spec"] + "\n" for record in records))
    with atomic_write(folder / "latents.parquet") as temporary:
        pq.write_table(pa.Table.from_pylist([record["row"] for record in records]), temporary)
    rejections: Counter[str] = Counter()
    for record in records:
        rejections.update(record["rejected"])
    info = read_info(root)
    info["splits"][split] = {**settings, "complete": True, "rejections": dict(sorted(rejections.items()))}
    _write_json(root / INFO, info)
    shutil.rmtree(folder / "partial")
