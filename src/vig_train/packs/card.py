"""A class pack's card.md, whose sections come from the verbs that measure a class."""

from __future__ import annotations

from pathlib import Path

from vig.io.files import atomic_write
from vig.scene import ObjectClass


def replace_section(pack: Path, object_class: ObjectClass, section: str) -> None:
    """Put a section onto a pack's card, in place of all from the earlier one of its heading on.

    Args:
        pack: Folder of the pack.
        object_class: Of the pack, whose name heads a card that is begun.
        section: In Markdown, its first line the heading.
    """
    card, heading = pack / "card.md", section.partition("\n")[0]
    old = card.read_text(encoding="utf-8") if card.exists() else f"# Class {object_class.name}\n"
    with atomic_write(card) as temporary:
        temporary.write_text(old.split(heading)[0].rstrip() + "\n\n" + section, encoding="utf-8")
