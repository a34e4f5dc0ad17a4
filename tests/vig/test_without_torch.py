"""Photos are explained where torch cannot be imported."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

REFUSED = """
import sys

class Refused:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "torch":
            raise ModuleNotFoundError("No module named 'torch'", name="torch")

sys.meta_path.insert(0, Refused())
"""

LIBRARY = """
import json, vig
explainer = vig.Explainer("teapot")
photo = sys.argv[1]
boxed = explainer.explain(photo, box=(30, 35, 90, 90))
found = explainer.explain(photo)
hinted = explainer.explain(photo, hints=vig.Hints(points={"spout": (40, 80)}))
print(json.dumps([each.to_dict()["verdict"] for each in (boxed, found, hinted)] + [boxed.render().shape]))
"""


def run(code: str, *arguments: str) -> str:
    """What a program prints in a process that refuses torch."""
    command = [sys.executable, "-c", REFUSED + code, *arguments]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


@pytest.fixture(scope="module")
def photo() -> str:
    from vig_app.examples import FOLDER

    return str(FOLDER / "02_egg_cup.png")


def test_the_library_explains_and_renders(photo: str) -> None:
    *verdicts, shape = json.loads(run(LIBRARY, photo).splitlines()[-1])
    assert len(verdicts) == 3 and verdicts[0] in ("trusted", "ambiguous", "reverted")
    assert shape == [150, 150, 4]


@pytest.mark.slow
def test_the_command_writes_all_files(photo: str, tmp_path: Path) -> None:
    run("from vig_app.cli.main import main; main(sys.argv[1:])", "fit", photo, "--out", str(tmp_path / "out"))
    names = {path.name for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert {"explanation.json", "overlay.png", "mask.png", "render.png", "object.glb", "report.html"} <= names
