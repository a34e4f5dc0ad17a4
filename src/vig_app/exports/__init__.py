"""Results in the formats of other tools: an explanation (`formats`), or a run as one file (`run_formats`)."""

from vig_app.exports.export import (
    FORMATS,
    RUN_FORMATS,
    export_explanation,
    export_run,
    formats_in,
    remove_exports,
    run_files,
    run_formats_in,
)

__all__ = [
    "FORMATS",
    "RUN_FORMATS",
    "export_explanation",
    "export_run",
    "formats_in",
    "remove_exports",
    "run_files",
    "run_formats_in",
]
