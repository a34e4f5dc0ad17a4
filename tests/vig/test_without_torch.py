"""Photos are explained, found, corrected, followed and exported without the packages of any extra."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from vig_app.examples import FOLDER

PHOTO = str(FOLDER / "02_egg_cup.png")
REFUSED = """
import sys
from importlib.machinery import PathFinder
from vig_app.cli.speed import EXTRAS

refused = {module for extra in EXTRAS.values() for module in extra.modules}
finders = [finder for finder in sys.meta_path if finder is not PathFinder]

class WithoutExtras(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name.split(".")[0] in refused else super().find_spec(name, path, target)

sys.meta_path[:] = [*finders, WithoutExtras]
"""
LIBRARY = """
import json, vig
explainer = vig.Explainer("teapot")
photo = sys.argv[1]
boxed = explainer.explain(photo, box=(30, 35, 90, 90))
found = explainer.explain(photo)
hinted = explainer.explain(photo, hints=vig.Hints(points={"spout": (40, 80)}))
followed = vig.track([photo, photo], explainer, box=(30, 35, 90, 90))
verdicts = [each.to_dict()["verdict"] for each in (boxed, found, hinted)]
print(json.dumps([verdicts, len(followed.frames), boxed.render().shape]))
"""
COMMAND = "from vig_app.cli.main import main; main(sys.argv[1:])"


def run(code: str, *arguments: str, exits: int = 0) -> subprocess.CompletedProcess[str]:
    """A program in a process that finds no package of an extra."""
    command = [sys.executable, "-c", REFUSED + code, *arguments]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert ended.returncode == exits, ended.stderr
    return ended


def test_the_library_explains_and_renders() -> None:
    verdicts, frames, shape = json.loads(run(LIBRARY, PHOTO).stdout.splitlines()[-1])
    assert len(verdicts) == 3 and verdicts[0] in ("trusted", "ambiguous", "reverted")
    assert frames == 2 and shape == [150, 150, 4]


def test_the_commands_write_all_files(tmp_path: Path) -> None:
    run(COMMAND, "fit", PHOTO, str(FOLDER / "06_figurine.png"), "--out", str(tmp_path / "out"))
    names = {path.name for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert {"explanation.json", "overlay.png", "mask.png", "render.png", "object.glb", "report.html"} <= names
    exported = tmp_path / "coco"
    run(COMMAND, "export", str(tmp_path / "out"), "--to", "coco", "--out", str(exported))
    assert any(exported.rglob("*.json"))


@pytest.mark.parametrize(
    ("code", "arguments", "extra"),
    [
        (COMMAND, ("class", "train", "{}"), "train"),
        (COMMAND, ("class", "build", "{}", "--out", "{}/c"), "world"),
        (COMMAND, ("calibrate", "--weights", "{}"), "train"),
        (COMMAND, ("dataset", "make", "--count", "1", "--out", "{}/d"), "world"),
        (COMMAND, ("fit", PHOTO, "--mesh", "{}/x.obj", "--box", "30,35,90,90", "--out", "{}/f"), "world"),
        ("from vig.renderer import render", (), "torch"),
        ("from vig.renderer import render_latents", (), "torch"),
        ("import vig; vig.renderer.scene_of", (), "torch"),
        ("import vig; vig.render", (), "torch"),
    ],
)
def test_what_needs_an_extra_says_what_to_install(
    code: str, arguments: tuple[str, ...], extra: str, tmp_path: Path
) -> None:
    ended = run(code, *(each.format(tmp_path) for each in arguments), exits=2 if arguments else 1)
    assert f"pip install 'vig[{extra}]'" in ended.stderr.splitlines()[-1]
    assert not arguments or len(ended.stderr.splitlines()) == 1
