"""Results of the stages of a build, kept on disk, so that a build that was stopped or changed goes on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

from vig.io.files import write_arrays

CACHE_VERSION = 1
"""Version of the cached results of stages; those of another version are computed again."""


@dataclass(frozen=True)
class StageCache:
    """Arrays by stage and inputs, a file for each.

    Attributes:
        folder: Of the files, made where it is missing.
    """

    folder: Path

    def result(
        self, stage: str, inputs: list[str], compute: Callable[[], Mapping[str, np.ndarray]]
    ) -> dict[str, np.ndarray]:
        """Return a stage's result for these inputs, from the cache where an earlier run left it there."""
        key = hashlib.sha256(json.dumps([CACHE_VERSION, stage, inputs]).encode()).hexdigest()[:24]
        path = self.folder / f"{stage}-{key}.safetensors"
        if path.exists():
            try:
                return load_file(path)
            except Exception:  # a damaged file is made again
                path.unlink()
        result = {name: np.ascontiguousarray(value) for name, value in compute().items()}
        write_arrays(path, result)
        return result
