"""Results in the formats of other tools: an explanation, or a run as one file."""

from vig_app.exports.export import FORMATS as FORMATS
from vig_app.exports.export import export_explanation as export_explanation
from vig_app.exports.export import export_run as export_run
from vig_app.exports.export import formats_in as formats_in
from vig_app.exports.export import remove_exports as remove_exports
from vig_app.exports.export import run_formats as run_formats
