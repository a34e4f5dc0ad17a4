"""Procedural furnished rooms, each a pure function of a random generator."""

from vig.synthesis.layouts.layout import Layout

__all__ = ["Layout"]
