"""Labels of annotation tools as hints: COCO, labelme's JSON and CVAT's XML 1.1 for images.

A mask or polygon is what is seen of an object, a box is round the whole of it. A label that cannot be used
holds why, so that its photo alone has an error.
"""

import base64
import io
import math
import os
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from PIL import Image

from vig.hints import Hints
from vig.io.checks import MAX_TABLE, parse_json, read_bytes, reading
from vig.io.errors import UserError
from vig.photo.masks import box_of, run_lengths

REMEDY = "Export COCO's, labelme's or CVAT's (for images 1.1) anew."
Box = tuple[float, float, float, float]
Polygon = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Runs:
    """Run lengths, zeros first, of the pixels of a box x, y, width, height, by columns or by rows.

    `around` is the box that the file states for these pixels, where it does.
    """

    counts: tuple[int, ...]
    box: tuple[int, int, int, int]
    by_columns: bool = True
    around: Box | None = None

    def check(self) -> None:
        """Raise ValueError where they are not those of as many pixels as the box has."""
        if min(self.counts, default=0) < 0 or sum(self.counts) != self.box[2] * self.box[3]:
            raise ValueError(f"run lengths of {sum(self.counts)} pixels for {self.box[2]} x {self.box[3]}")

    def mask(self, width: int, height: int) -> np.ndarray:
        """Return the mask (H, W) bool of a photo; ValueError where they do not suit it."""
        self.check()
        left, top, columns, rows = self.box
        if min(left, top) < 0 or left + columns > width or top + rows > height:
            raise ValueError("a mask that reaches beyond the photo")
        pixels = np.repeat(np.arange(len(self.counts)) % 2 == 1, self.counts)
        part = pixels.reshape(columns, rows).T if self.by_columns else pixels.reshape(rows, columns)
        found = box_of(part)
        if (
            self.around is not None
            and found is not None
            and np.abs(np.subtract(found, self.around)).max() > 2
        ):
            raise ValueError("run lengths beyond the stated box; are they by rows? COCO's go by columns")
        mask = np.zeros((height, width), bool)
        mask[top : top + rows, left : left + columns] = part
        return mask


@dataclass(frozen=True)
class Label:
    """The label of one object.

    Attributes:
        name: Its class; None where points alone are named.
        size: Width and height of the labelled picture; None where the file does not state them.
        polygons: Round what is seen of it.
        runs: The pixels in which it is seen.
        box: Box round the whole object.
        points: Named points, x, y in pixels.
        problem: Why it cannot be used; "" where it can.
    """

    name: str | None
    size: tuple[int, int] | None = None
    polygons: tuple[Polygon, ...] = ()
    runs: Runs | None = None
    box: Box | None = None
    points: dict[str, tuple[float, float]] = field(default_factory=dict)
    problem: str = ""

    def hints(self, width: int, height: int) -> Hints:
        """Return mask and points for a photo; UserError where they do not suit it."""
        try:
            if self.problem:
                raise ValueError(self.problem)
            if self.size is not None and self.size != (width, height):
                raise ValueError("those of a picture of {} x {}".format(*self.size))
            masks = [fill_polygon(polygon, width, height) for polygon in self.polygons]
            masks += [] if self.runs is None else [self.runs.mask(width, height)]
        except ValueError as error:
            raise UserError(f"expected labels for {width} x {height} pixels; got {error}. {REMEDY}") from None
        return Hints(mask=np.any(masks, axis=0) if masks else None, points=self.points)


def fill_polygon(polygon: Polygon, width: int, height: int) -> np.ndarray:
    """Return the pixels (H, W) bool whose centres are in a polygon; ValueError where it crosses itself."""
    turns = np.zeros((height, width + 1), np.int64)
    for (x, y), (next_x, next_y) in zip(polygon, (*polygon[1:], polygon[0]), strict=True):
        first, last = (min(max(math.ceil(at - 0.5), 0), height) for at in sorted((y, next_y)))
        rows = np.arange(first, last)
        if len(rows):
            crossings = x + (rows + 0.5 - y) * (next_x - x) / (next_y - y)
            columns = np.ceil(crossings - 0.5).clip(0, width).astype(int)
            turns[rows, columns] += 1 if next_y > y else -1
    winding = turns.cumsum(1)[:, :width]
    inside = winding != 0
    usual = 1 if (winding > 0).sum() >= (winding < 0).sum() else -1
    # slips of the hand go round a few pixels twice or the other way
    if (inside & (winding != usual)).sum() > 0.02 * inside.sum():
        raise ValueError("a polygon that crosses itself")
    return np.asarray(inside)


def read_labels(path: Path, say: Callable[[str], None]) -> dict[str, list[Label]]:
    """Return the labels of each photo, by its name or path, of a file or the files of a folder.

    `say` is called with a line on each file of a folder that cannot be read, and on what is left out. Raises
    UserError where a file cannot be read, or there are no labels.
    """
    files = [path]
    if path.is_dir():
        files = sorted(each for each in path.iterdir() if each.suffix.lower() in (".json", ".xml"))
    labels: dict[str, list[Label]] = defaultdict(list)
    for file in files:
        try:
            if file.stem.endswith("_amodal"):  # as vig itself writes them
                raise UserError(
                    f"expected masks of what is seen; got '{file.name}', whole ones. Give the others."
                )
            with reading(file, "labels of COCO, labelme or CVAT", REMEDY):
                for name, label in _labels_in(file, read_bytes(file, MAX_TABLE), say):
                    labels[name] += [] if label is None else [label]
        except UserError as error:
            if not path.is_dir():
                raise
            say(str(error))
    if not labels:
        raise UserError(f"expected labels in '{path}'; got none. {REMEDY}")
    return dict(labels)


def _labels_in(file: Path, data: bytes, say: Callable[[str], None]) -> Iterator[tuple[str, Label | None]]:
    """Yield photos' names with their labels, with None where a photo has none; `say` as of `read_labels`."""
    if data.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"<"):
        root = ElementTree.fromstring(data)
        if root.tag != "annotations":
            raise ValueError(f"XML of '{root.tag}'")
        for image in root.iter("image"):
            size = int(image.attrib["width"]), int(image.attrib["height"])
            yield from _join_shapes(image.attrib["name"], size, list(_cvat_shapes(image)))
        return
    content = parse_json(data)
    if isinstance(content, dict) and "shapes" in content:
        name = str(content["imagePath"]).replace("\\", "/")
        beside = file.parent / name
        name = os.path.realpath(beside) if beside.exists() else name.rpartition("/")[2]
        sides = content.get("imageWidth"), content.get("imageHeight")
        shapes = [shape for shape in map(_labelme_shape, content["shapes"]) if shape]
        yield from _join_shapes(name, None if None in sides else sides, shapes)  # type: ignore[arg-type]
    elif isinstance(content, dict) and "images" in content and "annotations" in content:
        known = {image["id"] for image in content["images"]}
        if lost := sum(row["image_id"] not in known for row in content["annotations"]):
            say(f"{file}: {lost} of {len(content['annotations'])} annotations are of images not listed")
        yield from _coco_labels(content)
    else:
        raise ValueError("JSON of another kind")


def _attempt(make: Callable[[], Label], name: str | None) -> Label:
    """Return a label, or one with the reason why it cannot be used."""
    try:
        return make()
    except (ArithmeticError, LookupError, OSError, TypeError, ValueError) as error:
        return Label(name, problem=f"a damaged one of '{name}' ({error})"[:200])


def _polygon(numbers: Iterable[Any]) -> Polygon:
    """Return x, y, x, y ... as a polygon; ValueError for others."""
    places = np.array([*numbers], float).reshape(-1, 2)
    if len(places) < 3 or not np.isfinite(places).all():
        raise ValueError(f"a polygon of {len(places)} points")
    return tuple(map(tuple, places.tolist()))


# COCO


def _coco_labels(content: dict[str, Any]) -> Iterator[tuple[str, Label | None]]:
    images = {image["id"]: image for image in content["images"]}
    categories = {each["id"]: each for each in content.get("categories", ())}
    for image in images.values():
        yield image["file_name"], None
    for row in content["annotations"]:
        if row["image_id"] in images and not row.get("iscrowd"):
            number, image = row["category_id"], images[row["image_id"]]
            category = categories.get(number, {"name": f"category {number}"})
            make = partial(_coco_label, row, image, category)
            yield image["file_name"], _attempt(make, str(category["name"]))


def _coco_label(row: dict[str, Any], image: dict[str, Any], category: dict[str, Any]) -> Label:
    size = (int(image["width"]), int(image["height"])) if image.get("width") else None
    box: Any = row.get("bbox") and tuple(map(float, row["bbox"]))
    places = np.reshape(row.get("keypoints") or [], (-1, 3)).tolist()
    names = category.get("keypoints") or []
    points = {name: (x, y) for name, (x, y, flag) in zip(names, places, strict=False) if flag}
    label = Label(str(category["name"]), size, box=box, points=points)
    mask = row.get("visible_segmentation") or row.get("segmentation")
    if not mask:
        return label
    # COCO's box is that of the segmentation, which is no more than what is seen.
    whole = box if "visible_segmentation" in row else None
    if isinstance(mask, list):
        return replace(label, box=whole, polygons=tuple(map(_polygon, mask)))
    runs = coco_runs(mask, None if whole else box)
    if size is not None and size != runs.box[2:]:
        raise ValueError(f"run lengths of size {mask['size']} where height, width is {[*size[::-1]]}")
    return replace(label, box=whole, runs=runs)


def coco_runs(mask: dict[str, Any], around: Box | None = None) -> Runs:
    """Return COCO's run lengths of a mask of a whole photo, compressed or not."""
    (height, width), counts = map(int, mask["size"]), mask["counts"]
    counts = _decode_runs(counts) if isinstance(counts, str) else map(int, counts)
    return Runs(tuple(counts), (0, 0, width, height), around=around)


def _decode_runs(text: str) -> list[int]:
    """Return the run lengths of COCO's compressed form: differences in groups of five bits."""
    counts: list[int] = []
    value = shift = 0
    for byte in text.encode():
        value |= (byte - 48 & 31) << shift
        shift += 5
        if not byte - 48 & 32:
            value -= 1 << shift if byte - 48 & 16 else 0
            counts.append(value + (counts[-2] if len(counts) > 2 else 0))
            value = shift = 0
    return counts


# labelme and CVAT: shapes, which a group joins to an object

Shape = tuple[bool, Any, Label]  # whether a shape is a point; its group or None; what it states


def _join_shapes(
    name: str, size: tuple[int, int] | None, shapes: list[Shape]
) -> Iterator[tuple[str, Label | None]]:
    """Yield a photo's name with a label for each group and each shape without one.

    Points without a group are those of its only object.
    """
    objects: dict[Any, Label] = {}
    for number, (is_point, group, label) in enumerate(sorted(shapes, key=lambda shape: shape[0])):
        key: Any = ("group", group) if group else number
        if is_point and not group and len(objects) <= 1:
            key = next(iter(objects), number)
        old = objects.get(key, Label(None, size))
        objects[key] = replace(
            old,
            name=label.name or old.name,
            polygons=old.polygons + label.polygons,
            runs=label.runs or old.runs,
            box=label.box or old.box,
            points=old.points | label.points,
            problem=old.problem or label.problem,
        )
    yield name, None
    yield from ((name, label) for label in objects.values())


def _label_of_shape(kind: str, name: str, places: np.ndarray, runs: Runs | None = None) -> Label:
    """Return the label of a shape of a kind: point, polygon, mask, or another with corners (N, 2)."""
    if kind == "point":
        return Label(None, points={name: tuple(places[0].tolist())})
    if kind == "polygon":
        return Label(name, polygons=(_polygon(places.ravel()),))
    x, y = places.min(0).tolist()
    return Label(name, runs=runs) if runs else Label(name, box=(x, y, *np.ptp(places, axis=0).tolist()))


def _labelme_shape(shape: dict[str, Any]) -> Shape | None:
    kind = shape.get("shape_type", "polygon")
    if kind not in ("point", "rectangle", "polygon", "mask"):
        return None
    name = None if kind == "point" else str(shape["label"])
    return kind == "point", shape.get("group_id"), _attempt(partial(_labelme_label, kind, shape), name)


def _labelme_label(kind: str, shape: dict[str, Any]) -> Label:
    places, runs = np.array(shape["points"], float).reshape(-1, 2), None
    if kind == "mask":
        with Image.open(io.BytesIO(base64.b64decode(shape["mask"]))) as picture:
            mask = np.asarray(picture) > 0
        left, top = places.min(0).round().astype(int).tolist()
        runs = Runs(tuple(run_lengths(mask)["counts"]), (left, top, *mask.shape[::-1]))
    return _label_of_shape(kind, str(shape["label"]), places, runs)


def _cvat_shapes(image: ElementTree.Element) -> Iterator[Shape]:
    for shape in image.iter():
        kind, at = shape.tag.replace("points", "point"), shape.attrib
        if kind in ("mask", "polygon", "box", "cuboid", "point"):
            name = None if kind == "point" else at.get("label")
            yield kind == "point", at.get("group_id"), _attempt(partial(_cvat_label, kind, at), name)


def _cvat_label(kind: str, at: dict[str, str]) -> Label:
    name, runs, places = at.get("label", ""), None, np.zeros((1, 2))
    if kind == "mask":
        left, top, width, height = (int(at[side]) for side in ("left", "top", "width", "height"))
        counts = tuple(map(int, at["rle"].split(",")))
        runs = Runs(counts, (left, top, width, height), by_columns=False)
    elif kind in ("polygon", "point"):
        places = np.array(at["points"].replace(";", ",").split(","), float).reshape(-1, 2)
    else:
        places = np.array([[v for k, v in at.items() if k[0] == axis] for axis in "xy"], float).T
    return _label_of_shape(kind, name, places, runs)
