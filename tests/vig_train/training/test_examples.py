"""Whole rooms are held out for validation."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tests.vig_train.training.test_training import InMemory, tiny_dataset
from vig_train.training.examples import HELD_OUT_SHARE, hold_out


def test_no_room_is_both_trained_on_and_validated_on(tmp_path: Path) -> None:
    """40 photos in eight rooms: a room has an eighth of them, which is enough."""
    dataset = tiny_dataset(tmp_path)
    rooms = np.array([spec.room.layout for spec in dataset.specs()])
    trained, held = hold_out([dataset], max_validation=40)
    assert not set(rooms[trained]) & set(rooms[held])
    assert len(held) >= HELD_OUT_SHARE * len(rooms)
    assert sorted([*trained, *held]) == list(range(len(rooms)))
    assert len(set(rooms[held])) == 1, "no more rooms than are needed"


def test_a_room_that_is_held_out_of_one_dataset_is_held_out_of_all(tmp_path: Path) -> None:
    first = tiny_dataset(tmp_path / "first")
    second = replace(first)
    rooms = np.array([spec.room.layout for spec in first.specs()] * 2)
    trained, held = hold_out([first, second], max_validation=80)
    assert sorted([*trained, *held]) == list(range(80))
    assert not set(rooms[trained]) & set(rooms[held])
    assert {index % 40 for index in held if index < 40} == {index % 40 for index in held if index >= 40}


def test_images_of_the_studio_are_not_held_out_as_one_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = tiny_dataset(tmp_path)
    placeless = [SimpleNamespace(room=SimpleNamespace(layout=-1)) for _ in range(40)]
    monkeypatch.setattr(type(dataset), "specs", lambda self: placeless)
    trained, held = hold_out([dataset], max_validation=40)
    assert HELD_OUT_SHARE * 40 <= len(held) <= HELD_OUT_SHARE * 40 + 1 and len(trained) + len(held) == 40


def test_what_is_not_validated_on_is_not_trained_on_either(tmp_path: Path) -> None:
    """At most two photos of the room that is held out are looked at; the others are left out."""
    dataset = tiny_dataset(tmp_path)
    rooms = np.array([spec.room.layout for spec in dataset.specs()])
    trained, held = hold_out([dataset], max_validation=2)
    assert len(held) == 2 and len(trained) == 35
    assert not set(rooms[trained]) & set(rooms[held])


def test_a_single_room_gives_its_last_tenth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = tiny_dataset(tmp_path)
    first = dataset.specs()[0]
    monkeypatch.setattr(InMemory, "specs", lambda self: [first] * len(self))
    trained, held = hold_out([dataset], max_validation=40)
    assert held.tolist() == [36, 37, 38, 39] and trained.tolist() == list(range(36))
