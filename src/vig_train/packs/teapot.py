"""The packaged teapot class: shape model from the training designs, light prior from the training panoramas.

`python -m vig_train.packs.teapot [FOLDER]` builds it into a folder, by default `vig/classes/teapot`, and
prints the variance that it holds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vig.scene import Family, ObjectClass, ShapeModel
from vig_train.packs.lights import light_prior
from vig_train.packs.shapes import describe_model, fit_shape_model, save_packaged
from vig_world.assets.designs import (
    HANDLES,
    HELD_OUT_DESIGNS,
    PART_NAMES,
    TEAPOT_FACES,
    TEAPOT_PARTS,
    TRAINING_DESIGNS,
    VALIDATION_DESIGNS,
    TeapotDesign,
    drawn_designs,
    teapot_vertices,
)
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


def build_teapot_class() -> ObjectClass:
    """Fit shape model and light prior; a pure function of the code."""
    designs = vertices_of(TRAINING_DESIGNS + drawn_designs(DRAWN_DESIGNS))
    model = fit_shape_model(designs, TEAPOT_FACES, TEAPOT_PARTS, PART_NAMES, MODES)
    families = teapot_families(model)
    return ObjectClass(
        "teapot",
        model,
        TARGET_HEIGHT,
        *light_prior(),
        families=families,
        front="the spout",
        points=teapot_points(model.mean),
    )


def teapot_points(mean: np.ndarray) -> dict[str, int]:
    """Return vertices that a user may click: the farthest of the spout, the handle and the knob."""

    def farthest(part: str, direction: np.ndarray) -> int:
        of_part = np.flatnonzero(TEAPOT_PARTS == PART_NAMES.index(part))
        return int(of_part[(mean[of_part] @ direction).argmax()])

    x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    return {"spout": farthest("spout", x), "handle": farthest("handle", -x), "knob": farthest("knob", z)}


def teapot_families(model: ShapeModel) -> tuple[Family, ...]:
    """Return families by the place of a teapot's handle; none lies between two of these."""
    designs = TRAINING_DESIGNS + drawn_designs(DRAWN_DESIGNS)
    coefficients = nearest_coefficients(model, vertices_of(designs))
    families = []
    for handle in HANDLES:
        chosen = np.array([design.handle == handle for design in designs])
        mean, deviation = coefficients[chosen].mean(0), coefficients[chosen].std(0).clip(0.1)
        middle, spread = (tuple(np.round(values, 4).tolist()) for values in (mean, deviation))
        families.append(Family(f"handle {handle}", middle, spread, round(float(chosen.mean()), 4)))
    return tuple(families)


def vertices_of(designs: Sequence[TeapotDesign]) -> np.ndarray:
    """Return the vertices of designs, (N, V, 3) float32."""
    return np.stack([teapot_vertices(design) for design in designs])


def designs_of_scenes() -> dict[str, tuple[TeapotDesign, ...]]:
    """Return the designs of scenes by split. Never reorder them: datasets hold their numbers."""
    return {
        "test": HELD_OUT_DESIGNS + drawn_designs(HELD_OUT_ABOVE, ("above",), seed=2),
        "validation": VALIDATION_DESIGNS + drawn_designs(HELD_OUT_ABOVE, ("above",), seed=1),
        "train": TRAINING_DESIGNS + drawn_designs(TRAINING_SCENE_DESIGNS),
    }


def main() -> None:
    """Build, save and describe the class."""
    kinds = {"training": TRAINING_DESIGNS, "test": HELD_OUT_DESIGNS, "validation": VALIDATION_DESIGNS}
    vertices = {kind: vertices_of(each) for kind, each in kinds.items()}
    built = build_teapot_class()
    folder = save_packaged(built, designs_of_scenes())
    print(*describe_model(built.shape_model, vertices), folder, sep="\n")


if __name__ == "__main__":
    main()
