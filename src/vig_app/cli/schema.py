"""`vig schema`: JSON schemas of the files that vig writes."""

from __future__ import annotations

import json
from typing import Any

import msgspec

from vig.record import Explanation
from vig_app.cli.common import SchemaCommand


def print_schema(settings: SchemaCommand) -> int:
    """Print a schema; returns the exit code."""
    print(json.dumps(schema_of(settings.file), indent=2))
    return 0


def schema_of(name: str) -> dict[str, Any]:
    """Return the JSON schema of a file that vig writes."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"{name}.json of vig"}
    return head | msgspec.json.schema({"explanation": Explanation}[name])
