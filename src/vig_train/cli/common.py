"""What several verbs need."""

from __future__ import annotations

from pathlib import Path

from vig.io.errors import UserError
from vig.io.files import atomic_write


def check_writable(folder: Path) -> None:
    """Refuse now a folder that could not be written after an hour's work."""
    probe = folder / ".writable"
    with atomic_write(probe) as temporary:
        temporary.touch()
    probe.unlink()


def check_workers(workers: int | None) -> None:
    """Refuse a number of workers that can do nothing."""
    if workers is not None and workers < 1:
        raise UserError(f"expected --workers of at least 1; got {workers}.")
