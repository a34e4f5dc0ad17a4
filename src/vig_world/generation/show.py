"""Pictures of a dataset: a contact sheet, and histograms of its requested and actual distributions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHEET, TILE = 1770, (210, 300)
"""Width of a sheet, about; least and most pixels of the shorter side of a photo on it, else as it is."""
MARGIN, CAPTION = 10, 22
TINT, OUTLINE, DARK = np.array([255, 40, 160]), (40, 230, 255), (20, 20, 20)
INK, FAINT, BLUE, ORANGE = "#22262e", "#d9dde3", "#3b6fb6", "#e08a2e"


def chosen(occlusion: np.ndarray, count: int) -> np.ndarray:
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
    indices = chosen(dataset.occlusion, count)
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
            tile = _labelled(tile, alone, seen)
        if points is not None and object_class is not None:
            _draw_keypoints(ImageDraw.Draw(tile), next(points), len(object_class.points), scale)
        sheet.paste(tile, (x, y))
        draw.text((x, y + height + 2), f"{index}", fill="#8a93a0", font=font)
        caption = f"{dataset.occlusion[index]:.0%} hidden"
        draw.text((x + width, y + height + 2), caption, fill=INK, font=font, anchor="ra")
    with atomic_write(path) as temporary:
        sheet.save(temporary)
    return Path(path)


def _labelled(tile: Image.Image, alone: np.ndarray, seen: np.ndarray) -> Image.Image:
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
        from matplotlib.layout_engine import ConstrainedLayoutEngine

    light = tuple(f"light_1_{order}" for order in (-1, 0, 1))
    shown = ("occlusion", "target_occlusion", "azimuth", "elevation", "size", "light_0_0", *light, "cause")
    table = read_table(Path(root), split, texts=False)
    columns = {name: np.array(table[name].to_pylist()) for name in shown}
    for name in shown[:-1]:
        if not np.isfinite(columns[name]).all():
            raise UserError(f"expected finite numbers in '{name}' of '{root}'; got others. {REMEDY}")
    settings = read_info(Path(root))["splits"][split]
    spacing = ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.12, hspace=0.06, wspace=0.04)
    figure = Figure(figsize=(12, 6.6), facecolor="white", layout=spacing)
    figure.suptitle(
        f"{Path(root).resolve().name}: {len(table):,} samples, {split} split, {settings['tier']},"
        f" seed {settings['seed']}",
        x=0.012,
        ha="left",
        color=INK,
        fontsize=13,
    )
    axes = figure.subplots(2, 3)
    _occlusion(axes[0, 0], columns)
    _bars(axes[0, 1], np.degrees(columns["azimuth"]), np.linspace(0, 360, 19), "azimuth, degrees", 360)
    axes[0, 1].set_xticks(range(0, 361, 90))
    _bars(axes[0, 2], np.degrees(columns["elevation"]), np.linspace(0, 90, 19), "elevation, degrees", 90)
    axes[0, 2].set_xticks(range(0, 91, 30))
    size = 100 * columns["size"]
    edges = np.linspace(0, max(10.0, np.ceil(size.max() / 10) * 10), 21)
    _bars(axes[1, 0], size, edges, "size: silhouette, % of the frame")
    ratio = np.linalg.norm([columns[name] for name in light], axis=0) / columns["light_0_0"]
    edges = np.linspace(0, max(1.5, np.ceil(ratio.max() * 4) / 4), 21)
    _bars(axes[1, 1], ratio, edges, "light: |L1| / L0, 0 from all sides, 1.7 from one")
    _causes(axes[1, 2], columns)
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=110)
    return Path(path)


def _bare(axes: Axes, label: str) -> None:
    axes.set_title(label, loc="left", fontsize=10, color=INK)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color(FAINT)
    axes.tick_params(colors="#6b7480", labelsize=8.5, length=0)
    axes.set_axisbelow(True)


def _bars(axes: Axes, values: np.ndarray, edges: np.ndarray, label: str, limit: float | None = None) -> None:
    axes.hist(values, edges.tolist(), color=BLUE, rwidth=0.92)
    _bare(axes, label)
    axes.grid(axis="y", color=FAINT, linewidth=0.7)
    axes.set_xlim(0, limit or edges[-1])


def _occlusion(axes: Axes, columns: dict[str, np.ndarray]) -> None:
    edges = np.linspace(0, 100, 11)
    asked, _ = np.histogram(100 * columns["target_occlusion"], edges)
    got, _ = np.histogram(100 * columns["occlusion"], edges)
    axes.bar(edges[:-1] + 2.9, asked, 4.0, color=FAINT, label="asked for")
    axes.bar(edges[:-1] + 7.1, got, 4.0, color=ORANGE, label="reached")
    _bare(axes, "occlusion, %")
    axes.grid(axis="y", color=FAINT, linewidth=0.7)
    axes.set_xlim(0, 100)
    axes.set_xticks(range(0, 101, 20))
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.02, 0.98),
        borderaxespad=0.0,
        ncols=2,
        frameon=False,
        fontsize=8.5,
        labelcolor=INK,
    )


def _causes(axes: Axes, columns: dict[str, np.ndarray]) -> None:
    names = ("none", "truncation", "support", "occluder")
    counts = [int((columns["cause"] == name).sum()) for name in names]
    axes.barh(names, counts, color=BLUE, height=0.62)
    _bare(axes, "what hides most of the object")
    for place, count in enumerate(counts):
        axes.text(count, place, f" {count:,}", va="center", fontsize=8.5, color=INK)
    axes.set_xticks([])
    axes.set_xlim(0, 1.18 * max(counts))
    axes.spines["bottom"].set_visible(False)
    axes.tick_params(axis="y", labelcolor=INK)
