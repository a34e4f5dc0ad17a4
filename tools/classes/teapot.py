"""The packaged teapot class: shape model from the training designs, light prior from the training panoramas.

`python -m tools.classes.teapot [FOLDER]` builds it into a folder, by default `vig/classes/teapot`, and
prints the variance that it holds.
"""

import functools
from typing import Any

import numpy as np

from tools.classes.drawn_teapots import drawn_designs
from tools.classes.shapes import CodedClass, main
from vig.scene import Family, ShapeModel
from vig_world.assets.designs.design import HANDLES, TEAPOTS
from vig_world.assets.designs.teapot import PART_NAMES, TEAPOT_FACES, TEAPOT_PARTS, teapot_vertices
from vig_world.assets.target import nearest_coefficients

MODES = 16
"""With the other latents a point then has 32 numbers, two vector registers."""
DRAWN_DESIGNS = 150
"""Random designs from which the shape model is learned, beside the named ones."""
TRAINING_SCENE_DESIGNS = 60
"""The first so many of these are also objects of training scenes."""
HELD_OUT_ABOVE = 2
"""Designs with the handle above among those of test scenes, and of validation scenes."""
TARGET_HEIGHT = 0.08
"""Metres at which the camera looks: about half a pot's height, and that of photos made with earlier packs."""


@functools.cache
def teapot() -> CodedClass:
    """Return the class as data."""
    return CodedClass(
        "teapot",
        teapot_vertices,
        TEAPOT_FACES,
        TEAPOT_PARTS,
        PART_NAMES,
        TEAPOTS["train"] + drawn_designs(DRAWN_DESIGNS),
        MODES,
        {
            "test": TEAPOTS["test"] + drawn_designs(HELD_OUT_ABOVE, ("above",), seed=2),
            "validation": TEAPOTS["validation"] + drawn_designs(HELD_OUT_ABOVE, ("above",), seed=1),
            "train": TEAPOTS["train"] + drawn_designs(TRAINING_SCENE_DESIGNS),
        },
        lambda model: teapot_fields(model) | {"families": teapot_families(model)},
    )


def teapot_fields(model: ShapeModel) -> dict[str, Any]:
    """Return fields of a class of teapots; points are the farthest of the spout, the handle and the knob."""

    def farthest(part: str, direction: np.ndarray) -> int:
        of_part = np.flatnonzero(TEAPOT_PARTS == PART_NAMES.index(part))
        return int(of_part[(model.mean[of_part] @ direction).argmax()])

    x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    points = {"spout": farthest("spout", x), "handle": farthest("handle", -x), "knob": farthest("knob", z)}
    return {"target_height": TARGET_HEIGHT, "front": "the spout", "points": points}


def teapot_families(model: ShapeModel) -> tuple[Family, ...]:
    """Return families by the place of a teapot's handle; none lies between two of these."""
    designs = TEAPOTS["train"] + drawn_designs(DRAWN_DESIGNS)
    coefficients = nearest_coefficients(model, teapot().vertices_of(designs))
    families = []
    for handle in HANDLES:
        chosen = np.array([design.handle == handle for design in designs])
        mean, deviation = coefficients[chosen].mean(0), coefficients[chosen].std(0).clip(0.1)
        middle, spread = (tuple(np.round(values, 4).tolist()) for values in (mean, deviation))
        families.append(Family(f"handle {handle}", middle, spread, round(float(chosen.mean()), 4)))
    return tuple(families)


if __name__ == "__main__":
    main(teapot())
