"""Cut-outs of models in files: textured things of a user's, or of furniture catalogues, before objects."""

from __future__ import annotations

import functools
import hashlib
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from vig.io.errors import UserError
from vig_train.training.cutouts import render_cutout
from vig_world import Split
from vig_world.asset_cache import Arrays, asset_cache
from vig_world.assets import own
from vig_world.assets.own.catalogue import mesh_folder
from vig_world.assets.own.folder import files_of
from vig_world.assets.own.load import SUFFIXES, load
from vig_world.assets.own.props import standing_parts
from vig_world.assets.own.settings import settings_of
from vig_world.assets.own.standing import SizedKind
from vig_world.assets.things import is_of_class, prop

VIEWS = 8
"""Cut-outs of each model, each in another pose and light."""
SPLIT_SHARES: dict[Split, float] = {"train": 0.7, "validation": 0.1, "test": 0.2}
"""Shares of the models, by a hash of their names."""
_ANY_SIZE = SizedKind("thing", 1e-3, 100.0, furniture=False)
_MOST_FAILURES = 50
"""Models in a row that give no cut-out before a drawing is given up."""


@dataclass(frozen=True)
class ModelCutouts:
    """The models of one split, in the order of their names.

    Attributes:
        root: Folder of the files.
        files: Names of the files, relative to it.
    """

    root: Path
    files: tuple[str, ...]

    @property
    def fingerprint(self) -> str:
        """Return a hash of names and sizes of the files."""
        sizes = [f"{name} {(self.root / name).stat().st_size}" for name in self.files]
        return hashlib.sha256("\n".join(sizes).encode()).hexdigest()[:16]

    def draw(self, rng: np.random.Generator) -> Image.Image:
        """Draw one of the models in one of its poses: RGBA, sRGB, as large as its outline."""
        for _ in range(_MOST_FAILURES):
            name, number = self.files[int(rng.integers(len(self.files)))], int(rng.integers(VIEWS))
            if cutouts := _cutouts(self.root, name):
                return cutouts[number]
        raise UserError(f"{self.root}: expected models that can be drawn; {_MOST_FAILURES} could not.")


@functools.cache
def model_cutouts(source: str, split: Split, class_name: str) -> ModelCutouts:
    """Return the models of a folder or of catalogues that fall into a split and are not of a class.

    Args:
        source: Argument of `mesh_folder`.
        split: The same model always falls into the same split.
        class_name: Models with a name like this class's are left out: before a car no cars.

    Raises:
        UserError: There is no such folder, or no model in it that falls into the split.
    """
    root = mesh_folder(source)
    listed = [each for each in files_of(root, SUFFIXES) if not is_of_class(Path(each[0]).stem, class_name)]
    files = tuple(path.relative_to(root).as_posix() for name, path in listed if _split_of(name) == split)
    if not files:
        raise UserError(
            f"{source}: expected models for the {split} split; got none of {len(listed)}. Give more."
        )
    return ModelCutouts(root, files)


def _split_of(name: str) -> Split:
    place = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4]) / 2**32
    for split, share in SPLIT_SHARES.items():
        if place < share:
            return split
        place -= share
    return "test"


@functools.lru_cache(maxsize=2048)
def _cutouts(root: Path, name: str) -> tuple[Image.Image, ...]:
    """Return all cut-outs of a model; none where it cannot be read."""
    seed = hashlib.sha256(name.encode() + (root / name).read_bytes()).digest()

    def make() -> Arrays:
        path = root / name
        try:
            settings = settings_of(root, path, {})
            parts, _ = standing_parts(path, load(root, path, settings.nodes).pieces, settings, _ANY_SIZE)
        except UserError:
            return {}
        shown, rng = prop("model", *parts), np.random.default_rng(list(seed[:16]))
        # Some lie, at any angle.
        rolls = [rng.uniform(0, 2 * math.pi) * (rng.random() < 0.15) for _ in range(VIEWS)]
        return {str(n): np.asarray(render_cutout(rng, shown, roll)) for n, roll in enumerate(rolls)}

    made = asset_cache().arrays(f"{_code()}/{seed.hex()[:24]}", make)
    return tuple(Image.fromarray(made[str(n)]) for n in range(VIEWS)) if made else ()


@functools.cache
def _code() -> str:
    """Return the name under which the cut-outs of this code are kept."""
    reader = sorted(Path(own.__file__).parent.rglob("*.py"))
    files = [Path(__file__), Path(__file__).with_name("cutouts.py"), *reader]
    code = b"".join(file.read_bytes() for file in files)
    return f"model-cutouts-{hashlib.sha256(code).hexdigest()[:8]}"
