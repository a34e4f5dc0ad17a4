"""The packaged mug class: shape model from the training designs, light prior from the training panoramas.

`python -m tools.classes.mug [FOLDER]` builds it into a folder, by default `vig/classes/mug`, and prints how
far designs lie from it by the number of components.
"""

import functools

from tools.classes.drawn_mugs import drawn_mugs
from tools.classes.shapes import CodedClass, main
from vig_world.assets.mugs.design import MUGS
from vig_world.assets.mugs.mug import MUG_FACES, MUG_PARTS, PART_NAMES, POINTS, mug_vertices

MODES = 12
"""Enough for the held-out designs to be within 1 % of their size in the mean: shapes.py prints it."""
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


@functools.cache
def mug() -> CodedClass:
    """Return the class as data."""
    return CodedClass(
        "mug",
        mug_vertices,
        MUG_FACES,
        MUG_PARTS,
        PART_NAMES,
        MUGS["train"] + drawn_mugs(DRAWN_DESIGNS),
        MODES,
        {
            "test": MUGS["test"],
            "validation": MUGS["validation"],
            "train": MUGS["train"] + drawn_mugs(TRAINING_SCENE_DESIGNS),
        },
        lambda model: {
            "target_height": TARGET_HEIGHT,
            "front": "the handle",
            "points": POINTS,
            "viewing_distance": VIEWING_DISTANCE,
            "places": PLACES,
        },
    )


if __name__ == "__main__":
    main(mug())
