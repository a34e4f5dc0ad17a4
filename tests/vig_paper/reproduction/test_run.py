"""Steps are done once, in order, and again when what they take is made anew."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from vig.io.errors import UserError
from vig_paper.reproduction import Run, reproduce, work
from vig_paper.reproduction.folder import duration
from vig_paper.settings import STEP_KINDS
from vig_train.record import Record

ALL = [
    "data train",
    "data validation",
    "data test_raster",
    "train",
    "calibrate",
    "evaluate raster",
    "ablations",
    "figures raster",
    "page",
]


@pytest.fixture
def go(done: list[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Record]:
    """Reproduces with a page that is only a file."""

    def page(root: Path) -> None:
        done.append("page")
        (root / "index.html").touch()

    monkeypatch.setattr("vig_paper.reproduction.run.write_page", page)
    return lambda run, chosen=STEP_KINDS: reproduce(run, chosen)


def test_every_step_is_done_once_and_in_order(begin, go, done: list[str]) -> None:
    record = go(begin())
    assert done == ALL and all(record.complete(step) for step in ALL)
    go(begin())
    assert done == ALL


def test_path_traced_photos_can_come_later(begin, go, done: list[str]) -> None:
    go(begin())
    done.clear()
    go(begin(("raster", "cycles")))
    assert done == ["data test_cycles", "evaluate cycles", "figures cycles", "page"]


def test_given_weights_need_no_training_photos(begin, go, done: list[str], tmp_path: Path) -> None:
    go(begin(weights=tmp_path / "w.safetensors"))
    assert done == ["data test_raster", "train", "evaluate raster", "ablations", "figures raster", "page"]


def test_steps_can_be_chosen_but_not_without_what_they_need(begin, go, done: list[str]) -> None:
    go(begin(), ("data",))
    assert done == ALL[:3]
    with pytest.raises(UserError, match="expected calibrate done before evaluate raster; choose those"):
        go(begin(), ("evaluate",))
    go(begin(), ("train", "calibrate", "evaluate", "page"))
    assert done == [*ALL[:6], "page"]  # a page without figures


def test_a_page_is_made_again_when_there_is_more_to_show(begin, go, done: list[str]) -> None:
    go(begin(), tuple(kind for kind in STEP_KINDS if kind != "ablations"))
    done.clear()
    go(begin())
    assert done == ["ablations", "page"]


@pytest.mark.parametrize(
    ("removed", "again"),
    [
        ("recognition", ["train", "calibrate", "evaluate raster", "ablations", "figures raster", "page"]),
        ("figures", ["figures raster", "page"]),
        ("data/validation", ["data validation", *ALL[4:]]),
        ("index.html", ["page"]),
    ],
)
def test_what_is_removed_is_made_again_and_all_that_takes_it(
    begin, go, done: list[str], removed: str, again: list[str]
) -> None:
    run: Run = begin()
    go(run)
    done.clear()
    path = run.folder.root / removed
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    go(run)
    assert done == again


def test_a_step_that_was_stopped_is_done_again_and_its_time_counts(
    begin, go, done: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run, whole = begin(), work.evaluate

    def stopped(run: Run, tier: str) -> None:
        whole(run, tier)  # its product is there, and yet it is not done
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(work, "evaluate", stopped)
        with pytest.raises(KeyboardInterrupt):
            go(run)
    assert done == ALL[:6]
    record = go(run)
    assert done == [*ALL[:6], *ALL[5:]]
    assert record.data["steps"]["evaluate raster"]["sittings"] == 2


def test_removed_material_that_is_half_made_does_not_count_as_made(
    begin, go, done: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run, whole = begin(), work.make_data
    go(run)
    shutil.rmtree(run.folder.data("test_raster"))

    def stopped(run: Run, name: str) -> None:
        whole(run, name)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(work, "make_data", stopped)
        with pytest.raises(KeyboardInterrupt):
            go(run)
    done.clear()
    go(run)
    assert done == ["data test_raster", "evaluate raster", "ablations", "figures raster", "page"]


@pytest.mark.parametrize(
    ("chosen", "workers", "said"),
    [
        (("paint",), None, "got paint"),
        ((), None, "got none"),
        (STEP_KINDS, 0, "--workers of at least 1; got 0"),
    ],
)
def test_mistakes_are_told_before_anything_is_written(begin, go, chosen, workers, said: str) -> None:
    run: Run = begin(workers=workers)
    with pytest.raises(UserError, match=said):
        go(run, chosen)
    assert not run.folder.root.exists()


def test_durations_for_people() -> None:
    assert [duration(s) for s in (4.26, 75, 7512)] == ["4.3 s", "1 min 15 s", "2 h 5 min"]
