"""Sections of a class's card come from several verbs; each replaces its own."""

from pathlib import Path

from vig.scene import ObjectClass
from vig_train.packs.card import read_sections, replace_section


def test_a_section_takes_the_place_of_its_own_alone(teapot: ObjectClass, tmp_path: Path) -> None:
    replace_section(tmp_path, teapot, "## Recognition\n\nquick\n")
    replace_section(tmp_path, teapot, "## On photographs\n\n| a | table |\n")
    replace_section(tmp_path, teapot, "## Recognition\n\ntrained\n\n### More\n\nof it\n")
    text = (tmp_path / "card.md").read_text()
    parts = (
        "# Class teapot",
        "## Recognition",
        "trained",
        "### More",
        "of it",
        "## On photographs",
        "| a | table |",
    )
    assert text == "\n\n".join(parts) + "\n"
    head, sections = read_sections(tmp_path / "card.md")
    assert head.strip() == "# Class teapot" and list(sections) == ["## Recognition", "## On photographs"]
    assert read_sections(tmp_path / "none.md") == ("", {})
