"""A gallery: each photo with its explanation, to slide over it, and the object to turn; one page, offline."""

import json
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from vig.io.checks import reading
from vig.io.errors import UserError
from vig.record import read_explanation
from vig_app.report import words
from vig_app.report.html import fill_template

MAX_PHOTOS = 40  # photos of a gallery, each some 0.2 MB of the page
PICTURE = re.compile(r'<img id="(photo|outlines-of)" src="(data:image/[a-z]+;base64,[\w+/=]+)"')
DATA = re.compile(r'<script type="application/json" id="data">(.*?)</script>', re.DOTALL)


@dataclass(frozen=True)
class Card:
    """A photo of the gallery.

    Attributes:
        name: Name of the photo.
        described: Content of explanation.json.
        badge: Trusted parts, in words.
        probabilities: Names and values of its probabilities.
        pictures: `photo` and `outlines-of` of its report.html, as addresses of images.
        data: Drawing data of its object: `mesh`, `view`, `clip`, `outline`.
        note: One line under the result.
        link: Address of its report.html beside the page, or nothing.
    """

    name: str
    described: dict[str, Any]
    badge: str
    probabilities: list[tuple[str, float]]
    pictures: dict[str, str]
    data: dict[str, Any]
    note: str = ""
    link: str = ""


def card_of(folder: Path, name: str, note: str = "", link: str = "") -> Card:
    """Return the card of an explanation's folder, which holds explanation.json and report.html."""
    page = folder / "report.html"
    with reading(page, "the page of an explanation", "Explain the photo anew with `vig fit`."):
        described = read_explanation(folder)
        badge, probabilities = words.badge(described), words.probabilities(described)
        text = page.read_text(encoding="utf-8")
        pictures, found = dict(PICTURE.findall(text)), DATA.search(text)
        if len(pictures) != 2 or found is None:
            raise ValueError("it has no photo or no mesh")
        data = json.loads(found[1])
        shown = {"mesh": data["mesh"], "view": data["views"][0], "clip": data["clip"]}
        shown["outline"] = data["outline"]
        return Card(name, described, badge, probabilities, pictures, shown, note, link)


def cards_of(results: Path, out: Path) -> tuple[list[Card], int]:
    """Return the cards of a folder of results, by name, `MAX_PHOTOS` at most, and how many results it holds.

    They are for a page in `out`, from which they link to each one's own.

    Raises:
        UserError: No explanation with its page is in it.
    """
    pages = [
        path for depth in ("", "*/", "*/*/") for path in sorted(results.glob(f"{depth}explanation.json"))
    ]
    folders = [path.parent for path in pages if (path.parent / "report.html").is_file()]
    if not folders:
        raise UserError(
            f"expected a folder of results, with explanation.json and report.html; got {results}, without."
            " Explain photos first: vig fit PHOTOS --out RESULTS."
        )
    names = ["/".join(folder.relative_to(results).parts) or folder.resolve().name for folder in folders]
    shown = list(zip(folders, names, strict=True))[:MAX_PHOTOS]
    return [card_of(folder, name, link=_link(folder, out)) for folder, name in shown], len(folders)


def _link(folder: Path, out: Path) -> str:
    """Return the address of a result's report.html from a page in `out`."""
    page = folder.resolve() / "report.html"
    try:
        return quote(os.fsencode(Path(os.path.relpath(page, out.resolve())).as_posix()))
    except ValueError:  # on another drive
        return page.as_uri()


def gallery_html(cards: Sequence[Card], title: str, note: str = "") -> str:
    """Return the page; photos without the object are shown alone."""
    data = [card.data for card in cards if card.described["verdict"] != "absent"]
    return fill_template("gallery.html", title=title, note=note, cards=cards, data=data)
