"""Pictures of a dataset: a contact sheet, and histograms of its requested and actual distributions."""

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import binary_dilation

from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig.photo.masks import box_of
from vig.scene import ObjectClass
from vig_world.dataset.format import REMEDY, read_info
from vig_world.dataset.read import Dataset
from vig_world.dataset.table import read_table
from vig_world.extras import optional_import
from vig_world.generation.keypoints import EDGES, OUTSIDE, SEEN, Keypoints, keypoints

SHEET, TILE = 1770, (210, 300)
"""Width of a sheet, about; least and most pixels of the shorter side of a photo on it, else as it is."""
MARGIN, CAPTION = 10, 22
TINT, OUTLINE, DARK = np.array([255, 40, 160]), (40, 230, 255), (20, 20, 20)


def choose_samples(occlusion: np.ndarray, count: int) -> np.ndarray:
    """Return indices of `count` samples (all when there are fewer), evenly over the ranks of occlusion."""
    order = np.argsort(occlusion, kind="stable")
    return order[np.linspace(0, len(order) - 1, min(count, len(order))).round().astype(int)]


def contact_sheet(
    dataset: Dataset,
    path: str | Path,
    count: int = 48,
    labels: bool = True,
    object_class: ObjectClass | None = None,
) -> Path:
    """Write `count` samples, from unoccluded to hidden, as one picture, with their numbers and occlusions.

    Args:
        dataset: The samples; the choice among them is deterministic.
        path: The picture to write.
        count: Number of samples, at least 1.
        labels: Whether to draw the outline and box of the object's visible part, and to tint the hidden
            part.
        object_class: Class of the dataset, whose keypoints are drawn, too; None draws none.

    Raises:
        UserError: When count is below 1, a file is damaged, or the picture cannot be written.
    """
    if count < 1:
        raise UserError(f"count must be at least 1; got {count}")
    indices = choose_samples(dataset.occlusion, count)
    scale = max(TILE[0], min(TILE[1], min(dataset.size))) / min(dataset.size)
    width, height = (round(scale * side) for side in dataset.size)
    columns = min(max(1, round(SHEET / (width + MARGIN))), len(indices))
    rows = -(-len(indices) // columns)
    size = (MARGIN + columns * (width + MARGIN), MARGIN + rows * (height + CAPTION))
    sheet = Image.new("RGB", size, "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
    points = None if object_class is None else keypoints(dataset, object_class, indices)
    for place, index in enumerate(indices):
        x = MARGIN + place % columns * (width + MARGIN)
        y = MARGIN + place // columns * (height + CAPTION)
        photo = Image.fromarray(dataset.read("rgb", [index])[0])
        tile = photo.resize((width, height), Image.Resampling.LANCZOS)
        if labels:
            alone, seen = (dataset.read(kind, [index])[0] for kind in ("mask", "mask_visib"))
            tile = _label_tile(tile, alone, seen)
        if points is not None and object_class is not None:
            _draw_keypoints(ImageDraw.Draw(tile), next(points), len(object_class.points), scale)
        sheet.paste(tile, (x, y))
        draw.text((x, y + height + 2), f"{index}", fill="#8a93a0", font=font)
        caption = f"{dataset.occlusion[index]:.0%} hidden"
        draw.text((x + width, y + height + 2), caption, fill=DARK, font=font, anchor="ra")
    with atomic_write(path) as temporary:
        sheet.save(temporary)
    return Path(path)


def _label_tile(tile: Image.Image, alone: np.ndarray, seen: np.ndarray) -> Image.Image:
    """Return a photo with the object's hidden part tinted, and outline and box of the visible part."""
    alone, seen = (
        np.asarray(Image.fromarray(mask).convert("L").resize(tile.size, Image.Resampling.BILINEAR)) > 127
        for mask in (alone, seen)
    )
    pixels = np.array(tile)
    hidden = alone & ~seen
    pixels[hidden] = 0.65 * pixels[hidden] + 0.35 * TINT
    outline = binary_dilation(seen, iterations=2) & ~seen
    pixels[binary_dilation(outline)] = DARK
    pixels[outline] = OUTLINE
    tile = Image.fromarray(pixels)
    if (box := box_of(seen)) is not None:
        x, y, width, height = box
        ImageDraw.Draw(tile).rectangle((x, y, x + width - 1, y + height - 1), outline="white")
    return tile


def _draw_keypoints(draw: ImageDraw.ImageDraw, located: Keypoints, named: int, scale: float) -> None:
    """Draw dots, filled where a point is seen, larger for the class's `named` first; and edges of the box."""
    place = (scale * located.place).tolist()
    corners = place[named : named + 8]
    for i, j in EDGES:
        if np.isfinite([corners[i], corners[j]]).all():
            draw.line((*corners[i], *corners[j]), fill="#ffd24a")
    for number, ((x, y), seen) in enumerate(zip(place, located.seen.tolist(), strict=True)):
        if seen != OUTSIDE:
            radius = 4 if number < named else 2.5
            fill = "#ffd24a" if seen == SEEN else None
            draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=fill, outline="#1a1a1a")
            if seen != SEEN:
                draw.ellipse(
                    (x - radius + 1, y - radius + 1, x + radius - 1, y + radius - 1), outline="#ffd24a"
                )


def histograms(root: str | Path, split: str, path: str | Path) -> Path:
    """Write the distributions of a split as one picture: occlusion, pose, size, light, causes.

    Raises:
        UserError: When the split cannot be read or the file cannot be written.
    """
    with optional_import("world"):  # 0.2 s that worker processes need not spend
        from matplotlib.figure import Figure

    light = tuple(f"light_1_{order}" for order in (-1, 0, 1))
    shown = ("occlusion", "target_occlusion", "azimuth", "elevation", "size", "light_0_0", *light, "cause")
    table = read_table(Path(root), split, texts=False)
    columns = {name: np.array(table[name].to_pylist()) for name in shown}
    for name in shown[:-1]:
        if not np.isfinite(columns[name]).all():
            raise UserError(f"expected finite numbers in '{name}' of '{root}'; got others. {REMEDY}")
    settings = read_info(Path(root))["splits"][split]
    figure = Figure(figsize=(12, 6.6), layout="constrained")
    figure.suptitle(
        f"{Path(root).resolve().name}: {len(table):,} samples, {split} split, {settings['tier']},"
        f" seed {settings['seed']}"
    )
    axes = figure.subplots(2, 3)
    asked, got = (100 * columns[name] for name in ("target_occlusion", "occlusion"))
    axes[0, 0].hist([asked, got], np.linspace(0, 100, 11).tolist())
    axes[0, 0].set_title("occlusion, %: asked for, reached (orange)")
    size = 100 * columns["size"]
    ratio = np.linalg.norm([columns[name] for name in light], axis=0) / columns["light_0_0"]
    for panel, values, end, label in (
        (axes[0, 1], np.degrees(columns["azimuth"]), 360, "azimuth, degrees"),
        (axes[0, 2], np.degrees(columns["elevation"]), 90, "elevation, degrees"),
        (axes[1, 0], size, max(10.0, size.max()), "size: silhouette, % of the frame"),
        (axes[1, 1], ratio, max(1.5, ratio.max()), "light: |L1| / L0, 0 from all sides, 1.7 from one"),
    ):
        panel.hist(values, np.linspace(0, end, 20).tolist())
        panel.set_title(label)
    causes = ("none", "truncation", "support", "occluder")
    bars = axes[1, 2].barh(causes, [int((columns["cause"] == name).sum()) for name in causes])
    axes[1, 2].bar_label(bars, padding=2)
    axes[1, 2].margins(x=0.1)
    axes[1, 2].set_title("what hides most of the object")
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=110)
    return Path(path)
