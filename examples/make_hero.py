"""Makes docs/hero.jpg: a photo of the demo, what hides its object, the object turned, and in another colour.

python examples/make_hero.py --out docs/hero.jpg
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter

import vig
from vig.io.files import atomic_write
from vig.scene import srgb8_from_linear, srgb_from_linear
from vig_app.demo import demo_photos

PHOTO = "04_milk"
PANEL, GAP, CAPTION, QUALITY = 396, 5, 30, 90
"""Pixels of a panel's side, between panels, of the captions' height; of the JPEG, of 100."""
COLOUR = (0.35, 0.04, 0.03)
"""Linear RGB that the object is given."""
TURN, ELEVATION = 100.0, 25.0
"""Degrees by which it is turned, and from which height it is then seen."""
SOFT, MARGIN = 1.5, 1.3
"""Pixels of the photo over which the colour fades out; side of the turned object's picture, in its sizes."""
GROUND = 0.8
"""Linear grey behind the turned object."""
CAPTIONS = (
    "a photo",
    "what vig finds; hidden: pink",
    "the object, seen from elsewhere",
    "in another colour, in its place",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("hero.jpg"))
    arguments = parser.parse_args()
    photo = next(photo for photo in demo_photos() if photo.name == PHOTO)
    found = vig.Explainer(photo.class_name).explain(photo.photo)
    panels = found.picture, found.overlay(), turned(found), repainted(found)
    sheet = Image.new("RGB", (len(panels) * (PANEL + GAP) - GAP, PANEL + CAPTION), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(18)
    for number, (panel, caption) in enumerate(zip(panels, CAPTIONS, strict=True)):
        left = number * (PANEL + GAP)
        sheet.paste(Image.fromarray(panel).resize((PANEL, PANEL), Image.Resampling.LANCZOS), (left, 0))
        draw.text((left + 2, PANEL + 4), caption, "black", font)
    with atomic_write(arguments.out) as temporary:
        sheet.save(temporary, "JPEG", quality=QUALITY)
    print(arguments.out)


def turned(found: vig.Explanation) -> np.ndarray:
    """The object as seen from elsewhere, before a plain ground: (H, W, 3) uint8."""
    drawn = found.render(azimuth_deg=found.azimuth_deg + TURN, elevation_deg=ELEVATION)
    shown = srgb8_from_linear(drawn[..., :3] + (1 - drawn[..., 3:]) * GROUND)
    rows, columns = (np.nonzero(drawn[..., 3].any(axis))[0] for axis in (1, 0))
    side = int(MARGIN * max(np.ptp(rows), np.ptp(columns)))
    left, top = int(columns.mean() - side / 2), int(rows.mean() - side / 2)
    around = int(255 * srgb_from_linear(np.float32(GROUND)))
    canvas = Image.new("RGB", (side, side), (around, around, around))
    canvas.paste(Image.fromarray(shown), (-left, -top))
    return np.asarray(canvas)


def repainted(found: vig.Explanation) -> np.ndarray:
    """The photo with the object's colour changed where it is seen, shading and gloss as they are."""
    old = found.latents.albedo[0]
    seen = np.clip(2 * gaussian_filter(found.mask.astype(np.float32), SOFT), 0, 1)[..., None]
    painted = found.photo * (np.array(COLOUR, np.float32) / old)
    return srgb8_from_linear((1 - seen) * found.photo + seen * painted)


if __name__ == "__main__":
    main()
