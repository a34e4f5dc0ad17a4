"""A class pack's card.md, whose sections come from the verbs that measure a class."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from vig.io.files import atomic_write
from vig.scene import ObjectClass


def replace_section(pack: Path, object_class: ObjectClass, section: str) -> None:
    """Put a section onto a pack's card, in place of the earlier one of its heading.

    Args:
        pack: Folder of the pack.
        object_class: Class of the pack, whose name heads a new card.
        section: In Markdown, its first line the heading.
    """
    head, sections = read_sections(pack / "card.md")
    sections[section.partition("\n")[0]] = section
    write_card(pack, [head or f"# Class {object_class.name}", *sections.values()])


def write_card(pack: Path, parts: Iterable[str]) -> None:
    """Write a pack's card of parts in Markdown."""
    text = "\n\n".join(part.strip() for part in parts)
    with atomic_write(pack / "card.md") as temporary:
        temporary.write_text(text + "\n", "utf-8", "backslashreplace")


def table_lines(header: Sequence[str], rows: Iterable[Sequence[str]], right: bool = False) -> list[str]:
    """Return the lines of a table in Markdown; right: whether all columns but the first are right-aligned."""
    rule = ["---", *["---:" if right else "---"] * (len(header) - 1)]
    return [f"| {' | '.join(row)} |" for row in (header, rule, *rows)]


def read_sections(card: Path) -> tuple[str, dict[str, str]]:
    """Return a card's head, and its sections by their headings, which they include."""
    text = card.read_text(encoding="utf-8") if card.exists() else ""
    head, *rest = re.split(r"^(?=## )", text, flags=re.MULTILINE)
    return head, {section.partition("\n")[0]: section for section in rest}
