"""vig's native library, for the widest instruction set that the processor has and the installation holds.

VIG_ISA=plain, avx2 or avx512 in the environment takes another one.
"""

from __future__ import annotations

import importlib
import os
from types import ModuleType

from vig_native.processor import instruction_sets


def _load() -> ModuleType:
    wanted = os.environ.get("VIG_ISA")
    for name in [wanted] if wanted else instruction_sets():
        try:
            return importlib.import_module(f"vig_native._{name}")
        except ModuleNotFoundError:
            continue
    raise ImportError(
        f"expected vig's native library for {wanted or ' or '.join(instruction_sets())}; this installation"
        " has none. Install vig again on this machine: pip install --force-reinstall --no-deps vig"
    )


engine = _load()
"""The module with geometry, photos, prior, evaluate, search, minimum_cut, colour_density; see bindings.cc."""
ISA = engine.__name__.removeprefix("vig_native._")  # the instruction set that it was compiled for
