"""Objects that threads share, made at their first use by one thread at a time."""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Callable, Hashable
from typing import TypeVar

Result = TypeVar("Result")

MAKING = threading.RLock()
"""Held where msgspec learns types, as it does not expect two threads there. Whoever holds it waits for no
other thread."""


def make_once(function: Callable[..., Result]) -> Callable[..., Result]:
    """Cache results of positional arguments as `functools.cache`, each made once, under `MAKING`."""
    results: dict[tuple[Hashable, ...], Result] = {}

    @functools.wraps(function)
    def once(*arguments: Hashable) -> Result:
        if arguments not in results:
            with MAKING:
                if arguments not in results:
                    results[arguments] = function(*arguments)
        return results[arguments]

    return once


if hasattr(os, "register_at_fork"):  # a child has no thread that could release it
    os.register_at_fork(before=MAKING.acquire, after_in_parent=MAKING.release, after_in_child=MAKING.release)
