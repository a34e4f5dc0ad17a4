"""The paper's class: 23 teapots with the handle behind, 10 components (section 2 of the paper).

`python -m vig_paper.teapot_class [FOLDER]` builds the pack, by default `vig_paper/teapot`.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

from vig.io.files import atomic_write
from vig.scene import ObjectClass
from vig_train.packs.lights import light_prior
from vig_train.packs.shapes import distance_lines, fit_shape_model
from vig_train.packs.teapot import TARGET_HEIGHT, teapot_points, vertices_of
from vig_train.packs.transfer import write_transfer
from vig_world.assets.designs import (
    HELD_OUT_DESIGNS,
    PART_NAMES,
    TEAPOT_FACES,
    TEAPOT_PARTS,
    TRAINING_DESIGNS,
    VALIDATION_DESIGNS,
)
from vig_world.assets.held_out import NAMED, save_coded

PACK = Path(__file__).parent / "teapot"
"""Folder of the pack that is part of this package."""
DESIGNS = 23
"""Teapots that the shape model is made of: the first with the handle behind."""
COMPONENTS = 10


def build_paper_class() -> ObjectClass:
    """Fit shape model and light prior; a pure function of the code."""
    designs = [design for design in TRAINING_DESIGNS if design.handle == "behind"][:DESIGNS]
    model = fit_shape_model(vertices_of(designs), TEAPOT_FACES, TEAPOT_PARTS, PART_NAMES, COMPONENTS)
    return ObjectClass(
        "teapot-paper",
        model,
        TARGET_HEIGHT,
        *light_prior(),
        front="the spout",
        points=teapot_points(model.mean),
    )


def copy_class(folder: Path, designs: bool) -> None:
    """Copy the pack; designs: whether test and validation scenes show designs that its model was not made of.

    Else all scenes show shapes of the model, N(0, 1), as in the paper.
    """
    described = json.loads((PACK / "class.json").read_text())
    if not designs:
        described.pop(NAMED)
    folder.mkdir(parents=True, exist_ok=True)
    for path in PACK.iterdir():
        if path.name != "class.json":
            shutil.copyfile(path, folder / path.name)
    with atomic_write(folder / "class.json") as temporary:  # last: a folder that has it is whole
        temporary.write_text(json.dumps(described, indent=1) + "\n")


def main() -> None:
    """Build, save and describe the class, in the folder that is named or as this package's."""
    built, folder = build_paper_class(), Path(sys.argv[1]) if len(sys.argv) > 1 else PACK
    built.save(folder)
    designs = {"test": HELD_OUT_DESIGNS, "validation": VALIDATION_DESIGNS}
    save_coded(designs, folder)
    write_transfer(built, folder)
    model = built.shape_model
    print(f"{COMPONENTS} components hold {model.explained_variance_ratio.sum():.3f} of the variance")
    print(*distance_lines(model, {name: vertices_of(each) for name, each in designs.items()}), sep="\n")
    print(folder)


if __name__ == "__main__":
    main()
