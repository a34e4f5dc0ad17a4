"""`vig export`, `vig gallery` and `vig schema`: results in other forms, and the form of their files."""

import json
import os
import sys
import webbrowser
from typing import Any

import msgspec

from vig.io.printing import end
from vig.record import Explanation
from vig_app.cli.common import ExportCommand, Gallery, SchemaCommand
from vig_app.cli.naming import list_names
from vig_app.exports import export_run
from vig_app.report.gallery import cards_of, gallery_html
from vig_app.report.html import write_page


def export(settings: ExportCommand) -> int:
    """Write and name the files; returns the exit code."""
    written = export_run(settings.results, settings.to, settings.out)
    folder = settings.out or settings.results
    names = list_names(path.name for path in written)
    result = {"files": [*map(str, written)]} if settings.json else None
    end(folder, f"exported {names}: vig export --help says what reads it", result, written)
    return 0


def gallery(settings: Gallery) -> int:
    """Write the page and name it; returns the exit code."""
    cards, found = cards_of(settings.results, settings.out)
    shown, page = len(cards), settings.out / "index.html"
    title = f"{shown} objects explained" if shown == found else f"{shown} of {found} objects explained"
    write_page(page, gallery_html(cards, title))
    result = {"page": str(page), "photos": shown} if settings.json else None
    end(settings.out, f"made a page: open {page}", result)
    if not settings.no_open and not settings.json and has_screen():
        webbrowser.open(page.resolve().as_uri())
    return 0


def has_screen() -> bool:
    """Return whether the session is interactive: a terminal, and a display where the system has such."""
    displays = sys.platform in ("win32", "darwin") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    return sys.stdout.isatty() and displays


def print_schema(settings: SchemaCommand) -> int:
    """Print a schema; returns the exit code."""
    print(json.dumps(schema_of(settings.file), indent=2))
    return 0


def schema_of(name: str) -> dict[str, Any]:
    """Return the JSON schema of a file that vig writes."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"{name}.json of vig"}
    return head | msgspec.json.schema({"explanation": Explanation}[name])
