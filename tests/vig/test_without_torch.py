"""Photos are explained, found, corrected, followed and exported without the packages of any extra; what needs
one names it.
"""

import json
import re
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from vig.io.errors import UserError
from vig_app.examples import FOLDER
from vig_world.extras import optional_import

EXTRAS_OF_CI = ("torch", "world", "heic", "video", "dev")

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


COMMANDS = [
    (("class", "train", "{}"), "train"),
    (("class", "build", "{}", "--out", "{}/c"), "world"),
    (("calibrate", "--weights", "{}"), "train"),
    (("dataset", "make", "--count", "1", "--out", "{}/d"), "world"),
    (("dataset", "check", "{}/d"), "world"),
    (("train", "--dataset", "{}/d", "--out", "{}/d"), "train"),
    (("evaluate", "--dataset", "{}/d", "--out", "{}/d"), "world"),
    (("fit", PHOTO, "--mesh", "{}/x.obj", "--box", "30,35,90,90", "--out", "{}/f"), "world"),
]
IMPORTS = (
    "from vig.renderer import render",
    "from vig.renderer import render_latents",
    "import vig; vig.renderer.scene_of",
    "import vig; vig.render",
)


def test_commands_that_need_an_extra_say_what_to_install_in_one_line_and_help_needs_none(tmp_path) -> None:
    given = [["--help"], ["dataset", "make", "--help"]]
    given += [[word.format(tmp_path) for word in words] for words, _ in COMMANDS]
    code = f"""
from vig_app.cli.main import main
for words in {given!r}:
    try:
        main(words)
    except SystemExit as ended:
        assert (ended.code or 0) == (0 if "--help" in words else 2), words
"""
    ended = run(code)
    lines = ended.stderr.splitlines()
    assert len(lines) == len(COMMANDS) and ended.stdout.count("usage: ") == 2
    for line, (_, extra) in zip(lines, COMMANDS, strict=True):
        assert f"pip install 'vig[{extra}]'" in line


def test_names_that_need_torch_say_what_to_install() -> None:
    code = f"""
for statement in {IMPORTS!r}:
    try:
        exec(statement)
    except ImportError as error:
        print(error)
"""
    lines = run(code).stdout.splitlines()
    assert len(lines) == len(IMPORTS) and all("pip install 'vig[torch]'" in line for line in lines)


def test_a_fit_loads_nothing_that_it_does_not_need() -> None:
    """What `vig fit` imports is most of its time for one photo."""
    unneeded = ["trimesh", "sympy", "matplotlib", "scipy.optimize", "scipy.ndimage", "scipy.spatial"]
    found = run(
        "import vig, vig_app.cli.fit\nfrom vig_app.cli.main import verbs_of_packages\nverbs_of_packages()\n"
        "vig.Explainer('teapot')\n"
        f"print([name for name in {unneeded!r} if name in sys.modules])\n"
        "for name in {*vig.__all__} - {'render'}: getattr(vig, name)\n"
        "import vig_app.cli.doctor, vig_app.cli.demo"
    )
    assert (found.stdout, found.stderr) == ("[]\n", "")


def test_a_missing_package_is_one_line_with_its_extra() -> None:
    with pytest.raises(UserError) as error, optional_import("world"):
        import_module("vig_package_that_nobody_has")
    assert str(error.value) == (
        "expected the package vig_package_that_nobody_has; it is not installed. Run pip install 'vig[world]'."
    )


def test_the_lowest_versions_that_ci_installs_are_those_of_the_package() -> None:
    root = Path(__file__).parents[2]
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    floors = dict(
        found.groups()
        for line in sum((extras[name] for name in EXTRAS_OF_CI), project["dependencies"])
        if (found := re.fullmatch(r"([\w-]+)>=([\d.]+)", line))
    )
    pinned = dict(
        line.split("==")
        for line in (root / "constraints-lowest.txt").read_text().splitlines()
        if not line.startswith("#")
    )
    assert floors.keys() == pinned.keys()
    for name, floor in floors.items():
        assert re.fullmatch(rf"{re.escape(floor)}(\.0)*", pinned[name]), name
