"""A hook of mkdocs: the gallery of the packaged photos, beside the page that leads to it."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from vig_app.cli.demo import DEMO_NOTE, explain_demo
from vig_app.report.gallery import gallery_html
from vig_app.report.html import write_page


def on_post_build(config: Any) -> None:
    """Explain the photos and write the page, some 1.2 MB, into the built site."""
    with TemporaryDirectory() as folder:
        cards = [replace(card, link="") for card in explain_demo(Path(folder))[1]]
    page = gallery_html(cards, "What vig explains", DEMO_NOTE)
    write_page(Path(config["site_dir"]) / "gallery" / "photos.html", page)
