"""`vig export`: the results of many photos as one file of another tool."""

from __future__ import annotations

import json

from vig.io.printing import end
from vig_app.cli.common import ExportCommand
from vig_app.cli.naming import listed
from vig_app.exports import export_run


def export(settings: ExportCommand) -> int:
    """Write and name the files; returns the exit code."""
    written = export_run(settings.results, settings.to, settings.out)
    folder = settings.out or settings.results
    if settings.json:
        print(json.dumps({"files": [str(path) for path in written], "folder": str(folder)}, indent=2))
        return 0
    print(*written, sep="\n")
    names = listed(path.name for path in written)
    end(folder, f"exported {names}: vig export --help says what reads it")
    return 0
