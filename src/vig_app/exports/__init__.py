"""Results in the formats of other tools: an explanation, or a run as one file."""

from vig_app.exports.export import (
    FORMATS,
    export_explanation,
    export_run,
    formats_in,
    remove_exports,
    run_formats,
)

__all__ = ["FORMATS", "export_explanation", "export_run", "formats_in", "remove_exports", "run_formats"]
