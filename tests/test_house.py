"""The house rules that a machine can check (CONTRIBUTING.md): who imports whom, and what nobody uses."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "vig"

# Helper modules at the top of the package, importable by every room.
HELPERS = {
    "errors": set(),
    "files": {"errors"},
    "images": {"errors", "files", "scene"},
    "processes": {"errors"},
}
ROOMS = {
    "scene": set(),
    "render": {"scene"},
    "likelihood": {"scene", "render"},
    "synthesis": {"scene", "render"},
    "dataset": {"scene", "render", "synthesis"},
    "recognition": {"scene", "render", "synthesis", "dataset"},
    "inference": {"scene", "render", "likelihood", "recognition"},
    "evaluation": {"scene", "render", "likelihood", "synthesis", "dataset", "recognition", "inference"},
    "reproduction": {"scene", "synthesis", "dataset", "recognition", "inference", "evaluation"},
    "examples": {"scene"},
}
FACES = {"report", "viewer", "cli"}
SCENE_HELPERS = {"errors", "files"}  # images decodes with scene's colours, so scene is below it

PICKLERS = {"pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
SEEDED = {"Generator", "SeedSequence", "default_rng", "BitGenerator", "PCG64", "PCG64DXSM", "Philox", "SFC64"}


def allowed(room: str) -> set[str]:
    """What modules of a room may import: the room itself, the rooms below it, the helpers."""
    if room in HELPERS:
        return HELPERS[room] | {room}
    if room in FACES or room in {"__init__", "__main__"}:
        return set(ROOMS) | set(HELPERS) | FACES
    return ROOMS[room] | {room} | (SCENE_HELPERS if room == "scene" else set(HELPERS))


def imports(tree: ast.AST, package: list[str]) -> Iterator[str]:
    """Absolute dotted names of everything imported anywhere in a module of `package`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            origin = [*base, *(node.module.split(".") if node.module else [])]
            yield from (".".join([*origin, alias.name]) for alias in node.names)


def upward_imports(source: str, room: str, package: list[str]) -> list[str]:
    names = [name.split(".") for name in imports(ast.parse(source), package)]
    # `from vig import __version__` and the like name no room.
    rooms = {name[1]: ".".join(name) for name in names if name[0] == "vig" and len(name) > 1}
    return [full for top, full in rooms.items() if not top.startswith("__") and top not in allowed(room)]


def dotted(node: ast.AST) -> str:
    """`np.random.rand` of the expression that reads so, "" for anything else."""
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def forbidden(source: str) -> list[str]:
    """What a module does that no module may: pickle, torch.load, global or unseeded random numbers."""
    tree = ast.parse(source)
    found = []
    for name in imports(tree, ["vig"]):
        parts = name.split(".")
        if parts[0] in PICKLERS | {"random"} or name == "torch.load":
            found.append(name)
        if parts[:2] == ["numpy", "random"] and len(parts) > 2 and parts[2] not in SEEDED:
            found.append(name)
    for node in ast.walk(tree):
        name = dotted(node)
        parts = name.split(".")
        if name == "torch.load":
            found.append(name)
        if parts[0] in {"np", "numpy"} and parts[1:2] == ["random"] and len(parts) > 2:
            found += [] if parts[2] in SEEDED else [name]
        if isinstance(node, ast.Call):
            called = dotted(node.func)
            if called.split(".")[-1] == "default_rng" and not node.args and not node.keywords:
                found.append(f"{called}()")
            if any(key.arg == "allow_pickle" for key in node.keywords):
                found.append("allow_pickle")
    return found


MODULES = sorted(SOURCE.rglob("*.py"))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_nothing_imports_upwards(path: Path) -> None:
    parts = path.relative_to(SOURCE).with_suffix("").parts
    if parts[0] not in {*ROOMS, *FACES, *HELPERS, "__init__", "__main__"}:
        # examples and classes hold data; a new room has to be given its place above
        pytest.fail(f"{parts[0]} has no place in the house: add it to ROOMS, FACES or HELPERS")
    assert upward_imports(path.read_text(), parts[0], ["vig", *parts[:-1]]) == []


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_no_pickle_and_no_global_randomness(path: Path) -> None:
    assert forbidden(path.read_text()) == []


def test_the_rooms_form_no_circle() -> None:
    order = list(ROOMS)
    for room, below in ROOMS.items():
        assert all(order.index(other) < order.index(room) for other in below)


@pytest.mark.parametrize(
    "source",
    [
        "import vig.inference",
        "from vig.inference import explain",
        "from vig import inference",
        "from ..inference import explain",
        "from .. import inference",
        "def f():\n    from vig.cli.main import main",
        "import numpy, vig.report.html",
    ],
)
def test_the_check_sees_every_way_to_import_upwards(source: str) -> None:
    assert upward_imports(source, "render", ["vig", "render"])


@pytest.mark.parametrize(
    "source",
    [
        "import torch",
        "from vig.scene import Mesh",
        "from vig import errors, __version__",
        "from .device import launch",
        "from vig.images import read_photo",
    ],
)
def test_the_check_lets_downward_imports_pass(source: str) -> None:
    assert not upward_imports(source, "render", ["vig", "render"])


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from pickle import loads",
        "import random",
        "from random import choice",
        "from numpy.random import rand",
        "from torch import load",
        "weights = torch.load(path)",
        "np.random.seed(0)",
        "x = numpy.random.rand(3)",
        "rng = np.random.default_rng()",
        "np.load(path, allow_pickle=True)",
    ],
)
def test_the_check_sees_what_is_forbidden(source: str) -> None:
    assert forbidden(source)


@pytest.mark.parametrize(
    "source",
    [
        "rng = np.random.default_rng(np.random.SeedSequence([seed, index]))",
        "def f(rng: np.random.Generator): return rng.random()",
        "from numpy.random import Generator",
        "from torch.utils.data import DataLoader",
        "np.load(path)",
    ],
)
def test_the_check_lets_seeded_randomness_pass(source: str) -> None:
    assert not forbidden(source)
