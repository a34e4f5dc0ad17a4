"""A hook of mkdocs: the gallery of the packaged photos, beside the page that leads to it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vig_app.cli.gallery import demo_gallery
from vig_app.report.html import write_page


def on_post_build(config: Any) -> None:
    """Explain the photos and write the page, some 1.2 MB, into the built site."""
    write_page(Path(config["site_dir"]) / "gallery" / "photos.html", demo_gallery()[0])
