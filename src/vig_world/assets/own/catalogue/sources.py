"""Origins of a folder's meshes, `sources.json`: names, authors and licences, to be passed on."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

from vig.io.checks import decode, read_json

SOURCES_FILE = "sources.json"
_FORMAT = 1


@dataclass(frozen=True)
class Source:
    """One mesh file's origin.

    Attributes:
        file: Name of the file, relative to the folder.
        name: The author's name for the model.
        creator: Its author; empty where the catalogue names none.
        licence: Licence that the catalogue states; empty where it states none.
        catalogue: Name of the catalogue's file.
    """

    file: str
    name: str
    creator: str
    licence: str
    catalogue: str


@dataclass(frozen=True)
class Sources:
    """The origins of a folder's meshes.

    Attributes:
        models: Source of each mesh file, in the order of names.
        left_out: Why other models of the catalogues were left out, by name, one sentence each.
        vig_sources: Version of the format.
    """

    models: tuple[Source, ...] = ()
    left_out: dict[str, str] = field(default_factory=dict)
    vig_sources: int = _FORMAT

    def of(self, files: set[str]) -> tuple[Source, ...]:
        """Return the origins of these files."""
        return tuple(source for source in self.models if source.file in files)

    def write(self, folder: Path) -> None:
        """Write `sources.json` into a folder."""
        text = json.dumps(asdict(self), indent=1, ensure_ascii=False)
        (folder / SOURCES_FILE).write_text(text + "\n", encoding="utf-8")


def read_sources(folder: str | Path) -> Sources:
    """Read a folder's `sources.json`; without one, or with one of another program, there are none."""
    try:
        value = read_json(Path(folder) / SOURCES_FILE)
        return Sources() if value["vig_sources"] != _FORMAT else decode(Sources, value)
    except (OSError, ValueError, KeyError, TypeError):
        return Sources()
