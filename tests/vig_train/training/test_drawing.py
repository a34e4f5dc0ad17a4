"""Images of the studio that are drawn once, before a training."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.support import in_this_process
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig.scene.object_class import PACKAGED
from vig_train.training import drawing as module
from vig_train.training.drawing import Drawing, add_drawn_examples, drawn_once, studio_examples
from vig_train.training.examples import Examples
from vig_world.studio.studio import Studio, StudioSettings

DRAWING = Drawing(PACKAGED / "teapot", 2, 5, recoloured=0.0, studio=StudioSettings(absent=0.0))


def steps(once: Examples, first: int, last: int) -> Iterator[tuple[Examples, int]]:
    """Of each step one image of a dataset."""
    for step in range(first, last):
        yield once[:1], step


def test_they_are_those_of_their_numbers_and_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "DRAWN", 3)
    done: list[int] = []
    once = drawn_once(DRAWING, tmp_path, 7, done.append)
    assert len(once) == 6 and done == [3, 3]
    monkeypatch.setattr(module, "map_in_processes", in_this_process)
    drawn = studio_examples(Studio(ObjectClass.load("teapot"), DRAWING.studio), 7, range(3, 6))
    torch.testing.assert_close(once[3:].images, drawn.images)
    (folder,) = tmp_path.iterdir()
    (folder / "00001.safetensors").unlink()
    again = drawn_once(DRAWING, tmp_path, 7, done.append)
    assert done == [3, 3, 3], "only what is missing is drawn"
    torch.testing.assert_close(again.images, once.images)
    (folder / "00000.safetensors").write_bytes(b"broken")
    with pytest.raises(UserError, match="Remove the folder"):
        drawn_once(DRAWING, tmp_path, 7)
    other = drawn_once(replace(DRAWING, distinct=1), tmp_path, 8)
    assert len(other) == 3 and not torch.equal(other.images, once.images[:3]), "of another seed are others"
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(UserError, match="a folder that can be written"):
        drawn_once(DRAWING, tmp_path / "file", 7)


def test_each_step_takes_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "DRAWN", 8)
    monkeypatch.setattr(module, "map_in_processes", in_this_process)
    once = drawn_once(replace(DRAWING, distinct=8), tmp_path, 7)

    def taken(first: int, last: int) -> list[list[float]]:
        with_drawn = add_drawn_examples(steps(once, first, last), DRAWING, 7, once)
        return [examples.azimuth[1:].tolist() for examples, _ in with_drawn]

    found = taken(0, 6)
    assert all(len(set(step)) == DRAWING.count for step in found) and len({tuple(step) for step in found}) > 3
    assert taken(3, 6) == found[3:], "whatever the step at which a run resumes"
