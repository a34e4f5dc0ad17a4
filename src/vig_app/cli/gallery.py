"""`vig gallery`: photos and what vig explains in them, as one page."""

from __future__ import annotations

import json
import webbrowser

from vig.io.printing import end
from vig_app.cli.common import Gallery
from vig_app.cli.demo import has_screen
from vig_app.report.gallery import cards_of, gallery_html
from vig_app.report.html import write_page


def gallery(settings: Gallery) -> int:
    """Write the page and name it; returns the exit code."""
    cards, found = cards_of(settings.results, settings.out)
    photos, page = len(cards), settings.out / "index.html"
    title = f"{photos} photos explained" if photos == found else f"{photos} of {found} photos explained"
    write_page(page, gallery_html(cards, title))
    if settings.json:
        result = {"page": str(page), "photos": photos, "folder": str(settings.out)}
        print(json.dumps(result, indent=2))
    else:
        end(settings.out, f"made a page: open {page}")
    if not settings.no_open and not settings.json and has_screen():
        webbrowser.open(page.resolve().as_uri())
    return 0
