"""Designs whose vertices code makes: a class pack holds their parameters, at most 0.1 MB in place of 5 MB."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from vig.io.checks import decode, read_json
from vig_world.asset_cache import asset_cache
from vig_world.assets.designs.design import TEAPOTS, TeapotDesign
from vig_world.assets.designs.teapot import teapot_vertices
from vig_world.assets.mugs.design import MUGS, MugDesign
from vig_world.assets.mugs.mug import mug_vertices

PARAMETERS_FILE = "designs.json"
Design = TeapotDesign | MugDesign
Kind = Literal["teapot", "mug"]
CATALOGUE: dict[Kind, dict[str, Any]] = {
    "teapot": {each.name: each for of_split in TEAPOTS.values() for each in of_split},
    "mug": {each.name: each for of_split in MUGS.values() for each in of_split},
}


@dataclass(frozen=True)
class Parameters:
    """Content of `PARAMETERS_FILE`: parameters of designs outside the kind's catalogue, by name."""

    kind: Kind
    drawn: dict[str, dict[str, Any]]


def coded_vertices(path: Path, names: Sequence[str]) -> np.ndarray:
    """Return vertices (D, V, 3) float32 of the named designs of a `PARAMETERS_FILE`, metres.

    Raises:
        ValueError, OSError: The file is missing or damaged, or lacks one of the names.
    """
    parameters = decode(Parameters, read_json(path))
    of_kind: type[Design] = TeapotDesign if parameters.kind == "teapot" else MugDesign
    designs = CATALOGUE[parameters.kind] | {
        name: decode(of_kind, {"name": name} | values) for name, values in parameters.drawn.items()
    }
    if missing := [name for name in names if name not in designs]:
        raise ValueError(f"no parameters of '{missing[0]}'")
    chosen = [designs[name] for name in names]
    make = teapot_vertices if parameters.kind == "teapot" else mug_vertices
    file = f"designs/{parameters.kind}-{hashlib.sha256(repr(chosen).encode()).hexdigest()[:16]}"
    made = asset_cache().arrays(file, lambda: {"vertices": np.stack([make(each) for each in chosen])})
    return made["vertices"]
