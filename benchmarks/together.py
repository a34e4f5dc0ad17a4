"""Objects that hide one another, each alone and together: `python -m benchmarks.together [--json FILE]`.

Groups of two to four teapots and mugs of the generator are explained from boxes round the whole objects, each
object alone and all together. Printed: errors of azimuth and elevation in degrees, the IoU of visible masks,
the error of the hidden share, and how many pairs have the wrong order: what hides what by the masks where
both fits cover a pixel, or, together, as it is told; a pair without an answer counts as wrong. Of all but the
last the difference, together less alone, with its standard error over groups. `--sheet` draws groups.
`--found` seeks them instead, four at the most: how many are found, of which class, and what else is.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from benchmarks.groups import Group, make_group
from benchmarks.measuring import metric, report, write
from vig import Explainer, Explanation
from vig.io.errors import UserError
from vig.parallel import on_one_core
from vig.photo import Window
from vig.recognition.find import overlap
from vig.scene import ObjectClass
from vig.several import explain_found, fit_jointly
from vig_world.library import Library

CLASSES = "teapot", "mug"
COLOURS = (255, 220, 0), (0, 220, 255), (255, 90, 220), (120, 255, 90)
COLUMNS, SHOWN = 4, 24
MAX_OBJECTS = 4
RIGHT = 15.0, 30.0
"""Degrees within which an azimuth counts as right."""


def judged(group: Group, found: tuple[Explanation, ...], before: np.ndarray) -> tuple[np.ndarray, int, int]:
    """Rows (N, 4) of azimuth and elevation errors in degrees, IoU and error of the hidden share; how many
    pairs have the wrong order, and of how many.
    """
    rows = []
    for number, (each, truth) in enumerate(zip(found, group.truth(), strict=True)):
        off = (each.azimuth_deg - truth["azimuth_deg"] + 180) % 360 - 180
        seen, visible = each.mask, group.visible[number]
        hidden = 1.0 if each.hidden_fraction is None else each.hidden_fraction
        rows.append([
            abs(off), abs(each.elevation_deg - truth["elevation_deg"]),
            (seen & visible).sum() / max(1, (seen | visible).sum()), abs(hidden - truth["hidden_fraction"]),
        ])  # fmt: skip
    one_way = group.occludes & ~group.occludes.T
    return np.array(rows), int((one_way & ~(before & ~before.T)).sum()), int(one_way.sum())


def order_of_masks(found: tuple[Explanation, ...]) -> np.ndarray:
    """What hides what (N, N) bool where two fits cover the same pixels, by whose masks has more of them."""
    count = len(found)
    before = np.zeros((count, count), bool)
    for i in range(count):
        for j in range(count):
            both = found[i].amodal & found[j].amodal
            before[i, j] = (found[i].mask & both).sum() > (found[j].mask & both).sum()
    return before


def order_of_ends(found: tuple[Explanation, ...]) -> np.ndarray:
    """The same by which fit ends lower in the photo."""
    ends = np.array([0 if each.box is None else each.box[1] + each.box[3] for each in found])
    return ends[:, None] > ends


def drawn(group: Group, found: tuple[Explanation, ...]) -> Image.Image:
    """A photo with each object's whole outline, and its visible pixels tinted."""
    picture = group.photo.astype(np.float32)
    edges = np.zeros(picture.shape[:2], bool)
    for number, each in enumerate(found):
        colour = np.array(COLOURS[number], np.float32)
        picture[each.mask] = 0.65 * picture[each.mask] + 0.35 * colour
        whole = each.amodal
        inner = whole[1:-1, 1:-1] & whole[:-2, 1:-1] & whole[2:, 1:-1] & whole[1:-1, :-2] & whole[1:-1, 2:]
        edges = whole.copy()
        edges[1:-1, 1:-1] &= ~inner
        picture[edges] = colour
    image = Image.fromarray(picture.astype(np.uint8))
    for number, (each, truth) in enumerate(zip(found, group.truth(), strict=True)):
        words = f"{truth['class']} {each.azimuth_deg:.0f} ({truth['azimuth_deg']:.0f})"
        ImageDraw.Draw(image).text((4, 4 + 11 * number), words, fill=COLOURS[number])
    return image


def main() -> None:
    """Measure, print, and write JSON and a sheet where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--groups", type=int, default=200)
    parser.add_argument("--seed", type=int, default=31)
    parser.add_argument("--split", choices=("validation", "test"), default="test")
    parser.add_argument("--sheet", type=Path)
    parser.add_argument("--found", action="store_true")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    if arguments.groups < 1:
        parser.error("expected one group or more")
    classes = [ObjectClass.load(name) for name in CLASSES]
    explainers, library = {each.name: Explainer(each) for each in classes}, Library(arguments.split)
    if arguments.found:
        sought(arguments.groups, arguments.seed, library, list(explainers.values()))
        return
    rows: dict[str, list[np.ndarray]] = {"alone": [], "together": []}
    wrong, pairs, tiles = {"alone": 0, "together": 0, "what ends lower": 0}, 0, []
    for index in range(arguments.groups):
        group = make_group(library, classes, arguments.seed, index)
        chosen = [explainers[member.class_name] for member in group.spec.members]
        boxes = [(float(x), float(y), float(w), float(h)) for x, y, w, h in group.boxes]
        alone = tuple(one.explain(group.photo, box) for one, box in zip(chosen, boxes, strict=True))
        scene = on_one_core(partial(fit_jointly, alone, chosen))
        for name, found, before in (
            ("alone", alone, order_of_masks(alone)), ("together", scene.objects, scene.occludes)
        ):  # fmt: skip
            judgement, bad, of = judged(group, found, before)
            rows[name].append(judgement)
            wrong[name] += bad
        wrong["what ends lower"] += judged(group, alone, order_of_ends(alone))[1]
        pairs += of
        if len(tiles) < SHOWN:
            tiles.append(drawn(group, scene.objects))
        if index % 20 == 19:
            print(f"{index + 1} groups", flush=True)
    found = tabled(rows, wrong, pairs)
    if arguments.sheet:
        width, height = tiles[0].size
        sheet = Image.new("RGB", (COLUMNS * width, -(-len(tiles) // COLUMNS) * height))
        for place, tile in enumerate(tiles):
            sheet.paste(tile, (place % COLUMNS * width, place // COLUMNS * height))
        sheet.save(arguments.sheet)
    if arguments.json:
        write(report(found, 1), arguments.json)


def sought(groups: int, seed: int, library: Library, explainers: list[Explainer]) -> None:
    """Print how many objects are found: each once, by a window that overlaps its own by a half or more."""
    objects = found = right = false = 0
    for index in range(groups):
        group = make_group(library, [each.object_class for each in explainers], seed, index)
        own: list[Window | None] = [
            Window.round_box((float(x), float(y), float(w), float(h))) for x, y, w, h in group.boxes
        ]
        objects, seen = objects + len(own), tuple[Explanation, ...]()
        with suppress(UserError):  # which finds none
            seen = explain_found(group.photo, explainers, MAX_OBJECTS).objects
        for explained in seen:
            shares = [0.0 if each is None else overlap(each, explained.window) for each in own]
            best = int(np.argmax(shares))
            if shares[best] < 0.5:
                false += 1
                continue
            found += 1
            right += explained.object_class.name == group.spec.members[best].class_name
            own[best] = None
    print(
        f"{found} of {objects} objects found ({found / objects:.0%}), {right / found:.0%} of the right class;"
    )
    print(f"{false / groups:.2f} other places a photo, some of them objects once more")


def tabled(rows: dict[str, list[np.ndarray]], wrong: dict[str, int], pairs: int) -> list[dict[str, Any]]:
    """Print the table of rows by group; returns it as metrics."""
    parts: list[tuple[str, Callable[[np.ndarray], np.ndarray]]] = [
        ("azimuth error, mean", lambda row: row[:, 0]),
        *((f"azimuth within {most:.0f}", lambda row, most=most: row[:, 0] < most) for most in RIGHT),
        ("elevation error, mean", lambda row: row[:, 1]),
        ("IoU, mean", lambda row: row[:, 2]),
        ("hidden share error, mean", lambda row: row[:, 3]),
    ]
    objects = sum(map(len, rows["alone"]))
    print(f"{objects} objects, {pairs} pairs of which one hides some of the other")
    print(f"{'':26}{'alone':>9}{'together':>10}{'difference':>12}")
    medians = {way: float(np.median(np.concatenate(each)[:, 0])) for way, each in rows.items()}
    print(f"{'azimuth error, median':26}{medians['alone']:9.2f}{medians['together']:10.2f}")
    found = [metric(f"azimuth_median_{way}", [value], "degrees") for way, value in medians.items()]
    for name, part in parts:
        sums = {way: np.array([part(row).sum() for row in each]) for way, each in rows.items()}
        means = {way: float(each.sum() / objects) for way, each in sums.items()}
        change = sums["together"] - sums["alone"]  # of whole groups: their objects share a photo
        error = change.std() * math.sqrt(len(change)) / objects
        difference = means["together"] - means["alone"]
        print(f"{name:26}{means['alone']:9.3f}{means['together']:10.3f}{difference:+8.3f} ± {error:.3f}")
        plain = name.replace(", ", "_").replace(" ", "_")
        found += [metric(f"{plain}_{way}", [value], "") for way, value in means.items()]
    shares = {name: count / max(1, pairs) for name, count in wrong.items()}
    print(f"{'wrong order':26}{shares['alone']:9.3f}{shares['together']:10.3f}")
    print(f"by what ends lower alone: {shares['what ends lower']:.3f}")
    return found + [metric(f"wrong_order_{name}", [share], "") for name, share in shares.items()]


if __name__ == "__main__":
    main()
