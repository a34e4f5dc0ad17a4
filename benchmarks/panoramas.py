"""Light statistics of our panoramas beside those of real rooms.

`python -m benchmarks.panoramas [--envmaps DIR] [--bpy-python PYTHON] [--json FILE] [--sheet FILE]` prints,
for each set, least, 5 %, median, 95 % and most of six numbers of its panoramas (see `numbers`), and how many
of the real ones lie within the range of ours.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial import Delaunay

from benchmarks.report import report, write
from vig.dataset.spec import SPLITS
from vig.errors import UserError
from vig.photo.images import write_png
from vig.scene import grey, project_panorama, srgb8_from_linear
from vig_world.assets.own import read_envmaps
from vig_world.assets.panoramas import panorama
from vig_world.library import PANORAMAS
from vig_world.streams import asset_rng

NAMES = ("|L1| / L0", "|L2| / L0", "up / L0", "level share", "log2 red / blue", "brightest / mean")
QUANTILES = (0.0, 0.05, 0.5, 0.95, 1.0)
PUBLISHED = {"|L1| / L0": (0.24, 0.82, 1.46), "|L2| / L0": (0.18, 0.62, 1.78), "up / L0": (-0.11, 0.44, 1.16)}
"""Least, median and most of 26 real indoor panoramas (DESIGN section 4)."""


def numbers(image: np.ndarray) -> np.ndarray:
    """The six numbers of NAMES of a panorama (H, 2 H, 3).

    level share: of |L1|, that along the ground, 0 when all light comes from straight above or below.
    log2 red / blue: of the mean radiance. brightest / mean: of the pixels, as base-10 logarithm.
    """
    light = project_panorama(image)
    ratio = grey(light) / grey(light)[0]
    first = np.linalg.norm(ratio[1:4])
    luminance = grey(image)
    return np.array(
        [
            first,
            np.linalg.norm(ratio[4:]),
            ratio[2],
            np.hypot(ratio[1], ratio[3]) / first,
            np.log2(light[0, 0] / light[0, 2]),
            np.log10(luminance.max() / luminance.mean()),
        ]
    )


def inside(points: np.ndarray, hull: np.ndarray) -> float:
    """Share of points (N, D) within the convex hull of others (M, D)."""
    return float((Delaunay(hull).find_simplex(points) >= 0).mean())


def table(name: str, values: np.ndarray) -> list[str]:
    """Lines of the table for a set's numbers (N, 6)."""
    lines = [f"\n{name} ({len(values)})".ljust(26) + "  min     5 %  median   95 %     max"]
    for column, quantity in enumerate(NAMES):
        row = np.quantile(values[:, column], QUANTILES)
        lines.append(f"  {quantity:20s}" + "".join(f"{number:8.2f}" for number in row))
    return lines


def tone_mapped(image: np.ndarray) -> np.ndarray:
    """A panorama as 8-bit sRGB, its median at a dark mid-grey, its lights compressed."""
    exposed = image * (0.22 / max(float(np.median(image.mean(-1))), 1e-6))
    return srgb8_from_linear(np.clip(exposed / (1 + 0.25 * exposed), 0, 1))


def sheet(images: list[np.ndarray], columns: int = 4, width: int = 256) -> np.ndarray:
    """Pictures (h, w, 3) in rows, each `width` pixels wide, a white line between."""
    tiles = []
    for image in images:
        small = Image.fromarray(tone_mapped(image)).resize((width, width // 2), Image.Resampling.BOX)
        tiles.append(np.pad(np.asarray(small), ((1, 1), (1, 1), (0, 0)), constant_values=255))
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
    rows = [np.concatenate(tiles[start : start + columns], 1) for start in range(0, len(tiles), columns)]
    return np.concatenate(rows)


def main() -> None:
    """Measure, print, and write what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--envmaps", type=Path, help="a folder of real panoramas, .hdr or .exr")
    parser.add_argument("--bpy-python", type=Path, help="a Python interpreter that has bpy; else this one's")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--sheet", type=Path, help="a PNG of our first 24 panoramas and the real ones")
    arguments = parser.parse_args()
    started = time.process_time()
    ours = {
        split: [panorama(asset_rng(split, "panorama", i)) for i in range(PANORAMAS[split])]
        for split in SPLITS
    }
    milliseconds = 1000 * (time.process_time() - started) / sum(len(images) for images in ours.values())
    print(f"one panorama at 64 x 128: {milliseconds:.0f} ms")
    sets = {f"ours, {split}": images for split, images in ours.items()}
    real: list[np.ndarray] = []
    for name, folder in (("real, --envmaps", arguments.envmaps), ("real, bpy", "bpy")):
        try:
            found, problems = read_envmaps(folder, arguments.bpy_python) if folder else ([], [])
        except UserError as error:
            found, problems = [], [str(error)]
        print("".join(f"{problem}\n" for problem in problems), end="")
        if found:
            sets[name] = [own.radiance for own in found]
            real += sets[name]
    measured = {name: np.array([numbers(image) for image in images]) for name, images in sets.items()}
    metrics = [{**_metric("panorama_ms", milliseconds, "ms"), "better": "lower"}]
    print("published, of 26 real ones:    min          median             max")
    for quantity, row in PUBLISHED.items():
        print(f"  {quantity:20s}{row[0]:8.2f}        {row[1]:8.2f}        {row[2]:8.2f}")
    for name, values in measured.items():
        print("\n".join(table(name, values)))
        for column, quantity in enumerate(NAMES):
            for share, number in zip(QUANTILES, np.quantile(values[:, column], QUANTILES), strict=True):
                metrics.append(_metric(f"{name}: {quantity} at {share:g}", float(number), "1"))
    if real:
        theirs = np.concatenate([values for name, values in measured.items() if name.startswith("real")])
        for name in (f"ours, {split}" for split in SPLITS):
            share = inside(theirs[:, :3], measured[name][:, :3])
            print(f"\nreal panoramas within the convex hull of {name}, first three numbers: {share:.0%}")
            metrics.append(_metric(f"{name}: share of real ones in its hull", share, "1"))
    if arguments.sheet:
        write_png(arguments.sheet, sheet(ours["train"][:24] + real))
    if arguments.json:
        write(report(metrics, 1), arguments.json)


def _metric(name: str, value: float, unit: str) -> dict:
    return {"name": name, "value": round(value, 4), "unit": unit, "better": "higher", "iqr": 0.0}


if __name__ == "__main__":
    main()
