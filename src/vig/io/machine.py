"""The machine that vig runs on, as reports and records of runs state it."""

import os
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

import vig

PACKAGES = (
    *("numpy", "onnxruntime", "pillow", "safetensors"),
    *("torch", "scipy", "trimesh", "pyarrow", "OpenImageIO", "matplotlib"),
)
"""Packages whose versions are stated."""


def machine() -> dict[str, Any]:
    """Return the machine that vig runs on, as plain data.

    `{"vig", "python", "platform", "architecture", "processor", "cpus", "packages": {name: version or None}}`.
    """
    return {
        "vig": vig.__version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "architecture": platform.machine(),
        "processor": processor(),
        "cpus": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "packages": {name: _version(name) for name in PACKAGES},
    }


def processor(root: Path = Path("/")) -> str:
    """Return the processor's model; on arm64 the board's, the architecture where the system reports neither.

    root: Root of the files that state it.
    """
    try:
        lines = (root / "proc/cpuinfo").read_text().splitlines()
        for line in lines:
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
        return (root / "proc/device-tree/model").read_text().strip(" \0\n")
    except OSError:
        return platform.processor() or platform.machine()


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
