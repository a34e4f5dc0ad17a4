"""The core works without the packages of its extras, and names the extra that is missing."""

import re
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from vig.io.errors import UserError
from vig_world.extras import optional_import

EXTRAS = ("av", "pillow_heif", "pyarrow", "OpenImageIO", "matplotlib", "bpy", "ray")

BLOCKED = f"""
import sys
from importlib.abc import MetaPathFinder

class Blocker(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {EXTRAS!r}:
            raise ModuleNotFoundError(f"No module named '{{name}}'", name=name)

sys.meta_path.insert(0, Blocker())
"""


def run_blocked(code: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run code in an interpreter that has none of the extras' packages."""
    return subprocess.run([sys.executable, "-c", BLOCKED + code], capture_output=True, text=True, cwd=cwd)


def run_vig(arguments: list[str], cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run the command line there."""
    return run_blocked(f"from vig_app.cli.main import main\nmain({arguments!r})", cwd)


def test_the_public_names_and_the_work_of_core_verbs_import_without_extras(tmp_path: Path) -> None:
    found = run_blocked(
        "import vig\n"
        "for name in vig.__all__: getattr(vig, name)\n"
        "import vig_app.cli.fit, vig_app.cli.doctor, vig_app.cli.demo\n"
        "explainer = vig.Explainer('teapot')\n"
        "print(type(explainer).__name__)",
        tmp_path,
    )
    assert (found.stdout, found.stderr) == ("Explainer\n", "")


@pytest.mark.parametrize("verb", [["--help"], ["dataset", "make", "--help"]])
def test_help_needs_no_extras(verb: list[str], tmp_path: Path) -> None:
    found = run_vig(verb, tmp_path)
    assert (found.returncode, found.stderr) == (0, "")
    assert "usage" in found.stdout


def test_a_fit_loads_nothing_that_it_does_not_need(tmp_path: Path) -> None:
    """What `vig fit` imports is most of its time for one photo."""
    unneeded = (
        "trimesh",
        "scipy.optimize",
        "scipy.ndimage",
        "scipy.spatial",
        "sympy",
        "torch._dynamo",
        "pyarrow",
        "matplotlib",
        "skimage",
        "torchvision",
    )
    found = run_blocked(
        "import vig, vig_app.cli.fit\nfrom vig_app.cli.main import verbs_of_packages\nverbs_of_packages()\n"
        "vig.Explainer('teapot')\n"
        f"print([name for name in {unneeded!r} if name in sys.modules])",
        tmp_path,
    )
    assert (found.stdout, found.stderr) == ("[]\n", "")


@pytest.mark.slow
def test_a_photo_is_explained_without_extras(tmp_path: Path) -> None:
    photo = Path(__file__).parents[2] / "src" / "vig_app" / "examples" / "01_open.png"
    found = run_vig(["fit", str(photo), "--out", "result"], tmp_path)
    assert found.returncode == 0, found.stderr
    assert list((tmp_path / "result").rglob("explanation.json"))


@pytest.mark.parametrize(
    "verb",
    [
        ["dataset", "make", "--out", "D", "--count", "1"],
        ["dataset", "check", "D"],
        ["train", "--dataset", "D", "--out", "W"],
        ["evaluate", "--dataset", "D", "--out", "R"],
    ],
    ids=lambda verb: " ".join(verb[:2]),
)
def test_a_verb_that_needs_an_extra_names_it(verb: list[str], tmp_path: Path) -> None:
    found = run_vig(verb, tmp_path)
    assert found.returncode == 2, found.stderr
    assert found.stderr.count("\n") == 1
    assert "pip install 'vig[world]'" in found.stderr


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
        for line in [
            *project["dependencies"],
            *extras["torch"],
            *extras["world"],
            *extras["heic"],
            *extras["video"],
            *extras["dev"],
        ]
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
