"""`vig export`: the results of many photos as one file of another tool."""

from __future__ import annotations

import json

from vig_app.cli.common import ExportCommand
from vig_app.runs.results import bop_csv, coco_json

WRITERS = {"bop": ("bop.csv", bop_csv), "coco": ("coco.json", coco_json)}


def export(settings: ExportCommand) -> int:
    """Write and name the files; returns the exit code."""
    out = settings.out or settings.results
    written = []
    for kind in settings.to:
        name, write = WRITERS[kind]
        written.append(str(write(settings.results, out / name)))
    print(json.dumps({"files": written}, indent=2) if settings.json else "\n".join(written))
    return 0
