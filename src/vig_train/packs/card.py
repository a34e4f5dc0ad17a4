"""A class pack's card.md, whose sections come from the verbs that measure a class."""

from __future__ import annotations

import re
from pathlib import Path

from vig.io.files import atomic_write
from vig.scene import ObjectClass


def replace_section(pack: Path, object_class: ObjectClass, section: str) -> None:
    """Put a section onto a pack's card, in place of the earlier one of its heading.

    Args:
        pack: Folder of the pack.
        object_class: Of the pack, whose name heads a card that is begun.
        section: In Markdown, its first line the heading.
    """
    card = pack / "card.md"
    head, sections = read_sections(card)
    sections[section.partition("\n")[0]] = section
    text = "\n\n".join(part.strip() for part in (head or f"# Class {object_class.name}", *sections.values()))
    with atomic_write(card) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def read_sections(card: Path) -> tuple[str, dict[str, str]]:
    """What a card begins with, and its sections in order, each by its heading, the heading included."""
    text = card.read_text(encoding="utf-8") if card.exists() else ""
    head, *rest = re.split(r"^(?=## )", text, flags=re.MULTILINE)
    return head, {section.partition("\n")[0]: section for section in rest}
