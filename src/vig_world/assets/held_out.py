"""Designs of a class, each for one split's scenes; the shape model knows those of training only."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from vig.io.checks import check_arrays, decode, read_json, read_tensors, reading
from vig.io.files import write_arrays, write_json
from vig.scene import ObjectClass
from vig_world.assets.coded_designs import PARAMETERS_FILE, coded_vertices

DESIGNS_FILE = "designs.safetensors"
NAMED = "held_out_designs"  # where class.json names them, in the order of the file's rows


@dataclass(frozen=True)
class _Named:
    """Entry of one held-out design in class.json."""

    name: str
    split: str


@dataclass(frozen=True, eq=False)
class HeldOutDesigns:
    """D shapes in correspondence with a class's model, which was not made from those of test and validation.

    Attributes:
        names: (D,) name of each.
        splits: (D,) the only split of datasets whose objects are of this design.
        vertices: (D, V, 3) float32, metres, standing on z = 0.
    """

    names: tuple[str, ...]
    splits: tuple[str, ...]
    vertices: np.ndarray

    def save(self, folder: Path) -> None:
        """Add the designs to a class pack that `ObjectClass.save` has written."""
        write_arrays(folder / DESIGNS_FILE, {"vertices": self.vertices})
        (folder / PARAMETERS_FILE).unlink(missing_ok=True)
        name_designs(folder, zip(self.names, self.splits, strict=True))


def name_designs(folder: Path, designs: Iterable[tuple[str, str]]) -> None:
    """Name designs in class.json, each with its split."""
    named = [{"name": name, "split": split} for name, split in designs]
    described = read_json(folder / "class.json") | {NAMED: named}
    write_json(folder / "class.json", described, 1)


@lru_cache(maxsize=8)
def held_out_designs_of(object_class: ObjectClass) -> HeldOutDesigns | None:
    """Read the designs of a class's pack; None when it has none, or the class was built in memory.

    Raises:
        UserError: They are missing or damaged.
    """
    if object_class.folder is None:
        return None
    path = object_class.folder / "class.json"
    with reading(path, "the description of a class", "Build or copy it again."):
        named = decode(tuple[_Named, ...], decode(dict[str, Any], read_json(path)).get(NAMED, ()))
    if not named:
        return None
    names, splits = tuple(each.name for each in named), tuple(each.split for each in named)
    coded = (object_class.folder / PARAMETERS_FILE).exists()
    path = object_class.folder / (PARAMETERS_FILE if coded else DESIGNS_FILE)
    with reading(path, "a class's held-out designs", "Build or copy it again."):
        arrays = {"vertices": coded_vertices(path, names)} if coded else read_tensors(path)[0]
        shape = (len(named), len(object_class.shape_model.mean), 3)
        check_arrays(arrays, {"vertices": ("float32", shape)})
    return HeldOutDesigns(names, splits, arrays["vertices"])
