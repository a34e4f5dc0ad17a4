"""Pages are one file, escaped, and say in words what they say in colour."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np

from vig.photo.images import write_png
from vig_paper.reproduction.html import HtmlCell, heading, listing, paragraph, picture, table, write_html

VOID = {"meta", "img", "br"}


class Balance(HTMLParser):
    """Fails when an element is closed that is not the last one opened; counts the elements."""

    def __init__(self) -> None:
        super().__init__()
        self.opened: list[str] = []
        self.counts: dict[str, int] = {}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.counts[tag] = self.counts.get(tag, 0) + 1
        if tag not in VOID:
            self.opened.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.opened.pop() == tag


def counted(html: str) -> dict[str, int]:
    """How often each element occurs in balanced HTML."""
    parser = Balance()
    parser.feed(html)
    parser.close()
    assert parser.opened == []
    return parser.counts


def test_text_is_escaped_everywhere() -> None:
    rude = "<b>&'\""
    for html in (
        HtmlCell(rude, rude, True).html,
        table(rude, ["", rude], [(rude, [rude])]),
        paragraph(rude),
        listing([rude]),
        heading(rude),
    ):
        assert "<b>&" not in html and "&lt;b&gt;&amp;" in html


def test_a_cell_tells_its_verdict_in_a_word_and_a_class() -> None:
    assert HtmlCell("1").html == "<td>1</td>"
    assert HtmlCell("1", "a\nb").html == "<td>1<small>a</small><small>b</small></td>"
    assert (
        HtmlCell("1", "paper 2", True).html == '<td class="pass">1<small>paper 2 · <b>pass</b></small></td>'
    )
    assert HtmlCell("3", "a\nb", False).html == (
        '<td class="fail">3<small>a</small><small>b · <b>fail</b></small></td>'
    )
    assert HtmlCell("3", "", False).html == '<td class="fail">3<small><b>fail</b></small></td>'


def test_a_table_has_its_cells_in_rows() -> None:
    html = table("t", ["", "a", "b"], [("x", ["1", HtmlCell("2")]), ("y", ["3", "4"])])
    counts = counted(html)
    assert (counts["tr"], counts["td"], counts["th"]) == (3, 4, 5)


def test_a_picture_is_part_of_the_page(tmp_path: Path) -> None:
    path = tmp_path / "p.png"
    write_png(path, np.zeros((4, 4, 3), np.uint8))
    html = picture(path, "black & small")
    found = re.search(r'src="data:image/png;base64,([^"]+)"', html)
    assert found and base64.b64decode(found[1]) == path.read_bytes()
    assert 'alt="black &amp; small"' in html
    assert picture(tmp_path / "none.png", "none") == ""


def test_a_page_is_one_balanced_file_without_empty_sections(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "index.html"
    write_html(path, "T", paragraph("lead"), [("one", "One", paragraph("x")), ("two", "Two", "")])
    text = path.read_text()
    counts = counted(text)
    assert counts["section"] == counts["a"] == 1 and counts["h1"] == 1
    assert '<a href="#one">' in text and 'id="one"' in text and "Two" not in text
    assert "script" not in counts and "link" not in counts and "http" not in text
    assert "prefers-color-scheme: dark" in text and "width=device-width" in text
