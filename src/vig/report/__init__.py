"""What the user is shown: pictures of an explanation, its numbers as JSON, its object as GLB."""

from vig.report.files import describe, write_explanation
from vig.report.overlay import overlay

__all__ = [
    "describe",
    "overlay",
    "write_explanation",
]
