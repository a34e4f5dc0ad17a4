"""The documentation keeps up with the code: links lead somewhere, code runs, commands parse, numbers hold."""

import ast
import math
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from fractions import Fraction
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from packaging.version import Version
from PIL import Image

import vig
from vig.inference import ExplainSettings, Stage
from vig.inference.settings import PHOTO, PICTURE
from vig.io.errors import UserError
from vig.likelihood import GAUSSIAN, ROBUST, SPATIAL
from vig.likelihood.spatial import SpatialMask
from vig.scene import latent_layout
from vig.scene.latents import FRAMING
from vig.scene.object_class import PACKAGED
from vig.search import Budget, LevenbergMarquardt
from vig_app.cli.common import verbs_of_packages
from vig_app.cli.main import VERBS
from vig_app.cli.main import _parse_arguments as parsed
from vig_paper.optimizers import BFGS, LBFGS, ConjugateGradient, Dogleg, GradientDescent
from vig_train.training.drawing import Drawing
from vig_train.training.training import TrainingSettings
from vig_world.generation.write import make_dataset
from vig_world.renderers.cycles.renderer import find_python
from vig_world.studio.studio import StudioSettings

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("src/**/*.md")])
CURRENT = [page for page in PAGES if page.name != "CHANGELOG.md"]
"""Pages whose names are those of the code; a changelog names what is gone, too."""


def each(pages: list[Path]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("page", pages, ids=lambda page: str(page.relative_to(ROOT)))


def python_blocks(text: str) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def unresolved(name: str) -> bool:
    """Whether a dotted name is neither a module nor what hangs on one."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            if not hasattr(found, part):
                return True
            found = getattr(found, part)
        return False
    return True


def import_statements(block: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(block)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield ast.unparse(node)


@each(PAGES)
def test_links_and_pictures_are_there(page: Path) -> None:
    links = re.findall(r"\]\(([^)\s]+)\)", page.read_text())
    files = [link.partition("#")[0] for link in links if not re.match(r"[a-z]+:|#", link)]
    assert [name for name in files if not (page.parent / name).exists()] == []


@each(CURRENT)
def test_names_of_the_packages_in_code_quotes_exist(page: Path) -> None:
    quoted = re.findall(r"`(vig(?:_app|_world|_train|_paper)?(?:\.\w+)+)[`(]", page.read_text())
    files = {name for name in quoted if name.endswith((".toml", ".md"))} | {"vig.verbs"}
    assert sorted({name for name in quoted if name not in files and unresolved(name)}) == []


@each(CURRENT)
def test_files_and_modules_that_commands_name_exist(page: Path) -> None:
    text = page.read_text()
    modules = re.findall(r"python -m ((?:vig\w*|benchmarks)(?:\.\w+)*)", text)
    files = re.findall(r"\b((?:src|tests|tools|examples|benchmarks)/[\w/.]*\w\.(?:py|png|json))\b", text)
    assert [module for module in modules if find_spec(module.removesuffix(".NAME")) is None] == []
    assert [name for name in files if "NAME" not in name and not (ROOT / name).exists()] == []


@each([page for page in CURRENT if python_blocks(page.read_text())])
def test_code_blocks_import_what_there_is(page: Path) -> None:
    for block in python_blocks(page.read_text()):
        for statement in import_statements(block):
            exec(statement, {})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where code blocks run: with the photos, the result and the dataset that they name."""
    folder = tmp_path_factory.mktemp("docs")
    (folder / "src").symlink_to(ROOT / "src")
    with Image.open(ROOT / "src/vig_app/examples/02_egg_cup.png") as example:
        # Its pot, of box 35, 39, 80, 60, comes to the box of the pages, 120, 80, 300, 240.
        photo = example.convert("RGB").resize((562, 562)).crop((11, 66, 562, 562))
    photo.save(folder / "photo.jpg")
    photo.save(folder / "table.jpg")
    vig.Explainer("teapot").explain(folder / "photo.jpg", box=(120, 80, 300, 240)).save(folder / "result")
    make_dataset(folder / "D", 13, 0, workers=1, progress=False)
    return folder


@pytest.mark.slow
@each([page for page in CURRENT if python_blocks(page.read_text())])
def test_code_blocks_run_as_printed(page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if page.name == "world.md":
        try:
            find_python()
        except UserError as error:
            pytest.skip(str(error))
    monkeypatch.chdir(folder)
    for block in python_blocks(page.read_text()):
        exec(compile(block, page.name, "exec"), {"__name__": page.stem})


@pytest.mark.slow
def test_positions_of_the_glb_come_onto_the_object_as_the_page_says(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their extent on the photo is the explanation's box, that of the outline, to 2 pixels: of the model's
    outline, without the network's share.
    """
    settings = ExplainSettings(network_mask_share=0.0)
    box = (120, 80, 300, 240)
    vig.Explainer("teapot", settings).explain(folder / "photo.jpg", box=box).save(tmp_path / "result")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    (block,) = python_blocks((ROOT / "docs/explanation.md").read_text())
    exec(block, names)
    x, y, width, height = names["explained"]["box"]
    ends = [(places.min(), places.max()) for places in (names["columns"], names["rows"])]
    np.testing.assert_allclose(ends, [(x, x + width), (y, y + height)], atol=2)


def command_lines(text: str) -> Iterator[str]:
    """`vig` commands of indented and fenced blocks, without their comments, continued lines joined."""
    joined = re.sub(r"\\\n", " ", text)
    for block in re.findall(r"^```(?:sh|bash|console)?\n(.*?)^```", joined, re.DOTALL | re.MULTILINE):
        yield from re.findall(r"^(vig [^#\n]*)", block, re.MULTILINE)
    yield from re.findall(r"^#? {4,}(vig [^#\n]*)", joined, re.MULTILINE)


def refusal(command: str, capsys: pytest.CaptureFixture[str]) -> str:
    """What the command line says of a command that it does not take, else nothing."""
    verbs = {verb.settings: verb for verb in (*VERBS, *verbs_of_packages())}
    try:
        parsed(list(verbs.values()), shlex.split(command)[1:])
    except UserError as error:
        return str(error)
    except SystemExit:  # after help
        pass
    return ""


@each([*CURRENT, *sorted((ROOT / "docs/tutorials").glob("*.py"))])
def test_command_lines_parse(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert [line for line in command_lines(page.read_text()) if refusal(line, capsys)] == []


@each(CURRENT)
def test_options_of_quoted_commands_exist(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They may lack what is required; N and S stand for numbers."""
    for command in re.findall(r"`(vig [a-z][^`]*)`", page.read_text()):
        said = refusal(re.sub(r"\b[NS]\b", "1", command), capsys)
        assert not re.search("Unrecognized|Error parsing|expected --|invalid choice", said), said


SETTINGS: dict[str, Any] = {
    "PHOTO": SimpleNamespace(**PHOTO),
    "PICTURE": SimpleNamespace(**PICTURE),
    "ROBUST": ROBUST,
    "GAUSSIAN": GAUSSIAN,
    "SPATIAL": SPATIAL,
    "FRAMING": FRAMING,
} | {
    kind.__name__: kind
    for kind in (
        ExplainSettings, SpatialMask, LevenbergMarquardt, Budget, Dogleg, LBFGS, BFGS,
        ConjugateGradient, GradientDescent, TrainingSettings, Drawing, StudioSettings,
    )
}  # fmt: skip
"""What pages call by its own name; whatever else they name in full, from its package on."""
STATEMENT = re.compile(r"`([A-Za-z_]\w*(?:\.\w+)+) = ([^`=]+)`")
"""A default that a page states, such as `ExplainSettings.azimuth_weight = 100.0`; angles in degrees."""


def statements(text: str) -> list[tuple[str, str]]:
    """Names and values of the defaults that a page states."""
    found: list[tuple[str, str]] = STATEMENT.findall(text)
    return [
        (name, value) for name, value in found if name.split(".")[0] in SETTINGS or name.startswith("vig")
    ]


def in_code(name: str) -> Any:
    """What the code has under a name; a dataclass's default is its attribute. AttributeError when nothing."""
    first, *rest = name.split(".")
    if first in SETTINGS:
        found = SETTINGS[first]
    else:
        module, _, last = name.rpartition(".")
        found, rest = import_module(module), [last]
    for part in rest:
        found = getattr(found, part)
    return found


def mistaken(stated: list[tuple[str, str]]) -> list[str]:
    """Statements that are not what the code has."""
    wrong = []
    for name, value in stated:
        try:
            there = in_code(name)
        except (AttributeError, ModuleNotFoundError):
            wrong.append(f"{name} does not exist")
            continue
        if value.endswith(" degrees"):
            right = math.isclose(math.degrees(there), float(value.removesuffix(" degrees")), rel_tol=1e-5)
        else:
            said = ast.literal_eval(value)
            right = said == there and isinstance(said, bool) == isinstance(there, bool)
        if not right:
            wrong.append(f"{name} = {there!r}, where the page states {value}")
    return wrong


@each([page for page in CURRENT if statements(page.read_text())])
def test_defaults_that_pages_state_are_those_of_the_code(page: Path) -> None:
    assert mistaken(statements(page.read_text())) == []


def numbers_of(name: str) -> set[str]:
    """The names of the settings that have a number or a switch by default."""
    values = vars(SETTINGS[name])
    return {
        f"{name}.{key}" for key, value in values.items() if isinstance(value, int | float) and key[0] != "_"
    }


@pytest.mark.parametrize(
    "name", ["PHOTO", "PICTURE", "ROBUST", "GAUSSIAN", "SPATIAL", "SpatialMask", "ExplainSettings",
             "TrainingSettings", "StudioSettings"]
)  # fmt: skip
def test_pages_state_every_default(name: str) -> None:
    """So that a setting that is added or renamed changes a page; `untold` follows from class or weights."""
    stated = {name for page in CURRENT for name, _ in statements(page.read_text())}
    untold = {"TrainingSettings.trunk_only", "TrainingSettings.mirror", "ExplainSettings.calibrated"}
    assert numbers_of(name) - stated - untold == set()


def test_stages_are_stated_as_they_are() -> None:
    text = (ROOT / "docs/objective.md").read_text()
    rows = re.findall(r"^\| `(Stage\([^`]*\))` \|(.*)\|$", text, re.MULTILINE)
    stages = tuple(eval(stage, {"Stage": Stage}) for stage, _ in rows)
    assert stages == PICTURE["stages"] + PHOTO["stages"]
    for stage, (_, cells) in zip(stages, rows, strict=True):
        starts, steps, noise, size, tolerance = (float(Fraction(cell.strip())) for cell in cells.split("|"))
        stated = Stage(int(starts), int(steps), noise, size, tolerance, stage.one_per_view)
        assert stated == stage


def test_a_changed_number_of_a_page_or_of_the_code_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    page = "`PHOTO.prior_weight = 20.0`, `ExplainSettings.azimuth_weight = 100.0`, `SPATIAL.gone = 1`"
    assert mistaken(statements(page)) == ["SPATIAL.gone does not exist"]
    assert len(mistaken(statements(page.replace("100.0", "10.0")))) == 2
    monkeypatch.setattr(ExplainSettings, "azimuth_weight", 50.0)
    assert len(mistaken(statements(page))) == 2


def test_numbers_of_latents_are_those_of_the_packaged_classes() -> None:
    text = (ROOT / "docs/conventions.md").read_text()
    components = {
        name: int(number) for name, number in re.findall(r"(teapot|mug|car)s (?:have )?K = (\d+)", text)
    }
    packaged = sorted(path.parent.name for path in PACKAGED.glob("*/class.json"))
    assert sorted(components) == packaged
    for name, number in components.items():
        assert vig.ObjectClass.load(name).shape_model.modes == number
        assert latent_layout(number).size == number + 14
        assert name in (ROOT / "README.md").read_text()
    dataset = (ROOT / "docs/dataset.md").read_text()
    assert f"`shape_{components['teapot'] - 1}` (of teapots)" in dataset


def test_the_version_is_later_than_the_last_release_while_changes_are_unreleased() -> None:
    changes = (ROOT / "CHANGELOG.md").read_text()
    newest, released = re.findall(r"^## \[([^\]]+)\]", changes, re.MULTILINE)[:2]
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert vig.__version__ == version
    assert (
        f"version: {released if newest == 'Unreleased' else newest}\n" in (ROOT / "CITATION.cff").read_text()
    )
    if newest == "Unreleased":
        assert Version(version) > Version(released) and Version(version).is_devrelease
    else:
        assert version == newest


def test_broken_links_of_a_site_are_named(tmp_path: Path) -> None:
    pages = {
        "index.html": '<a href="a/">a</a> <a href="a/#there">b</a> <a href="https://example.org/x.md">c</a>'
        '<img src="a/no.png"><a href="/a/index.html"><a href="#top"><a href="a/#gone"><p id="top">',
        "a/index.html": '<h1 id="there"></h1><a href="../b.md"><a href="../">up</a><a href="../../out.html">',
    }
    (tmp_path / "site" / "a").mkdir(parents=True)
    (tmp_path / "out.html").touch()
    for name, text in pages.items():
        (tmp_path / "site" / name).write_text(text)
    command = [sys.executable, str(ROOT / "tools/check_site.py"), str(tmp_path / "site")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stdout.splitlines() == [
        "a/index.html: ../b.md",
        "a/index.html: ../../out.html",
        "index.html: a/no.png",
        "index.html: a/#gone",
    ]


@pytest.mark.parametrize("name", ["fit_pose_and_light", "make_demo", "make_examples", "make_hero"])
def test_examples_answer_to_help(name: str, tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "examples" / f"{name}.py"), "--help"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "usage" in done.stdout
