"""Pictures, pages and files of explanations: made by the application, which this core does not import."""

from collections.abc import Callable
from functools import cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from typing import Any

from vig.io.errors import UserError

GROUP = "vig.outputs"
"""Entry points of functions whose first argument is an explanation, by the names of its methods."""


@cache
def output(name: str) -> Callable[..., Any]:
    """Return the function that makes an output; UserError where no package that is installed brings it."""
    for point in entry_points(group=GROUP, name=name):
        if find_spec(point.module.partition(".")[0]) is not None:
            function: Callable[..., Any] = point.load()
            return function
    raise UserError(
        f"expected the package vig_app, which makes '{name}'; it is not installed. Install vig anew."
    )
