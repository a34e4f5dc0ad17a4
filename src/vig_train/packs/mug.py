"""The packaged mug class: shape model from the training designs, light prior from the training panoramas.

`python -m vig_train.packs.mug [FOLDER]` builds it into a folder, by default `vig/classes/mug`, and prints how
far designs lie from it by the number of components.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vig.scene import ObjectClass
from vig_train.packs.lights import light_prior
from vig_train.packs.shapes import describe_model, fit_shape_model, save_packaged
from vig_world.assets.mugs import (
    HELD_OUT_MUGS,
    MUG_FACES,
    MUG_PARTS,
    PART_NAMES,
    TRAINING_MUGS,
    VALIDATION_MUGS,
    MugDesign,
    drawn_mugs,
    mug_vertices,
)
from vig_world.assets.mugs.mug import POINTS

MODES = 12
"""Enough for the held-out designs to be within 1 % of their size in the mean: `main` prints it."""
DRAWN_DESIGNS = 150
"""Random designs from which the shape model is learned, beside the named ones."""
TRAINING_SCENE_DESIGNS = 40
"""The first so many of these are also objects of training scenes."""
TARGET_HEIGHT = 0.048
"""Metres at which the camera looks: about half a mug's height."""
VIEWING_DISTANCE = 0.18
"""Metres: about 1.5 times the mean length from the back to the handle."""
PLACES = {
    "drinks": 3.0, "dining": 3.0, "desk": 2.5, "cooking": 2.0, "storage": 1.5, "reading": 1.5, "bedside": 1.2,
    "display": 1.0, "washing": 1.0, "floor": 0.2,
}  # fmt: skip


def build_mug_class() -> ObjectClass:
    """Fit shape model and light prior; a pure function of the code."""
    designs = vertices_of(TRAINING_MUGS + drawn_mugs(DRAWN_DESIGNS))
    return ObjectClass(
        "mug",
        fit_shape_model(designs, MUG_FACES, MUG_PARTS, PART_NAMES, MODES),
        TARGET_HEIGHT,
        *light_prior(),
        front="the handle",
        points=POINTS,
        viewing_distance=VIEWING_DISTANCE,
        places=PLACES,
    )


def vertices_of(designs: Sequence[MugDesign]) -> np.ndarray:
    """Return the vertices of designs, (N, V, 3) float32."""
    return np.stack([mug_vertices(design) for design in designs])


def designs_of_scenes() -> dict[str, tuple[MugDesign, ...]]:
    """Return the designs of scenes by split. Never reorder them: datasets hold their numbers."""
    return {
        "test": HELD_OUT_MUGS,
        "validation": VALIDATION_MUGS,
        "train": TRAINING_MUGS + drawn_mugs(TRAINING_SCENE_DESIGNS),
    }


def main() -> None:
    """Build, save and describe the class."""
    kinds = {"training": TRAINING_MUGS, "test": HELD_OUT_MUGS, "validation": VALIDATION_MUGS}
    designs = kinds | {"drawn anew": drawn_mugs(20, seed=1)}
    vertices = {kind: vertices_of(each) for kind, each in designs.items()}
    built = build_mug_class()
    folder = save_packaged(built, designs_of_scenes())
    print(*describe_model(built.shape_model, vertices), folder, sep="\n")


if __name__ == "__main__":
    main()
