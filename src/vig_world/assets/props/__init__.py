"""Procedural household props, each a pure function of a random generator."""

from vig_world.assets.discovery import import_modules, sort_by_name
from vig_world.assets.props.families import FAMILIES, ZONE_NAMES, ZONES, is_of_class
from vig_world.assets.props.material import Material, Prop

import_modules(__name__)
sort_by_name(FAMILIES)
sort_by_name(ZONES)  # random draws depend on this order

__all__ = ["FAMILIES", "ZONES", "ZONE_NAMES", "Material", "Prop", "is_of_class"]
