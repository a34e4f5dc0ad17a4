"""Causes of vig's slowness on this machine, and gains by the optional packages: lines of `vig doctor`."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from vig.io.files import cache_folder

LARGE_CACHE = 500_000_000  # bytes of the cache folder from which its removal is named
CGROUPS = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
)
"""Files with a container's limit of memory and its use of it, version 2 and 1."""


@dataclass(frozen=True)
class Finding:
    """One finding: aspect, state, remedy; no remedy where all is well."""

    what: str
    state: str
    do: str = ""


@dataclass(frozen=True)
class Extra:
    """Packages of an extra of pyproject.toml, by the names of their imports, and their benefits."""

    modules: tuple[str, ...]
    brings: str


EXTRAS = {
    "heic": Extra(("pillow_heif",), "photos of iPhones"),
    "match": Extra(("cv2",), "objects of meshes found in whole photos"),
    "video": Extra(("av",), "videos, cameras and streams"),
    "world": Extra(
        (
            *("mapbox_earcut", "matplotlib", "OpenImageIO", "plyfile"),
            *("pyarrow", "scipy", "skimage", "trimesh"),
        ),
        "datasets, classes of your own meshes, results.parquet",
    ),
    "train": Extra(("torch",), "training networks, the paper's experiments"),
    "torch": Extra(("torch",), "vig.renderer, the differentiable renderer"),
    "draco": Extra(("DracoPy",), "Draco-compressed glTF meshes"),
    "serve": Extra(("fastapi", "multipart", "uvicorn"), "vig serve: photos explained over HTTP"),
    "usd": Extra(("pxr",), "vig fit --export usd"),
    "cluster": Extra(("ray",), "--cluster, --ray: several machines"),
    "cycles": Extra(
        ("bpy",), "--tier cycles: path-traced datasets; docs/world.md has how to install it apart"
    ),
}
"""Those for users, the most wanted first."""


def threads(cpus: int) -> Finding:
    """Return the finding on the number of processors that a fit uses."""
    from vig.parallel import thread_count

    count = thread_count()
    state = f"{count} on {cpus} processors"
    if count == cpus:
        return Finding("threads", state)
    if count > cpus:
        return Finding("threads", state, f"they wait for each other: export OMP_NUM_THREADS={cpus}")
    set_here = os.environ.get("OMP_NUM_THREADS")
    remedy = "unset OMP_NUM_THREADS" if set_here else f"export OMP_NUM_THREADS={cpus}"
    return Finding("threads", state, f"to use all: {remedy}; of many photos vig fit --workers {cpus}")


def load(cpus: int) -> Finding:
    """Return the finding on other processes' load of the processors."""
    try:
        running = os.getloadavg()[0]
    except (AttributeError, OSError):
        return Finding("load", "unknown on this system")
    state = f"{running:.1f} processes on {cpus} processors in the last minute"
    return Finding("load", state, "vig waits for them: end them, or wait" if running > cpus else "")


def memory(cpus: int) -> Finding:
    """Return the finding on the number of processes of `vig fit` that fit into memory."""
    there = memory_of()
    if there is None:
        return Finding("memory", "unknown on this system")
    total, free = there
    # Bytes of a process of `vig fit` on photos of up to 12 million pixels; docs/boards.md.
    worker_memory = 480 << 20
    workers = free // worker_memory
    state = f"{free / 1e9:.1f} of {total / 1e9:.1f} GB free, for {workers} processes of vig fit"
    if workers >= cpus:
        return Finding("memory", state)
    need = f"{worker_memory / 1e9:.1f} GB each"
    if total < worker_memory:
        return Finding("memory", state, f"too small for a fit, which may be killed: {need}; add swap")
    if not workers:
        return Finding("memory", state, f"free some, or fits may be killed: {need}")
    return Finding("memory", state, f"no more than --workers {workers}: {need}")


def cache_state(folder: Path | None = None) -> Finding:
    """Return the finding on the size of vig's cache folder."""
    try:
        folder = folder or cache_folder()
    except RuntimeError:
        return Finding("cache", "none, as there is no home folder")
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    remedy = "all may be deleted: vig doctor --clean" if size > LARGE_CACHE else ""
    return Finding("cache", f"{size / 1e6:.0f} MB in {folder}", remedy)


def memory_of(root: Path = Path("/")) -> tuple[int, int] | None:
    """Return bytes in all and those free without swapping, within a container's limit; None where unknown.

    root: Root of the files that state it.
    """
    try:
        lines = (root / "proc/meminfo").read_text().splitlines()
        total, free = (
            1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))
            for name in ("MemTotal:", "MemAvailable:")
        )
    except (OSError, StopIteration, ValueError):
        return None
    for limit, used in CGROUPS:
        try:
            most, now = (int((root / path.lstrip("/")).read_text()) for path in (limit, used))
        except (OSError, ValueError):  # no such file, or "max"
            continue
        total, free = min(total, most), min(free, max(0, most - now))
    return total, free


def extras(known: Mapping[str, Extra] = EXTRAS) -> dict[str, dict[str, Any]]:
    """Return each extra's `{"missing": [modules], "brings", "install"}`; Blender may be elsewhere."""
    apart = {"bpy"} if os.environ.get("VIG_BLENDER_PYTHON") else set()
    return {
        extra_name: {
            "missing": [name for name in extra.modules if name not in apart and find_spec(name) is None],
            "brings": extra.brings,
            "install": f"pip install 'vig[{extra_name}]'",
        }
        for extra_name, extra in known.items()
    }


def extra_of(module: str) -> str | None:
    """Return the extra that brings a module, if one does."""
    return next((name for name, extra in EXTRAS.items() if module.split(".")[0] in extra.modules), None)


def rows(
    speed: Sequence[Mapping[str, str]], optional: Mapping[str, Mapping[str, Any]]
) -> list[tuple[str, str]]:
    """Return the lines of a report: names and texts."""
    lines = [(each["what"], "; ".join(filter(None, (each["state"], each["do"])))) for each in speed]
    for name, each in optional.items():
        missing = f"without {', '.join(each['missing'])} no {each['brings']}; {each['install']}"
        lines.append((f"extra {name}", missing if each["missing"] else f"ok: {each['brings']}"))
    return lines
