"""Unpacks chosen models of furniture catalogues, once, to a folder of plain files in the user's cache."""

import hashlib
import posixpath
import re
import shutil
import time
import unicodedata
import zipfile
from collections import Counter
from pathlib import Path

from vig.io.errors import UserError
from vig.io.files import atomic_folder, cache_folder
from vig_world.assets.own.catalogue.choice import Choice, choice_of
from vig_world.assets.own.catalogue.fitting import fit_obj, material_files, picture_files
from vig_world.assets.own.catalogue.reading import CatalogueModel, read_entry
from vig_world.assets.own.catalogue.sources import SOURCES_FILE, Source, Sources
from vig_world.assets.own.catalogue.zones import head_words, zones_of
from vig_world.assets.own.counting import refuse_huge
from vig_world.assets.own.furniture_families import family_of_thing
from vig_world.assets.own.load import PICTURES
from vig_world.assets.own.settings import FILE as SETTINGS_FILE

FORMAT = 1  # version of unpacked folders, to be raised with any change of them; those of another are not used
MAX_ENTRY = 256 << 20  # bytes of one file of a catalogue, unpacked
MAX_UNPACKED = 4 << 30  # bytes of all files that are unpacked at once
_LONGEST_NAME = 60


def mesh_folder(source: str | Path) -> Path:
    """Return the folder of meshes an argument names: itself, or the unpacked models of furniture catalogues.

    Models are unpacked to the user's cache folder when they are first asked for: an OBJ file each, in metres,
    Z up, front -Y, of the catalogue's size, with materials and pictures, a `vig.toml` with its family and
    its zones, and `sources.json` with names, authors and licences.

    Args:
        source: A folder of meshes, returned as it is, also when it does not exist; `catalogue.sh3f`; a folder
            of such catalogues; either of these with `:word,word`, which picks models by a word of their name,
            tags or category.

    Raises:
        UserError: A catalogue is missing, damaged, or has not one usable model; a word picks nothing; the
            cache folder cannot be written.
    """
    choice = choice_of(source)
    if choice is None:
        return Path(source)
    digest = hashlib.sha256(f"{FORMAT}\n{','.join(choice.words)}\n".encode())
    for path in choice.catalogues:
        digest.update(f"{path.name}\0{_sha256(path)}\n".encode())
    stem = choice.catalogues[0].stem if len(choice.catalogues) == 1 else "catalogues"
    name = "-".join([_slug(stem, "catalogue"), *map(_slug, choice.words)])[:_LONGEST_NAME]
    folder = _cache() / f"{name}-{digest.hexdigest()[:24]}"
    if folder.is_dir():  # first: a folder that another process makes meanwhile must not be removed
        if (folder / SOURCES_FILE).is_file():
            return folder
        shutil.rmtree(folder, ignore_errors=True)  # somebody removed files of it
    _remove_abandoned(folder.parent)
    with atomic_folder(folder) as temporary:
        _unpack(choice, temporary)
    return folder


def _unpack(choice: Choice, folder: Path) -> None:
    """Unpack the chosen models into an empty folder. UserError when not one of them can be used."""
    models = choice.models()
    left_out: dict[str, str] = {}
    sources: list[Source] = []
    with _Unpacker(choice.catalogues) as unpacker:
        for model, name in zip(models, _unique_names(models), strict=True):
            try:
                unpacker.unpack(model, folder / name)
            except UserError as error:
                shutil.rmtree(folder / name, ignore_errors=True)
                left_out[_describe(model, left_out)] = str(error)
                continue
            file = f"{name}/{name}.obj"
            sources.append(Source(file, model.name, model.creator, model.licence, model.catalogue.name))
    if not sources:
        name, reason = next(iter(left_out.items()))
        raise UserError(f"expected usable models; got none of {len(models)}. {name}: {reason}")
    (folder / SETTINGS_FILE).write_text('[defaults]\nup = "z"\nscale = 1.0\n')
    Sources(tuple(sorted(sources, key=lambda source: source.file)), left_out).write(folder)


class _Unpacker:
    """Reads models out of catalogues, up to a number of bytes altogether."""

    def __init__(self, catalogues: tuple[Path, ...]) -> None:
        self.left = MAX_UNPACKED
        self.archives = {path: zipfile.ZipFile(path) for path in catalogues}
        self.entries = {
            path: {key: name for name in archive.namelist() for key in (name.lower(), name)}
            for path, archive in self.archives.items()
        }

    def __enter__(self) -> "_Unpacker":
        return self

    def __exit__(self, *error: object) -> None:
        for archive in self.archives.values():
            archive.close()

    def unpack(self, model: CatalogueModel, folder: Path) -> None:
        """Write a model's files into a new folder, whose name the OBJ file gets. UserError when it cannot."""
        rotation, size = model.rotation(), model.size()
        path = _inside(model.path)
        if not path.lower().endswith(".obj"):
            raise UserError(f"expected a model in an OBJ file; got '{model.path[:100]}'.")
        data = self._read(model.catalogue, path)
        folder.mkdir()
        out = folder / f"{folder.name}.obj"
        try:
            out.write_bytes(data)
            refuse_huge(out)
            fitted = fit_obj(data, rotation, size)
        except UserError as error:
            raise UserError(str(error).removeprefix(f"{out}: ")) from error
        except (ValueError, IndexError, OverflowError, MemoryError) as error:
            raise UserError(
                f"expected a readable OBJ file; got a damaged one ({str(error)[:150]})."
            ) from error
        for material in material_files(data):
            found = self._write_referred(model.catalogue, material, path, folder, (".mtl",))
            if found is not None:
                for picture in picture_files(found[1]):
                    self._write_referred(model.catalogue, picture, found[0], folder, PICTURES)
        out.write_bytes(fitted)
        (folder / SETTINGS_FILE).write_text(_settings(model))

    def _write_referred(
        self, catalogue: Path, name: str, referrer: str, folder: Path, suffixes: tuple[str, ...]
    ) -> tuple[str, bytes] | None:
        """Write a file that another one of the zip refers to; return its path in the zip and its bytes.

        None for a file that is missing or outside the catalogue: the reader of the mesh names it.
        """
        plain = name.replace("\\", "/").lstrip("/")
        path = posixpath.normpath(posixpath.join(posixpath.dirname(referrer), plain))
        if not (_is_plain(path) and path.lower().endswith(suffixes) and self._entry(catalogue, path)):
            return None
        data = self._read(catalogue, path)
        target = folder / (posixpath.basename(plain) if ".." in plain.split("/") else plain)
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
        return path, data

    def _entry(self, catalogue: Path, path: str) -> str | None:
        """Return the name of an entry of a zip; where none is written alike, capitals do not matter."""
        return self.entries[catalogue].get(path) or self.entries[catalogue].get(path.lower())

    def _read(self, catalogue: Path, path: str) -> bytes:
        name = self._entry(catalogue, path)
        if name is None:
            raise UserError(f"expected its file {path[:100]} in the catalogue; it is missing.")
        try:
            data = read_entry(self.archives[catalogue], name, min(MAX_ENTRY, self.left))
        except ValueError as error:
            raise UserError(f"expected a model of ordinary size; {error}.") from error
        except Exception as error:  # damaged, encrypted, or packed in a way that is not known
            why = str(error) or type(error).__name__
            raise UserError(f"expected a readable {path[:100]}; got a damaged one ({why[:100]}).") from error
        self.left -= len(data)
        return data


def _settings(model: CatalogueModel) -> str:
    """Return the `vig.toml` of one model."""
    words = "_".join(_ascii(word) for word in head_words(model.name))
    thing = re.sub(r"[^a-z0-9_]", "", words).strip("_")[:_LONGEST_NAME] or "model"
    furniture = family_of_thing(thing)
    lines = ["[defaults]", f'family = "{furniture or thing}"']
    if furniture is None:  # on furniture, zones would be those of things upon it
        zones = ", ".join(f'"{zone}"' for zone in zones_of(model.name, model.tags, model.category))
        lines.append(f"zones = [{zones}]")
    if model.is_mounted:
        lines.append("skip = true  # it hangs on a wall or is a part of the house")
    return "\n".join(lines) + "\n"


def _inside(path: str) -> str:
    """Return a model's path in the zip, without its first slash. UserError when it leads elsewhere."""
    plain = path.removeprefix("/")
    if not _is_plain(plain):
        raise UserError(f"expected a path within the catalogue; got '{path[:100]}'.")
    return plain


def _is_plain(path: str) -> bool:
    """Return whether a path with `/` between leads nowhere but down, on any system."""
    # systems allow some 255 bytes
    climbs = any(part in ("", ".", "..") or len(part) > 200 for part in path.split("/"))
    return not climbs and not re.search(r"[:\\\0]", path)


def _unique_names(models: list[CatalogueModel]) -> list[str]:
    """Return a name for each model's folder: `cup`, or `cup-1`, `cup-2` where several are called so."""
    names = [_slug(model.name) for model in models]
    total, given, taken = Counter(names), Counter[str](), set(names)
    result = []
    for name in names:
        unique = name
        while total[name] > 1 and (unique == name or unique in taken):
            given[name] += 1
            unique = f"{name}-{given[name]}"
        taken.add(unique)
        result.append(unique)
    return result


def _describe(model: CatalogueModel, others: dict[str, str]) -> str:
    """Return a model's name for a message, unlike those of others."""
    name = f"{model.name} of {model.catalogue.name}"
    return name if name not in others else f"{name} ({model.path or len(others)})"


def _ascii(text: str) -> str:
    return unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()


def _slug(text: str, otherwise: str = "model") -> str:
    return re.sub(r"[^a-z0-9]+", "-", _ascii(text))[:_LONGEST_NAME].strip("-") or otherwise


def _sha256(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}). Check its permissions.") from error


def _cache() -> Path:
    try:
        return cache_folder() / "catalogues"
    except RuntimeError as error:
        raise UserError("expected a folder for unpacked models; got no home. Set XDG_CACHE_HOME.") from error


def _remove_abandoned(folder: Path) -> None:
    """Remove temporary folders of processes that were killed more than a day ago."""
    for path in folder.glob(".*"):
        try:
            if time.time() - path.stat().st_mtime > 24 * 3600:
                shutil.rmtree(path, ignore_errors=True)
        except OSError:  # another process has removed it
            continue
