"""The paper's class: 23 teapots with the handle behind, 10 components (section 2 of the paper).

`python -m tools.classes.paper_teapot [FOLDER]` builds the pack, by default `vig_paper/teapot`.
"""

from dataclasses import replace

from tools.classes.shapes import CodedClass, main
from tools.classes.teapot import teapot, teapot_fields
from vig_paper.teapot_class import PACK
from vig_world.assets.designs.design import TEAPOTS

DESIGNS = 23
"""Teapots that the shape model is made of: the first with the handle behind."""
COMPONENTS = 10


def paper_teapot() -> CodedClass:
    """Return the class as data; its training scenes show shapes of the model."""
    designs = [design for design in TEAPOTS["train"] if design.handle == "behind"][:DESIGNS]
    scenes = {"test": TEAPOTS["test"], "validation": TEAPOTS["validation"]}
    return replace(
        teapot(), name="teapot-paper", designs=designs, modes=COMPONENTS, scenes=scenes, fields=teapot_fields
    )


if __name__ == "__main__":
    main(paper_teapot(), PACK)
