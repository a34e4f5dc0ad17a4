"""Makes a dataset on disk: parallel, resumable, with bytes that do not depend on the number of workers."""

import hashlib
import os
import re
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # Windows: simultaneous runs are not detected there
    fcntl = None  # type: ignore[assignment]


from vig.io.checks import read_json, reading
from vig.io.errors import UserError
from vig.io.files import atomic_write, write_bytes
from vig.io.progress import Meter
from vig.parallel import check_main_module
from vig.parallel.cluster import require_ray
from vig.scene import ObjectClass
from vig_world import WORLDS, World
from vig_world.composition.place import zone_weights
from vig_world.dataset.format import (
    FORMAT_VERSION,
    INFO,
    MANIFEST,
    PARTIAL,
    SCENE,
    STANDARD_SIZE,
    TABLE,
    Size,
    check_size,
    inside,
    read_info,
)
from vig_world.dataset.spec import SPLITS, WORLD_VERSION
from vig_world.extras import optional_import
from vig_world.generation import bop
from vig_world.generation.files import sidecar_path, write_json
from vig_world.generation.job import TIERS, Job
from vig_world.generation.pool import make_samples
from vig_world.library import OwnAssets

with optional_import("world"):
    import pyarrow as pa
    import pyarrow.parquet as pq


def make_dataset(
    out: str | Path,
    count: int,
    seed: int,
    tier: str = "raster",
    split: str = "train",
    workers: int | None = None,
    progress: bool = True,
    object_class: ObjectClass | None = None,
    options: Mapping[str, Any] | None = None,
    own: OwnAssets | None = None,
    photo: bool = False,
    ray: str | None = None,
    world: World = "photo",
    size: Size = STANDARD_SIZE,
    normals: bool = False,
) -> Path:
    """Make, or resume making, `count` samples of a split in folder `out`; see docs/dataset.md.

    A run that was killed is completed by the same call: existing samples are kept.

    Args:
        out: Folder of the dataset.
        count: Number of samples.
        seed: Sample i is a pure function of the seed and i.
        tier: The renderer, `raster` or `cycles`.
        split: Split of the assets and object designs; splits share none.
        workers: Number of processes; None: one per CPU.
        progress: Whether to report progress on standard error.
        object_class: The packaged teapot by default.
        options: Settings of the renderer.
        own: The user's custom assets.
        photo: Whether to pass pictures through a camera model.
        ray: Address of a Ray cluster, or `auto`, in place of worker processes.
        world: Kind of scenes, see `vig_world.WORLDS`.
        size: Width and height of pictures, pixels; scenes are the same at any size.
        normals: Whether to write pictures of surface normals, too.

    Returns:
        `out`.

    Raises:
        UserError: For a wrong argument; when `out` holds something else or a split made with other settings,
            the disk is full, not one scene can be made, or there is no cluster.
        KeyboardInterrupt: After the samples in progress are done; call again to resume.
    """
    root = Path(out)
    for name, number in (("count", count), ("workers", workers)):
        if number is not None and number < 1:
            raise UserError(f"{name} must be at least 1; got {number}")
    if not 0 <= seed < 2**63:
        raise UserError(f"seed must be from 0 to 2^63 - 1; got {seed}")
    if split not in SPLITS:
        raise UserError(f"split must be one of {', '.join(SPLITS)}; got '{split}'")
    for name, chosen, known in (("tier", tier, TIERS), ("world", world, WORLDS)):
        if chosen not in known:
            raise UserError(f"{name} must be one of {', '.join(known)}; got '{chosen}'")
    check_size(size)
    own = own or OwnAssets()
    given = {"tier": tier, "size": size, "normals": normals, "photo": photo, "own assets": own}
    plain = ("raster", STANDARD_SIZE, False, False, OwnAssets())
    others = [name for (name, value), usual in zip(given.items(), plain, strict=True) if value != usual]
    if world == "studio" and others:
        raise UserError(
            "expected photographed images of 150x150 pixels by the rasteriser, without normals or own assets,"
            f" as the studio makes; got another {', '.join(others)}. Leave it out or choose another world."
        )
    if object_class is None:
        object_class = ObjectClass.load("teapot")
    zone_weights(object_class)  # refuses zones that no room has
    if ray is None and count > 1 and workers != 1:
        check_main_module()

    renderer_options = dict(options or {})
    job = Job(seed, split, tier, object_class, renderer_options, own, photo, world, size, normals)
    settings = {
        "class": object_class.name,
        "class_fingerprint": object_class.fingerprint,
        "seed": seed,
        "count": count,
        "tier": tier,
        "options": dict(job.options),
        "photo": photo,
        "world": world,
        "own_assets": job.own.fingerprints(),
        "world_version": WORLD_VERSION,
        "size": list(size),
        "normals": normals,
    }
    if job.own.sources:
        settings["own_sources"] = [asdict(source) for source in job.own.sources]
    if ray is not None:  # options that cannot run here are refused before anything is written
        require_ray()
    elif tier == "cycles":
        from vig_world.renderers.cycles.renderer import find_python

        find_python()
    folder = root / split
    with alone(root, split):
        if _claim(root, split, settings):
            shutil.rmtree(folder / PARTIAL, ignore_errors=True)
            return root
        _sweep(folder)
        missing = [index for index in range(count) if not sidecar_path(folder, index).is_file()]
        with Meter(count, count - len(missing), progress) as meter:
            processes = min(workers or os.cpu_count() or 1, len(missing))
            make_samples(job, folder, missing, processes, meter.advance, ray)
        _merge(root, split, settings, object_class)
    return root


@contextmanager
def alone(root: Path, split: str) -> Iterator[None]:
    """Hold a split's lock, so that two runs do not make it at once; the lock ends with the process.

    Raises:
        UserError: When another run holds it, or the folder cannot be made.
    """
    if fcntl is None or (root.exists() and not root.is_dir()):
        yield
        return
    path = root / f".{split}.lock"
    try:
        root.mkdir(parents=True, exist_ok=True)
        # A link in the lock's place is not followed, and its target is not emptied.
        lock = open(os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666), "r+b", buffering=0)
    except OSError as error:
        raise UserError(f"cannot write '{path}': {error.strerror or error}") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise UserError(
                f"another run is making the {split} split of '{root}'; wait for it, or choose another folder."
            ) from error
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


def _claim(root: Path, split: str, settings: dict[str, Any]) -> bool:
    """Write the split's settings into info.json, or check that they are the same; True if it is complete."""
    info: dict[str, Any] = {"vig_dataset": FORMAT_VERSION, "splits": {}}
    if root.is_dir() and any(not path.name.startswith(".") for path in root.iterdir()):
        info = read_info(root)
    elif root.exists() and not root.is_dir():
        raise UserError(f"expected a folder for the dataset; '{root}' is a file. Choose another name.")
    for other, held in info["splits"].items():
        shared = ("class_fingerprint", "size")  # of camera.json and models
        for key, value in settings.items():
            if (other == split or key in shared) and held.get(key) != value:
                raise UserError(
                    f"'{root}' already holds a {other} split with {key} {held.get(key)}; {value} was asked"
                    " for. Choose another folder or the same settings."
                )
    if split in info["splits"]:
        return bool(info["splits"][split]["complete"])
    info["splits"][split] = {**settings, "complete": False}
    write_json(root / INFO, info)
    return False


def _sweep(folder: Path) -> None:
    """Remove the temporary files that a killed run left in and above a split's folder."""
    left = [*folder.rglob(".*"), *folder.parent.glob(".*"), *(folder.parent / "models").glob(".*")]
    for path in left:
        if re.fullmatch(r"\.[0-9a-f]{12}(\.\w+)?", path.name):
            path.unlink(missing_ok=True)


def _merge(root: Path, split: str, settings: dict[str, Any], object_class: ObjectClass) -> None:
    """Turn the sidecars into the split's files and mark it complete."""
    folder = root / split
    with reading(
        folder / PARTIAL, "the finished samples of a dataset", "Remove the folder and make them again."
    ):
        paths = [sidecar_path(folder, index) for index in range(settings["count"])]
        records = [read_json(inside(folder, path.relative_to(folder))) for path in paths]
    hashes = {name: value for record in records for name, value in record["sha256"].items()}
    for name, key in (("scene_camera", "camera"), ("scene_gt", "gt"), ("scene_gt_info", "gt_info")):
        path = folder / SCENE / f"{name}.json"
        written = write_json(path, {str(index): record[key] for index, record in enumerate(records)})
        hashes[path.relative_to(folder).as_posix()] = hashlib.sha256(written).hexdigest()
    specs = "".join(record["spec"] + "\n" for record in records).encode()
    write_bytes(folder / "specs.jsonl", specs)
    hashes["specs.jsonl"] = hashlib.sha256(specs).hexdigest()
    table_path = folder / TABLE
    with atomic_write(table_path) as temporary:
        pq.write_table(_table([record["row"] for record in records]), temporary)
    hashes[TABLE] = hashlib.sha256(table_path.read_bytes()).hexdigest()

    for name, data in bop.shared_files(object_class, tuple(settings["size"])).items():
        write_bytes(root / name, data)
    if split == "test":
        write_json(root / bop.TARGETS, bop.localisation_targets([record["gt_info"][0] for record in records]))

    manifest = "".join(f"{value}  {name}\n" for name, value in sorted(hashes.items())).encode()
    write_bytes(folder / MANIFEST, manifest)
    rejections: Counter[str] = Counter()
    for record in records:
        rejections.update(record["rejected"])
    info = read_info(root)
    info["splits"][split] = {
        **settings,
        "complete": True,
        "rejections": dict(sorted(rejections.items())),
        "redrawn": sum("scene" in record["rejected"] for record in records),
        "rejections_per_sample": round(sum(rejections.values()) / settings["count"], 4),
        "manifest_sha256": hashlib.sha256(manifest).hexdigest(),
    }
    _sweep(folder)
    write_json(root / INFO, info)
    shutil.rmtree(folder / PARTIAL)


def _table(rows: list[dict[str, Any]]) -> pa.Table:
    """Return the rows as a table; columns that are empty everywhere keep their type."""
    table = pa.Table.from_pylist(rows)
    types = {"photo": pa.string(), "hidden_by": pa.list_(pa.string()), "assets": pa.list_(pa.string())}
    for name, wanted in types.items():
        place = table.column_names.index(name)
        table = table.set_column(place, name, table[name].cast(wanted))
    return table
