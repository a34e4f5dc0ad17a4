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

EXTRAS_OF_CI = ("torch", "world", "heic", "video", "dev")

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


def test_a_fit_loads_no_extra_and_nothing_that_it_does_not_need(tmp_path: Path) -> None:
    """What `vig fit` imports is most of its time for one photo."""
    unneeded = ["trimesh", "sympy", "torch._dynamo", "pyarrow", "matplotlib", "skimage", "torchvision"]
    unneeded += ["scipy.optimize", "scipy.ndimage", "scipy.spatial"]
    found = run_blocked(
        "import vig, vig_app.cli.fit\nfrom vig_app.cli.main import verbs_of_packages\nverbs_of_packages()\n"
        "vig.Explainer('teapot')\n"
        f"print([name for name in {unneeded!r} if name in sys.modules])\n"
        "for name in vig.__all__: getattr(vig, name)\n"
        "import vig_app.cli.doctor, vig_app.cli.demo",
        tmp_path,
    )
    assert (found.stdout, found.stderr) == ("[]\n", "")


def test_verbs_that_need_an_extra_name_it_and_help_needs_none(tmp_path: Path) -> None:
    verbs = [
        ["--help"],
        ["dataset", "make", "--help"],
        ["dataset", "make", "--out", "D", "--count", "1"],
        ["dataset", "check", "D"],
        ["train", "--dataset", "D", "--out", "W"],
        ["evaluate", "--dataset", "D", "--out", "R"],
    ]
    code = f"""
from vig_app.cli.main import main
for verb in {verbs!r}:
    try:
        main(verb)
    except SystemExit as ended:
        print("code", ended.code)
"""
    found = run_blocked(code, tmp_path)
    codes = [line for line in found.stdout.splitlines() if line.startswith("code")]
    assert codes == ["code 0"] * 2 + ["code 2"] * 4 and found.stdout.count("usage") == 2, found.stderr
    lines = found.stderr.splitlines()
    assert len(lines) == 4 and all("pip install 'vig[world]'" in line for line in lines)


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
