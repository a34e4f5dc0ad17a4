"""Settings of mesh files: `vig.toml` in their folder or in a folder above, up to the root.

    [defaults]
    up = "z"
    [files."old/chair.obj"]
    scale = 0.001
    skip = false

`[defaults]` holds for all files below that folder, `[files.NAME]` for one, NAME being relative to it.
Settings of deeper folders override those above.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NoReturn
from unicodedata import normalize

from vig.io.checks import read_bytes
from vig.io.errors import UserError
from vig.io.files import compose_name
from vig_world.assets.things import ZONE_NAMES

FILE = "vig.toml"
MOST_BYTES, MOST_LINE = 1 << 18, 1 << 13
"""Largest file and longest line, in bytes: a parser's time grows with the square of a dotted name."""
AXES = ("x", "y", "z", "-x", "-y", "-z")


@dataclass(frozen=True)
class FileSettings:
    """Settings of one file; None or empty where not given.

    Attributes:
        up: Which of the file's axes points up.
        scale: Metres per unit of the file.
        turn: Degrees, counter-clockwise about the upward axis, after the file's axes were put upright
            (furniture's front is to face -Y).
        zones: Zones to which it belongs.
        family: Its kind, such as `table`.
        nodes: The only nodes of a scene to read; empty: all.
        skip: Whether to leave the file out.
    """

    up: str | None = None
    scale: float | None = None
    turn: float = 0.0
    zones: tuple[str, ...] = ()
    family: str | None = None
    nodes: tuple[str, ...] = ()
    skip: bool = False


def settings_of(root: Path, path: Path, cache: dict[Path, dict[str, Any]]) -> FileSettings:
    """Merge a file's settings in the `vig.toml` files from root to its folder. UserError for a wrong one."""
    result = FileSettings()
    folders = [root, *(root / part for part in reversed(path.relative_to(root).parents) if part.parts)]
    for folder in folders:
        if folder not in cache:
            cache[folder] = _read(folder / FILE)
        table = cache[folder]
        name = compose_name(path.relative_to(folder).as_posix())
        for settings in (table.get("defaults", {}), table.get("files", {}).get(name, {})):
            result = replace(result, **settings)
    return result


def _read(path: Path) -> dict[str, Any]:
    """Return a checked `vig.toml`, its lists made tuples; empty when there is none."""
    try:
        text = read_bytes(path, MOST_BYTES).decode()
        if max(map(len, text.splitlines()), default=0) > MOST_LINE:
            raise ValueError(f"a line of more than {MOST_LINE} characters")
        table = tomllib.loads(text)
    except FileNotFoundError:
        return {}
    except (ValueError, RecursionError) as error:
        came = "tables nested too deeply" if isinstance(error, RecursionError) else error
        raise UserError(f"{path}: expected TOML; got {came}. Correct that line.") from error
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}). Check its permissions.") from error
    for key in table:
        if key not in ("defaults", "files"):
            _refuse(path, "[defaults] and [files.NAME]", repr(key), "Move it into one of them")
    tables: dict[str, Any] = {"defaults": table.get("defaults", {})}
    files = table.get("files", {})
    if not isinstance(files, dict):
        _refuse(path, "tables [files.NAME]", f"files = {files!r:.100}", "Write a table for each file")
    for name, settings in [("[defaults]", tables["defaults"]), *files.items()]:
        if not isinstance(settings, dict):
            _refuse(path, f"a table {name}", repr(settings)[:100], "Write it in brackets")
    tables["defaults"] = _checked(path, "[defaults]", tables["defaults"])
    tables["files"] = {
        compose_name(name): _checked(path, f"[files.{name!r}]", settings) for name, settings in files.items()
    }
    for name in files:
        forms = name, *(normalize(form, name) for form in ("NFC", "NFD"))
        if not any((path.parent / form).is_file() for form in forms):
            _refuse(path, f"a file {name} beside it", "none of that name", "Correct the name")
    return tables


def _checked(path: Path, where: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Return settings of one table with the right types, or UserError."""
    names = [field.name for field in fields(FileSettings)]
    result: dict[str, Any] = {}
    for key, value in settings.items():
        number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9
        strings = isinstance(value, list) and all(isinstance(item, str) for item in value)
        expected = {
            "up": (value in AXES, "one of " + " ".join(AXES)),
            "scale": (number and value > 0, "a positive number of metres per unit"),
            "turn": (number, "a number of degrees"),
            "zones": (strings and set(value) <= set(ZONE_NAMES), "a list of some of " + " ".join(ZONE_NAMES)),
            "family": (isinstance(value, str) and value != "", "a name"),
            "nodes": (strings and value != [], "a list of the scene's node names"),
            "skip": (isinstance(value, bool), "true or false"),
        }.get(key)  # fmt: skip
        if expected is None:
            _refuse(path, f"in {where} keys {' '.join(names)}", repr(key)[:100], "Correct or remove it")
        if not expected[0]:
            _refuse(path, f"in {where} {key} = {expected[1]}", repr(value)[:100], "Correct it")
        result[key] = tuple(value) if isinstance(value, list) else float(value) if number else value
    return result


def _refuse(path: Path, expected: str, came: str, remedy: str) -> NoReturn:
    raise UserError(f"{path}: expected {expected}; got {came}. {remedy}.")
