"""The paper's class: 23 teapots with the handle behind, 10 components (section 2 of the paper).

`python -m vig_paper.teapot_class [FOLDER]` builds the pack, by default `vig_paper/teapot`.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

from vig.io.files import write_json
from vig_train.packs.shapes import CodedClass, main
from vig_train.packs.teapot import teapot, teapot_fields
from vig_world.assets.designs.design import HELD_OUT_DESIGNS, TRAINING_DESIGNS, VALIDATION_DESIGNS
from vig_world.assets.held_out import NAMED

PACK = Path(__file__).parent / "teapot"
"""Folder of the pack that is part of this package."""
DESIGNS = 23
"""Teapots that the shape model is made of: the first with the handle behind."""
COMPONENTS = 10


def paper_teapot() -> CodedClass:
    """Return the class as data; its training scenes show shapes of the model."""
    designs = [design for design in TRAINING_DESIGNS if design.handle == "behind"][:DESIGNS]
    scenes = {"test": HELD_OUT_DESIGNS, "validation": VALIDATION_DESIGNS}
    return replace(
        teapot(), name="teapot-paper", designs=designs, modes=COMPONENTS, scenes=scenes, fields=teapot_fields
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
    write_json(folder / "class.json", described, 1)  # last: a folder that has it is whole


if __name__ == "__main__":
    main(paper_teapot(), PACK)
