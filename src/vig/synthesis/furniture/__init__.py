"""Procedural furniture, each piece a pure function of a random generator."""

from vig.synthesis.furniture.furniture import Furniture, Support

__all__ = ["Furniture", "Support"]
