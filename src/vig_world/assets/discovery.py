"""Finds families of assets: each maker registers itself when its module is imported."""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any


def import_modules(package: str) -> None:
    """Import every module of a package, so that the makers in them are registered."""
    for module in pkgutil.iter_modules(importlib.import_module(package).__path__):
        importlib.import_module(f"{package}.{module.name}")


def sort_by_name(entries: dict[str, Any]) -> None:
    """Sort a dictionary in place: its order then depends neither on files nor on who imported them first."""
    for name in sorted(entries):
        entries[name] = entries.pop(name)
