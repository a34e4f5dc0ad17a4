"""What is read from others' files is bounded and typed, and every refusal is one line."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
import pytest
import torch
from safetensors.numpy import save_file

from vig.io.checks import (
    check_arrays,
    check_indices,
    check_number,
    decode,
    parse_json,
    read_bytes,
    read_json,
    read_tensors,
    reading,
)
from vig.io.errors import UserError
from vig_world.dataset.format import inside


@dataclass(frozen=True)
class Leaf:
    name: str
    sizes: tuple[int, int]


@dataclass(frozen=True)
class Tree:
    leaves: tuple[Leaf, ...]
    kind: Literal["a", "b"]
    weight: float
    counts: dict[str, int]
    note: str | None = None


TREE: dict[str, Any] = {
    "leaves": [{"name": "x", "sizes": [1, 2]}],
    "kind": "a",
    "weight": 2,
    "counts": {"of": 3},
}


@pytest.mark.parametrize(
    ("raised", "came"),
    [
        (FileNotFoundError(2, "No such file"), "nothing of that name"),
        (PermissionError(13, "Permission denied"), r"a file that cannot be read \(Permission denied\)"),
        (RecursionError(), r"a damaged file \(nested too deeply\)"),
        (MemoryError(), "a file too large for the memory"),
        (msgspec.ValidationError("Expected `array`"), r"something else \(Expected `array`\)"),
        (KeyError("scale"), r"a damaged file \(without 'scale'\)"),
        (ValueError("of 3\nlines\nin all"), r"a damaged file \(of 3\)"),
        (ZeroDivisionError(), r"a damaged file \(ZeroDivisionError\)"),
    ],
)
def test_what_goes_wrong_is_one_line(raised: Exception, came: str) -> None:
    with pytest.raises(UserError, match=f"^expected a map at 'm.json'; got {came}. Draw it again.$"):
        with reading("m.json", "a map", "Draw it again."):
            raise raised


def test_an_error_for_the_user_and_an_interruption_pass() -> None:
    assert str(UserError("expected a photo;\n  got\ta folder.")) == "expected a photo; got a folder."
    assert issubclass(UserError, ValueError)
    for raised in (UserError("as it is"), KeyboardInterrupt("as it is")):
        with pytest.raises(type(raised), match="^as it is$"), reading("m", "a map", "Draw it."):
            raise raised


def test_a_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    (tmp_path / "f").write_bytes(b"12345")
    assert read_bytes(tmp_path / "f", 5) == b"12345"
    with pytest.raises(ValueError, match="5 bytes where at most 4"):
        read_bytes(tmp_path / "f", 4)


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, lambda path: os.symlink("/dev/zero", path)])
def test_only_files_are_read(make: Callable[[Path], None], tmp_path: Path) -> None:
    """A pipe would wait for its writer, /dev/zero has no end."""
    make(tmp_path / "f")
    with pytest.raises((ValueError, IsADirectoryError)):
        read_bytes(tmp_path / "f")
    with pytest.raises(ValueError, match="not a file"):
        read_tensors(tmp_path / "f")


@pytest.mark.parametrize(
    "text", ["[" * 100_000, "NaN", "[1, -Infinity]", "1e999", "{", "", b"\xff", "9" * 5000]
)
def test_json_that_is_none(text: str | bytes) -> None:
    with pytest.raises(ValueError):
        parse_json(text)


def test_json_is_read_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "f").write_text('{"a": [1, 2.5, null, "\\u00e9"]}')
    assert read_json(tmp_path / "f") == {"a": [1, 2.5, None, "é"]}


def test_tensors_must_be_finite_unless_they_need_not(tmp_path: Path) -> None:
    array = np.array([1, np.nan], np.float32)
    save_file({"a": array}, tmp_path / "f", {"told": "x"})
    for framework in ("np", "pt"):
        with pytest.raises(ValueError, match="'a' has numbers that are not finite"):
            read_tensors(tmp_path / "f", framework)  # type: ignore[arg-type]
    held, told = read_tensors(tmp_path / "f", finite=False)
    np.testing.assert_array_equal(held["a"], array)
    assert told == {"told": "x"}
    with pytest.raises(ValueError, match="where at most 10 are read"):
        read_tensors(tmp_path / "f", most=10)


def test_arrays_are_checked_against_each_other() -> None:
    expected = {"a": ("float32", ("N", 3)), "b": ("int32 int64", ("N",))}
    arrays: dict[str, np.ndarray] = {"a": np.zeros((4, 3), np.float32), "b": np.zeros(4, np.int64)}
    assert check_arrays(arrays, expected) == {"N": 4}
    for change, why in (
        ({"b": np.zeros(5, np.int64)}, r"b must be \(4\); it is \(5,\)"),
        ({"b": np.zeros(4)}, "b must be int32 or int64; it is float64"),
        ({"a": np.zeros((4, 2), np.float32)}, r"a must be \(4, 3\); it is \(4, 2\)"),
        ({"a": np.zeros(4, np.float32)}, r"a must be \(N, 3\); it is \(4,\)"),
    ):
        with pytest.raises(ValueError, match=why):
            check_arrays(arrays | change, expected)
    with pytest.raises(ValueError, match="'b' is missing"):
        check_arrays({"a": arrays["a"]}, expected)


@pytest.mark.parametrize("of", [np.array, torch.tensor])
def test_indices_lie_in_their_range(of: Callable) -> None:
    check_indices("faces", of([[0, 4]]), 5)
    check_indices("faces", of([[-1, 4]]), 5, -1)
    check_indices("faces", of([]), 0)
    for wrong in ([0, 5], [-1, 2]):
        with pytest.raises(ValueError, match="faces must be from 0 to 4; they are from"):
            check_indices("faces", of(wrong), 5)


@pytest.mark.parametrize("value", [True, None, "1", [1], 11, -1, float("nan"), float("inf"), 2**70])
def test_a_number_of_the_right_size(value: Any) -> None:
    assert check_number("x", 10, 0, 10) == 10
    with pytest.raises(ValueError, match="x must be a number from 0 to 10; it is"):
        check_number("x", value, 0, 10)


def test_names_stay_inside(tmp_path: Path) -> None:
    root = tmp_path / "root"
    (root / "a").mkdir(parents=True)
    (tmp_path / "rooted").mkdir()  # the same beginning, another folder
    (root / "a" / "near").symlink_to(root / "b")
    (root / "a" / "far").symlink_to(tmp_path / "rooted")
    (root / "up").symlink_to("..")
    assert inside(root, "a/b.png") == root / "a" / "b.png"
    assert inside(root, "a/near") == root / "a" / "near"
    for name in (
        "/etc/passwd",
        "../rooted/x",
        "a/../../x",
        "a/far",
        "a/far/x",
        "up/root2",
        "a\0b",
        "",
        "a/../b",
        root / "a",
    ):
        with pytest.raises(ValueError, match="leads out of its folder"):
            inside(root, name)
    (tmp_path / "link").symlink_to(root)  # the folder itself may be one
    assert inside(tmp_path / "link", "a/b.png") == tmp_path / "link" / "a" / "b.png"


def test_json_becomes_the_types_of_a_dataclass() -> None:
    assert decode(Tree, TREE) == Tree((Leaf("x", (1, 2)),), "a", 2, {"of": 3})
    assert decode(Tree, TREE | {"note": "n"}).note == "n"


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"leaves": {}}, "Expected `array`, got `object` - at `.*leaves`"),
        ({"leaves": [{"name": "x", "sizes": [1]}]}, "Expected `array` of length 2, got 1 - at `.*sizes`"),
        ({"leaves": [{"name": 1, "sizes": [1, 2]}]}, "Expected `str`, got `int` - at `.*leaves.*name`"),
        ({"leaves": [{"name": "x", "sizes": [1, True]}]}, "Expected `int`, got `bool` - at `.*sizes.*`"),
        ({"leaves": [{"name": "x"}]}, "Object missing required field `sizes`"),
        ({"kind": "c"}, "Invalid enum value 'c' - at `.*kind`"),
        ({"kind": ["a"]}, "Expected `str`, got `array` - at `.*kind`"),
        ({"weight": "2"}, "Expected `float`, got `str` - at `.*weight`"),
        ({"weight": 1e300}, "Expected a number of ordinary size, got .* - at `.*weight`"),
        ({"counts": {"of": 2**70}}, "Expected a number of ordinary size, got .* - at `.*counts.of`"),
        ({"counts": []}, "Expected `object`, got `array` - at `.*counts`"),
        ({"note": 3}, "Expected .*, got `int` - at `.*note`"),
        ({"more": 1}, "Object contains unknown field `more`"),
    ],
)
def test_what_is_not_of_a_type_is_named(change: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        decode(Tree, TREE | change)
