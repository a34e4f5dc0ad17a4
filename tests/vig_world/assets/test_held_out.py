from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.support import TEAPOT
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig.scene.object_class import TRANSFER_FILE
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
