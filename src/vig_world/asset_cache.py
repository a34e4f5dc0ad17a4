"""Assets that were made before on this machine, as arrays in the user's cache folder."""

import functools
import hashlib
import json
import shutil
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file

import vig.scene
import vig_world
from vig.io.errors import UserError
from vig.io.files import cache_folder, write_arrays
from vig_native import engine

Arrays = dict[str, np.ndarray]


class AssetCache:
    """Arrays by name, a file each; damaged files are made again. None as folder keeps none.

    required: Whether a file that cannot be written is an error; else none is kept from then on.
    """

    def __init__(self, folder: Path | None, required: bool = False) -> None:
        self.folder, self.required = folder, required

    def arrays(self, name: str, make: Callable[[], Arrays]) -> Arrays:
        """Return the result of `make`, made once where the cache can be read and written.

        Args:
            name: Path within the folder, such as `train/prop/mug/3`.
            make: A pure function of the name and the code.
        """
        if self.folder is None:
            return make()
        path = self.folder / f"{name}.safetensors"
        try:
            return load_file(path)
        except (OSError, ValueError, SafetensorError):
            pass
        made = make()
        try:
            write_arrays(path, made)
        except (OSError, UserError, SafetensorError):  # a full disk, or one that is read only
            if self.required:
                raise
            self.folder = None
        return made


@functools.cache
def asset_cache() -> AssetCache:
    """Return the assets of this code in `cache_folder()`."""
    try:
        cache = cache_folder()
        folder = cache / f"world-{_version()}"
        if not folder.is_dir():
            folder.mkdir(parents=True)
            versions = sorted(cache.glob("world-*"), key=lambda path: path.stat().st_mtime)
            for old in versions[:-3]:  # two others stay
                shutil.rmtree(old, ignore_errors=True)
    except (OSError, RuntimeError):
        return AssetCache(None)
    return AssetCache(folder)


def _version() -> str:
    """Return a hash of the code, and of the libraries whose numbers it uses."""
    digest = hashlib.sha256()
    for package in (vig_world, vig.scene):
        root = Path(package.__path__[0])
        for path in sorted(root.rglob("*")):
            if path.suffix in (".py", ".json", ".npz", ".csv"):
                digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    digest.update(Path(str(engine.__file__)).read_bytes())
    for name in ("numpy", "scipy"):
        digest.update(metadata.version(name).encode())
    return digest.hexdigest()[:16]


def packed_text(value: object) -> np.ndarray:
    """Return plain data as an array of bytes; floats stay exact."""
    return np.frombuffer(json.dumps(value).encode(), np.uint8)


def unpacked_text(array: np.ndarray) -> list:
    """Return the inverse of `packed_text` for lists and tuples, as lists."""
    return json.loads(array.tobytes())
