"""Rules of the structure that a machine can check (CONTRIBUTING.md): imports, pickle, randomness."""

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src"

# Who may import whom, from the ground up. Modules at the top of vig are importable by all above them.
MAY_IMPORT = {
    "vig.errors": set(),
    "vig.names": set(),
    "vig.checks": {"vig.errors"},
    "vig.files": {"vig.errors", "vig.checks"},
    "vig.parallel": {"vig.errors"},
    "vig.scene": {"vig.errors", "vig.checks", "vig.files"},
    "vig.photo": {"vig.errors", "vig.checks", "vig.files", "vig.scene"},
}
HELPERS = {"vig.errors", "vig.names", "vig.checks", "vig.files", "vig.parallel"}
BELOW = {
    "vig.renderer": {"vig.scene"},
    "vig.likelihood": {"vig.scene", "vig.renderer"},
    "vig.optimizers": {"vig.renderer"},
    "vig.recognition": {"vig.scene", "vig.photo"},
    "vig.inference": {
        "vig.scene",
        "vig.renderer",
        "vig.likelihood",
        "vig.optimizers",
        "vig.recognition",
    },
    "vig.report": {"vig.scene", "vig.photo", "vig.renderer", "vig.inference"},
}
MAY_IMPORT |= {subpackage: below | HELPERS for subpackage, below in BELOW.items()}
MAY_IMPORT["vig.hints"] = set(MAY_IMPORT)
MAY_IMPORT["vig.corrections"] = set(MAY_IMPORT)
MAY_IMPORT["vig.explanation"] = set(MAY_IMPORT)
MAY_IMPORT["vig.explainer"] = set(MAY_IMPORT)
MAY_IMPORT["vig.results"] = set(MAY_IMPORT)
MAY_IMPORT["vig.together"] = set(MAY_IMPORT)
MAY_IMPORT["vig.tracking"] = set(MAY_IMPORT)
MAY_IMPORT["vig.runs"] = set(MAY_IMPORT)
MAY_IMPORT["vig.viewer"] = set(MAY_IMPORT)
MAY_IMPORT["vig.cli"] = set(MAY_IMPORT)
MAY_IMPORT["vig.__main__"] = {"vig.cli"}
CORE = set(MAY_IMPORT)
WORLD = {
    "vig_world.names": set(),
    "vig_world.extras": set(),
    "vig_world.kept": set(),
    "vig_world.mesh": set(),
    "vig_world.rotations": set(),
    "vig_world.threads": set(),
    "vig_world.dataset": {"vig_world.names", "vig_world.rotations", "vig_world.extras"},
    "vig_world.streams": {"vig_world.names", "vig_world.dataset"},
    "vig_world.assets": {
        "vig_world.extras",
        "vig_world.streams",
        "vig_world.mesh",
        "vig_world.rotations",
        "vig_world.dataset",
    },
    "vig_world.rooms": {"vig_world.assets", "vig_world.mesh"},
    "vig_world.renderers.rasterize": set(),
    "vig_world.renderers.view": {"vig_world.dataset", "vig_world.renderers.rasterize"},
    "vig_world.renderers.picture": set(),
    "vig_world.renderers.raster": {
        "vig_world.assets",
        "vig_world.dataset",
        "vig_world.kept",
        "vig_world.mesh",
        "vig_world.rotations",
        "vig_world.renderers.view",
        "vig_world.renderers.picture",
    },
    "vig_world.library": {
        "vig_world.dataset",
        "vig_world.kept",
        "vig_world.mesh",
        "vig_world.rotations",
        "vig_world.streams",
        "vig_world.assets",
        "vig_world.rooms",
        "vig_world.renderers.raster",
    },
}
for name in ("composition", "packs", "renderers", "generation", "building", "cli"):
    WORLD[f"vig_world.{name}"] = set(WORLD)
LAB = {
    "vig_lab.examples": set(),
    "vig_lab.names": set(),
    "vig_lab.training": set(),
    "vig_lab.plots": {"vig_lab.training"},
    "vig_lab.paper_network": {"vig_lab.training"},
    "vig_lab.evaluation": {"vig_lab.names", "vig_lab.paper_network"},
    "vig_lab.calibration": {"vig_lab.evaluation", "vig_lab.paper_network", "vig_lab.training"},
    "vig_lab.ablation": {"vig_lab.evaluation", "vig_lab.paper_network"},
    "vig_lab.figures": {"vig_lab.evaluation", "vig_lab.calibration", "vig_lab.paper_network"},
}
LAB["vig_lab.reproduction"] = set(LAB)
LAB["vig_lab.cli"] = set(LAB)
MAY_IMPORT |= {subpackage: below | CORE for subpackage, below in WORLD.items()}
MAY_IMPORT |= {subpackage: below | CORE | set(WORLD) for subpackage, below in LAB.items()}
PACKAGES = ("vig", "vig_world", "vig_lab")
"""No package imports one that stands after it here."""

PICKLERS = {"pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
SEEDED = {"Generator", "SeedSequence", "default_rng", "BitGenerator", "PCG64", "PCG64DXSM", "Philox", "SFC64"}


def subpackage_of(module: str) -> str:
    """`vig.renderer` of `vig.renderer.primitives.texture`; a package's own `__init__` is its package."""
    parts = module.split(".")
    inner = ".".join(parts[:3])
    return inner if inner in MAY_IMPORT else ".".join(parts[:2])


def allowed(subpackage: str) -> set[str]:
    """Rooms that modules of a subpackage may import: itself, and those below it."""
    if (
        subpackage in PACKAGES or subpackage == "vig.__main__"
    ):  # hands out names of all subpackages of its package and below
        return {
            each
            for each in MAY_IMPORT
            if PACKAGES.index(each.split(".")[0]) <= PACKAGES.index(subpackage.split(".")[0])
        }
    return MAY_IMPORT[subpackage] | {subpackage}


def imports(tree: ast.AST, package: list[str]) -> Iterator[str]:
    """Absolute dotted names of everything imported anywhere in a module of `package`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            origin = [*base, *(node.module.split(".") if node.module else [])]
            yield from (".".join([*origin, alias.name]) for alias in node.names)


def upward_imports(source: str, subpackage: str, package: list[str]) -> list[str]:
    """Names that a module of `subpackage` imports from subpackages that do not lie below it."""
    found = []
    for name in imports(ast.parse(source), package):
        parts = name.split(".")
        if parts[0] not in PACKAGES or (len(parts) > 1 and parts[1].startswith("__")):
            continue  # `from vig import __version__` names no subpackage
        if len(parts) == 1 and parts[0] == subpackage.split(".")[0]:
            continue
        if subpackage_of(name) not in allowed(subpackage):
            found.append(name)
    return found


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
        if parts[0] in {"np", "numpy"} and parts[1:2] == ["random"] and len(parts) > 2:
            found += [] if parts[2] in SEEDED else [name]
        if isinstance(node, ast.Call):
            called = dotted(node.func)
            if called == "torch.load" and not any(
                key.arg == "weights_only" and getattr(key.value, "value", None) is True
                for key in node.keywords
            ):
                found.append(called)
            if called.split(".")[-1] == "default_rng" and not node.args and not node.keywords:
                found.append(f"{called}()")
            if any(key.arg == "allow_pickle" for key in node.keywords):
                found.append("allow_pickle")
    return found


MODULES = sorted(SOURCE.rglob("*.py"))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_nothing_imports_upwards(path: Path) -> None:
    parts = path.relative_to(SOURCE).with_suffix("").parts
    subpackage = subpackage_of(".".join(part for part in parts if part != "__init__"))
    if subpackage not in {*MAY_IMPORT, *PACKAGES}:
        pytest.fail(f"{subpackage} has no place in the structure: add it to BELOW, WORLD or LAB")
    assert upward_imports(path.read_text(), subpackage, list(parts[:-1])) == []


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_no_pickle_and_no_global_randomness(path: Path) -> None:
    assert forbidden(path.read_text()) == []
    if "torch.load" in path.read_text():  # the weights of others, which come as a pickle
        assert path.name == "pretrained.py"


def test_the_subpackages_form_no_circle() -> None:
    order = list(MAY_IMPORT)
    for subpackage, below in MAY_IMPORT.items():
        assert all(order.index(other) < order.index(subpackage) for other in below)


def test_modules_import_each_other_in_no_circle() -> None:
    """Within a subpackage, too: imports at the top of modules, those for type checkers left out."""
    names = {".".join(path.relative_to(SOURCE).with_suffix("").parts): path for path in MODULES}
    names = {name.removesuffix(".__init__"): path for name, path in names.items()}
    graph = {
        name: {
            target
            for full in imports_at_top(ast.parse(path.read_text()))
            for target in (full, full.rpartition(".")[0])
            if target in names and target != name and not name.startswith(f"{target}.")
        }
        for name, path in names.items()
    }
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(f"modules import each other in a circle: {' -> '.join(error.args[1])}")


def imports_at_top(tree: ast.Module) -> Iterator[str]:
    """What a module imports when it is imported itself."""
    for node in tree.body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield from imports(ast.Module([node], []), [])


@pytest.mark.parametrize(
    "source",
    [
        "import vig.inference",
        "from vig.inference import explain",
        "from vig import inference",
        "from ..inference import explain",
        "from .. import inference",
        "def f():\n    from vig.cli.main import main",
        "import numpy, vig.report.files",
        "import vig_world",
        "from vig_lab.evaluation import evaluate",
    ],
)
def test_the_check_sees_every_way_to_import_upwards(source: str) -> None:
    assert upward_imports(source, "vig.renderer", ["vig", "renderer"])


@pytest.mark.parametrize(
    "source",
    [
        "import torch",
        "from vig.scene import Camera",
        "from vig import errors, __version__",
        "from .device import launch",
        "from vig.parallel import map_on_threads",
    ],
)
def test_the_check_lets_downward_imports_pass(source: str) -> None:
    assert not upward_imports(source, "vig.renderer", ["vig", "renderer"])


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
