"""Results in the formats of other tools: an explanation (`formats`), or a run as one file (`run_formats`)."""

from vig_app.exports.export import (
    FORMATS,
    RUN_FORMATS,
    export_explanation,
    export_run,
    remove_exports,
    run_files,
)

__all__ = ["FORMATS", "RUN_FORMATS", "export_explanation", "export_run", "remove_exports", "run_files"]
