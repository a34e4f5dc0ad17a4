"""Named designs, in `designs.json` beside a package's code."""

import json
from collections.abc import Callable
from importlib import resources
from typing import TypeVar

Design = TypeVar("Design")


def load_catalogue(make: Callable[..., Design], package: str) -> dict[str, tuple[Design, ...]]:
    """Return the named designs of a package by split, in the order of its `designs.json`.

    make: called with a design's name and the parameters that the file gives; it knows defaults of the others.
    """
    catalogue = json.loads(resources.files(package).joinpath("designs.json").read_text("utf-8"))
    return {
        split: tuple(make(name, **parameters) for name, parameters in designs.items())
        for split, designs in catalogue.items()
    }
