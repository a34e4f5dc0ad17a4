"""What the user is shown: pictures of an explanation, its numbers as JSON, its object as GLB."""

from vig.report.files import describe, overlay, write_explanation

__all__ = ["describe", "overlay", "write_explanation"]
