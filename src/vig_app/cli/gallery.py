"""`vig gallery`: photos and what vig explains in them, as one page."""

from __future__ import annotations

import json
import webbrowser
from pathlib import Path
from tempfile import TemporaryDirectory

from vig.io.printing import end
from vig_app.cli.common import Gallery
from vig_app.cli.demo import DEMO_NOTE, demo_card, explained_demo, has_screen
from vig_app.demo import demo_photos
from vig_app.report.gallery import cards_of, gallery_html
from vig_app.report.html import write_page


def gallery(settings: Gallery) -> int:
    """Write the page and name it; returns the exit code."""
    if settings.results is None:
        html, photos = demo_gallery()
    else:
        cards, found = cards_of(settings.results, settings.out)
        photos = len(cards)
        title = f"{photos} photos explained" if photos == found else f"{photos} of {found} photos explained"
        html = gallery_html(cards, title)
    page = settings.out / "index.html"
    write_page(page, html)
    result = {"page": str(page), "photos": photos, "folder": str(settings.out)}
    if settings.json:
        print(json.dumps(result, indent=2))
    else:
        yours = "" if settings.results else "; of photos of yours: vig gallery FOLDER_OF_VIG_FIT"
        end(settings.out, f"made a page: open {page}{yours}")
    if not settings.no_open and not settings.json and has_screen():
        webbrowser.open(page.resolve().as_uri())
    return 0


def demo_gallery() -> tuple[str, int]:
    """Return the page of the packaged photos, and how many they are."""
    with TemporaryDirectory() as folder:
        photos = demo_photos()
        cards = [
            demo_card(photo, Path(folder))
            for photo, _, _ in explained_demo(photos, Path(folder), ("report.html",))
        ]
    return gallery_html(cards, "What vig explains", DEMO_NOTE), len(cards)
