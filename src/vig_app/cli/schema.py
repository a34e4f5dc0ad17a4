"""`vig schema`: JSON schemas of the files that vig writes."""

from __future__ import annotations

import json

from vig_app.cli.common import SchemaCommand
from vig_app.schema import schema_of


def print_schema(settings: SchemaCommand) -> int:
    """Print a schema; returns the exit code."""
    print(json.dumps(schema_of(settings.file), indent=2))
    return 0
