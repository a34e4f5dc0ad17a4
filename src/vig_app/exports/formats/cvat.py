"""CVAT's XML 1.1 for images: visible masks, whole masks and 3-D boxes as three files.

A cuboid's front is the upright side of the 3-D box that is nearest to the camera.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from vig.io.files import atomic_write
from vig.photo.masks import box_of, run_lengths
from vig_app.exports.annotations import SETS, AnnotatedPhoto, Annotation

FILES = (*(f"cvat_{name}.xml" for name in SETS), "cvat_cuboids.xml")
SIDES = ((0, 0), (0, 1), (1, 1), (1, 0), (0, 0))
"""Low or high x and y of the upright edges of a box, round it."""


def write_photos(folder: Path, photos: Sequence[AnnotatedPhoto], class_ids: Mapping[str, int]) -> None:
    """Write the files."""
    for file, kind in zip(FILES, (*SETS, "cuboid"), strict=True):
        root = ElementTree.Element("annotations")
        ElementTree.SubElement(root, "version").text = "1.1"
        labels = ElementTree.SubElement(ElementTree.SubElement(root, "meta"), "task")
        labels = ElementTree.SubElement(labels, "labels")
        for name in class_ids:
            label = ElementTree.SubElement(labels, "label")
            ElementTree.SubElement(label, "name").text = name
            ElementTree.SubElement(label, "type").text = "cuboid" if kind == "cuboid" else "mask"
        for number, photo in enumerate(photos):
            width, height = map(str, photo.size)
            described = {"id": str(number), "name": photo.name, "width": width, "height": height}
            image = ElementTree.SubElement(root, "image", described)
            for each in photo.read():
                hidden = {"occluded": str(int((each.amodal & ~each.visible).any())), "z_order": "0"}
                common = {"label": each.category, "source": "vig"} | hidden
                fields = dict(_cuboid(each)) if kind == "cuboid" else _mask(getattr(each, kind))
                if fields:
                    name = "cuboid" if kind == "cuboid" else "mask"
                    ElementTree.SubElement(image, name, common | fields)
        ElementTree.indent(root)
        with atomic_write(folder / file) as temporary:
            ElementTree.ElementTree(root).write(temporary, "utf-8", xml_declaration=True)


def _mask(mask: np.ndarray) -> dict[str, str]:
    """Return the run lengths of a mask (H, W) bool by rows within its box, zeros first; nothing if empty."""
    if (box := box_of(mask)) is None:
        return {}
    x, y, width, height = box
    counts = run_lengths(mask[y : y + height, x : x + width].T)["counts"]
    place = dict(zip(("left", "top", "width", "height"), map(str, box), strict=True))
    return {"rle": ", ".join(map(str, counts))} | place


def _cuboid(each: Annotation) -> Iterator[tuple[str, str]]:
    """Yield the corners: top and bottom, left and right, of the front (1) and the back (2)."""
    if each.corners is None:
        return
    sides = [each.corners[[a[0], b[0]], [a[1], b[1]]] for a, b in zip(SIDES, SIDES[1:], strict=False)]
    front = min(range(4), key=lambda number: sides[number][..., 2].mean())
    for number, side in enumerate((sides[front], sides[(front + 2) % 4][::-1]), 1):
        left_first = side if sides[front][0, 0, 0] <= sides[front][1, 0, 0] else side[::-1]
        for name, edge in zip("lr", left_first, strict=True):
            for end, (x, y, _) in zip("bt", edge, strict=True):
                yield f"x{end}{name}{number}", f"{x:.2f}"
                yield f"y{end}{name}{number}", f"{y:.2f}"
