"""Contact sheets of datasets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from vig.dataset.read import Dataset
from vig.errors import UserError
from vig.files import atomic_write

COLUMNS = 8
CAPTION = 14
TINT = np.array([255, 40, 160])


def contact_sheet(dataset: Dataset, path: str | Path, count: int = 32) -> Path:
    """Write the first `count` samples as one picture: hidden parts of the object tinted, occlusion below.

    Raises UserError when count is below 1 or the file cannot be written.
    """
    if count < 1:
        raise UserError(f"count must be at least 1; got {count}")
    chosen = range(min(count, len(dataset)))
    images = dataset.read("rgb", chosen)
    hidden = dataset.read("mask", chosen) & ~dataset.read("mask_visib", chosen)
    tinted = np.where(hidden[..., None], 0.65 * images + 0.35 * TINT, images).astype(np.uint8)
    height, width = images.shape[1:3]
    columns = min(COLUMNS, len(chosen))
    rows = -(-len(chosen) // columns)
    sheet = Image.new("RGB", (columns * (width + 2), rows * (height + CAPTION)), "white")
    draw = ImageDraw.Draw(sheet)
    for number in chosen:
        x, y = number % columns * (width + 2), number // columns * (height + CAPTION)
        sheet.paste(Image.fromarray(tinted[number]), (x, y))
        draw.text((x + 3, y + height), f"{number}: {dataset.occlusion[number]:.0%} hidden", fill="black")
    with atomic_write(path) as temporary:
        sheet.save(temporary)
    return Path(path)
