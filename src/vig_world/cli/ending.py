"""How a verb ends."""

from __future__ import annotations

import sys
from pathlib import Path


def end(folder: Path, words: str) -> None:
    """Print a verb's output folder, then on stderr what was made and what to do next."""
    print(folder, flush=True)
    print(f"vig: {words}", file=sys.stderr, flush=True)
