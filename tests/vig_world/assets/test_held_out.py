import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.support import TEAPOT
from tools.classes.drawn_teapots import drawn_designs
from tools.classes.shapes import save_coded
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig.scene.object_class import TRANSFER_FILE
from vig_world.assets.coded_designs import PARAMETERS_FILE
from vig_world.assets.designs.design import TEAPOTS
from vig_world.assets.designs.teapot import teapot_vertices
from vig_world.assets.held_out import DESIGNS_FILE, held_out_designs_of


@pytest.fixture
def pack(teapot: ObjectClass, tmp_path: Path) -> Path:
    """The teapot's pack, saved again with its designs beside its table of self-shadow."""
    designs = held_out_designs_of(teapot)
    assert designs is not None
    shutil.copy(TEAPOT / TRANSFER_FILE, tmp_path)
    teapot.save(tmp_path)
    designs.save(tmp_path)
    return tmp_path


def test_saved_designs_have_the_bytes_of_the_ones_read(pack: Path) -> None:
    for name in ("class.json", DESIGNS_FILE):
        assert (pack / name).read_bytes() == (TEAPOT / name).read_bytes()


def test_saved_designs_are_read_back(teapot: ObjectClass, pack: Path) -> None:
    held, again = held_out_designs_of(teapot), held_out_designs_of(ObjectClass.load(pack))
    assert held is not None and again is not None
    assert (again.names, again.splits) == (held.names, held.splits)
    np.testing.assert_array_equal(again.vertices, held.vertices)


def test_a_class_without_designs_has_none(teapot: ObjectClass, tmp_path: Path) -> None:
    teapot.save(tmp_path)
    assert held_out_designs_of(ObjectClass.load(tmp_path)) is None


def unname_one(pack: Path) -> None:
    described = json.loads((pack / "class.json").read_text())
    del described["held_out_designs"][0]
    (pack / "class.json").write_text(json.dumps(described))


def without_split(pack: Path) -> None:
    described = json.loads((pack / "class.json").read_text())
    del described["held_out_designs"][0]["split"]
    (pack / "class.json").write_text(json.dumps(described))


@pytest.mark.parametrize(
    ("damage", "why"),
    [
        (lambda pack: (pack / DESIGNS_FILE).unlink(), "nothing of that name"),
        (lambda pack: (pack / DESIGNS_FILE).write_bytes(b"cut"), "a damaged file"),
        (unname_one, r"vertices must be \(15, \d+, 3\); it is \(16, \d+, 3\)"),
        (without_split, "missing required field `split`"),
    ],
)
def test_missing_or_damaged_designs_are_told_in_one_line(damage, why: str, pack: Path) -> None:
    """The core does without them; the generator does not fall back on the shapes of training."""
    damage(pack)
    with pytest.raises(UserError, match=f"expected .*; got .*{why}.* Build or copy it again.") as caught:
        held_out_designs_of(ObjectClass.load(pack))
    assert "\n" not in str(caught.value)


@pytest.fixture
def coded(pack: Path) -> Path:
    """The same, in place of its designs a named one and a drawn one by their parameters."""
    save_coded({"test": TEAPOTS["test"][:1], "train": drawn_designs(1)}, pack)
    return pack


def test_designs_are_made_from_their_parameters(coded: Path) -> None:
    held = held_out_designs_of(ObjectClass.load(coded))
    assert held is not None and not (coded / DESIGNS_FILE).exists()
    assert (held.names, held.splits) == (("windsor", "drawn 0.0"), ("test", "train"))
    expected = [teapot_vertices(TEAPOTS["test"][0]), teapot_vertices(drawn_designs(1)[0])]
    np.testing.assert_array_equal(held.vertices, expected)


def test_designs_saved_as_vertices_replace_their_parameters(coded: Path, teapot: ObjectClass) -> None:
    designs = held_out_designs_of(teapot)
    assert designs is not None
    designs.save(coded)
    held = held_out_designs_of(ObjectClass.load(coded))
    assert held is not None and held.names == designs.names and not (coded / PARAMETERS_FILE).exists()


@pytest.mark.parametrize(
    ("before", "after", "why"),
    [
        ("drawn 0.0", "drawn 0.1", "no parameters of 'drawn 0.0'"),
        ('"belly_radius"', '"belly"', "unknown field `belly`"),
        ('"lobes": 0', '"lobes": "0"', "Expected `int`, got `str`"),
        ('"teapot"', '"jug"', "Invalid enum value 'jug'"),
        ("}", "", "no JSON"),
    ],
)
def test_damaged_parameters_are_told_in_one_line(before: str, after: str, why: str, coded: Path) -> None:
    text = (coded / PARAMETERS_FILE).read_text()
    assert before in text
    (coded / PARAMETERS_FILE).write_text(text.replace(before, after))
    with pytest.raises(UserError, match=f"expected .*; got .*{why}.* Build or copy it again."):
        held_out_designs_of(ObjectClass.load(coded))
