"""Procedural furniture, each piece a pure function of a random generator."""

from vig_world.assets.discovery import import_modules, sort_by_name
from vig_world.assets.furniture.furniture import FAMILIES, Furniture, Support

import_modules(__name__)
sort_by_name(FAMILIES)

__all__ = ["FAMILIES", "Furniture", "Support"]
