"""The paper's class: 23 teapots with the handle behind, 10 components (section 2 of the paper).

`python -m tools.classes.paper_teapot [FOLDER]` built the pack `vig_paper/teapot`.
"""

import json
import shutil
from pathlib import Path

from vig.io.files import write_json
from vig_world.assets.held_out import NAMED

PACK = Path(__file__).parent / "teapot"  # folder of the pack that is part of this package


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
