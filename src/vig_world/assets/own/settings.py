"""Settings of mesh files: `vig.toml` in their folder or in a folder above, up to the root.

    [defaults]
    up = "z"
    [files."old/chair.obj"]
    scale = 0.001
    skip = false

`[defaults]` holds for all files below that folder, `[files.NAME]` for one, NAME being relative to it.
Settings of deeper folders override those above.
"""

import tomllib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal
from unicodedata import normalize

from msgspec import Meta

from vig.io.checks import decode, read_bytes, reading
from vig.io.files import compose_name
from vig_world.assets.things import ZONE_NAMES, Zone

FILE = "vig.toml"
MAX_BYTES, MAX_LINE = 1 << 18, 1 << 13
"""Largest file and longest line, in bytes: a parser's time grows with the square of a dotted name."""

REMEDY = (
    "Tables are [defaults] and [files.NAME]; in each up is one of x y z -x -y -z, scale above 0, turn in"
    f" degrees, zones a list of {' '.join(ZONE_NAMES)}, family a name, nodes a list of names, skip a boolean."
)


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

    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    scale: Annotated[float, Meta(gt=0, lt=1e9)] | None = None
    turn: Annotated[float, Meta(gt=-1e9, lt=1e9)] = 0.0
    zones: tuple[Zone, ...] = ()
    family: Annotated[str, Meta(min_length=1)] | None = None
    nodes: Annotated[tuple[str, ...], Meta(min_length=1)] = ()
    skip: bool = False


def settings_of(root: Path, path: Path, cache: dict[Path, dict[str, Any]]) -> FileSettings:
    """Merge a file's settings in the `vig.toml` files from root to its folder. UserError for a wrong one."""
    merged: dict[str, Any] = {}
    for folder in [root, *(root / part for part in reversed(path.relative_to(root).parents) if part.parts)]:
        if folder not in cache:
            cache[folder] = _read(folder / FILE)
        name = compose_name(path.relative_to(folder).as_posix())
        merged |= cache[folder]["defaults"] | cache[folder]["files"].get(name, {})
    return decode(FileSettings, merged)


def _read(path: Path) -> dict[str, Any]:
    """Return the tables of a checked `vig.toml`; empty ones when there is none."""
    table: dict[str, Any] = {}
    with reading(path, "settings of mesh files", REMEDY):
        with suppress(FileNotFoundError):
            text = read_bytes(path, MAX_BYTES).decode()
            if max(map(len, text.splitlines()), default=0) > MAX_LINE:
                raise ValueError(f"a line of more than {MAX_LINE} characters")
            table = tomllib.loads(text)
        decode(dict[Literal["defaults", "files"], dict[str, Any]], table)
        files = table.get("files", {})
        for where, settings in (("[defaults]", table.get("defaults", {})), *files.items()):
            try:
                decode(FileSettings, settings)
            except ValueError as error:
                raise ValueError(f"{error}, in {where}") from error
        for name in files:
            forms = name, *(normalize(form, name) for form in ("NFC", "NFD"))
            if not any((path.parent / form).is_file() for form in forms):
                raise ValueError(f"[files.{name!r}], but there is no such file beside it")
    named = {compose_name(name): settings for name, settings in files.items()}
    return {"defaults": table.get("defaults", {}), "files": named}
