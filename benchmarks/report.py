"""What the benchmarks share: metrics with a direction and intervals, the machine, and the JSON file."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

import numpy as np

from vig.cli.doctor import processor
from vig.files import atomic_write

Better = Literal["higher", "lower"]


def metric(name: str, values: Iterable[float], unit: str, better: Better = "lower") -> dict[str, Any]:
    """Median and interquartile range of repeated measurements, to four significant digits."""
    low, middle, high = np.percentile(np.asarray(list(values), np.float64), [25, 50, 75])
    return {
        "name": name,
        "value": float(f"{middle:.4g}"),
        "unit": unit,
        "better": better,
        "iqr": float(f"{high - low:.4g}"),
    }


def report(metrics: list[dict[str, Any]], threads: int, packages: Iterable[str] = ()) -> dict[str, Any]:
    """`{"machine", "versions", "metrics"}`, ready for JSON; `packages` are listed beside our own."""
    names = ["vig", "torch", "warp-lang", "numpy", *packages]
    versions = {name: metadata.version(name) for name in names}
    return {
        "machine": {"processor": processor(), "cpus": os.cpu_count(), "threads": threads},
        "versions": {"python": platform.python_version(), **versions},
        "metrics": metrics,
    }


def write(found: dict[str, Any], path: Path) -> None:
    """Write a report as JSON, whole or not at all. UserError when it cannot be written there."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(found, indent=2) + "\n")
