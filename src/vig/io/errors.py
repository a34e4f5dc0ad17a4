"""The one exception that the command line shows to its user."""

from vig_renderer.errors import UserError

__all__ = ["UserError"]
