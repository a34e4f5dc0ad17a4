"""Verbs of the command line."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

GROUP = "vig.verbs"
"""Entry points under which a package adds its verbs, a tuple of `Verb`, to the command line."""


@dataclass(frozen=True)
class Verb:
    """One verb. Its work is imported when it is chosen, so that help is quick.

    name: `fit`, or `dataset make` for a verb of a group. settings: a dataclass, from which the arguments are
    derived. work: `module:function`, which takes the settings and returns the exit code.
    """

    name: str
    settings: type
    work: str

    def run(self, settings: Any) -> int:
        """Do the work with these settings; returns the exit code."""
        module, _, function = self.work.partition(":")
        code: int = getattr(import_module(module), function)(settings)
        return code


def verbs_of_packages() -> tuple[Verb, ...]:
    """The verbs that installed packages bring, in the order of their entry points' names."""
    found = sorted(entry_points(group=GROUP), key=lambda point: point.name)
    return tuple(verb for point in found for verb in point.load())
