"""`vig export`: the results of many photos as one file of another tool."""

from __future__ import annotations

import json

from vig_app.cli.common import ExportCommand
from vig_app.exports import export_run


def export(settings: ExportCommand) -> int:
    """Write and name the files; returns the exit code."""
    written = [str(path) for path in export_run(settings.results, settings.to, settings.out)]
    folder = str(settings.out or settings.results)
    result = {"files": written, "folder": folder}
    print(json.dumps(result, indent=2) if settings.json else "\n".join([*written, folder]))
    return 0
