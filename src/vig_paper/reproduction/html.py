"""Pieces of a self-contained HTML page: text that is escaped, tables, pictures that are part of the file."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from vig.io.files import atomic_write

TYPES = {".png": "image/png", ".webp": "image/webp"}


@dataclass(frozen=True)
class HtmlCell:
    """A cell of a table: text, smaller lines below it, whether it passes (None: undefined), and the word for
    that, by default pass or fail.
    """

    text: str
    below: str = ""
    passed: bool | None = None
    word: str = ""

    @property
    def html(self) -> str:
        """A `td` element; a colour and a label show whether it passes."""
        lines = [escape(line) for line in self.below.splitlines()]
        if self.passed is None:
            return f"<td>{escape(self.text)}{_small(lines)}</td>"
        label = "pass" if self.passed else "fail"
        last_line = " · ".join([*lines[-1:], f"<b>{escape(self.word or label)}</b>"])
        return f'<td class="{label}">{escape(self.text)}{_small([*lines[:-1], last_line])}</td>'


def _small(lines: list[str]) -> str:
    return "".join(f"<small>{line}</small>" for line in lines)


def table(caption: str, header: Sequence[str], rows: Iterable[tuple[str, Sequence[HtmlCell | str]]]) -> str:
    """A table whose rows have a name and cells; on a narrow screen it scrolls on its own."""
    columns = "".join(f'<th scope="col">{escape(name)}</th>' for name in header)
    body = "".join(
        f'<tr><th scope="row">{escape(name)}</th>'
        + "".join((cell if isinstance(cell, HtmlCell) else HtmlCell(cell)).html for cell in cells)
        + "</tr>\n"
        for name, cells in rows
    )
    return (
        f'<p class="caption">{escape(caption)}</p>\n<div class="wide"><table>'
        f"<thead><tr>{columns}</tr></thead>\n<tbody>\n{body}</tbody></table></div>\n"
    )


def picture(path: Path, caption: str) -> str:
    """A PNG or WebP picture embedded in the page, its caption below it; empty when there is no such file."""
    if not path.exists():
        return ""
    data = base64.b64encode(path.read_bytes()).decode()
    text = escape(caption, quote=True)
    return (
        f'<figure><img alt="{text}" src="data:{TYPES[path.suffix]};base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>\n"
    )


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph of plain text."""
    return f"<p{f' class={kind!r}' if kind else ''}>{escape(text)}</p>\n"


def heading(text: str) -> str:
    """A heading within a section."""
    return f"<h3>{escape(text)}</h3>\n"


def listing(lines: Iterable[str]) -> str:
    """Preformatted lines."""
    return f"<pre>{escape(chr(10).join(lines))}</pre>\n"


def write_html(path: Path, title: str, introduction: str, sections: Iterable[tuple[str, str, str]]) -> None:
    """Write a page. introduction: HTML; sections: (anchor, heading, HTML), empty ones are left out."""
    filled = [section for section in sections if section[2]]
    links = "".join(f'<a href="#{anchor}">{escape(heading)}</a>' for anchor, heading, _ in filled)
    body = "".join(
        f'<section id="{anchor}"><h2>{escape(heading)}</h2>\n{html}</section>\n'
        for anchor, heading, html in filled
    )
    page = (
        '<!doctype html>\n<html lang="en-GB">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<header><h1>{escape(title)}</h1>\n{introduction}<nav>{links}</nav></header>\n"
        f"<main>\n{body}</main>\n</body>\n</html>\n"
    )
    with atomic_write(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


STYLE = """
:root { --ink: #1d2330; --faint: #626b7a; --line: #d8dde5; --paper: #fff; --shade: #f4f6f9; --link: #1f5fae;
  --pass: #dff3e4; --pass-ink: #14602b; --fail: #fbe2df; --fail-ink: #97231a; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e8ee; --faint: #9aa4b3; --line: #343c49;
  --paper: #14181f; --shade: #1d232c; --link: #86b7f3; --pass: #173524; --pass-ink: #8fdca8; --fail: #40201e;
  --fail-ink: #f5a59c; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 72rem; padding: 1.5rem 1rem 4rem; background: var(--paper);
  color: var(--ink); font: 1rem/1.55 system-ui, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 .6rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .6rem; padding-top: .6rem; border-top: 1px solid var(--line); }
h3 { font-size: 1.02rem; margin: 1.8rem 0 .4rem; }
p { max-width: 46rem; margin: .5rem 0; }
nav { display: flex; flex-wrap: wrap; gap: .2rem 1.1rem; margin-top: .8rem; }
a { color: var(--link); }
small, figcaption, .caption { color: var(--faint); font-size: .84rem; }
.wide { overflow-x: auto; margin: .4rem 0 1rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
.caption { max-width: none; margin: 1.4rem 0 0; }
th, td { padding: .35rem .7rem; border-bottom: 1px solid var(--line); text-align: right; vertical-align: top;
  white-space: nowrap; }
th { font-weight: 600; white-space: normal; max-width: 13rem; }
th[scope=row] { text-align: left; font-weight: 500; position: sticky; left: 0; background: var(--paper); }
@media (max-width: 40rem) { th { max-width: 7.5rem; } th, td { padding: .3rem .45rem; } }
td small { display: block; }
td.pass { background: var(--pass); } td.pass b { color: var(--pass-ink); }
td.fail { background: var(--fail); } td.fail b { color: var(--fail-ink); }
figure { margin: 1.2rem 0; }
img { display: block; max-width: 100%; height: auto; border-radius: 4px; background: #fff; }
figcaption { margin-top: .4rem; max-width: 46rem; }
pre { white-space: pre-wrap; padding: .7rem .9rem; background: var(--shade); border-radius: 4px;
  font-size: .86rem; }
"""
