import errno
import os
from pathlib import Path

import numpy as np
import pytest
from safetensors import SafetensorError

from vig.io.checks import read_tensors
from vig.io.errors import UserError
from vig.io.files import atomic_folder, atomic_write, write_arrays


def test_the_file_appears_only_when_the_block_ends_and_nothing_else_stays(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "result.json"
    with atomic_write(path) as temporary:
        temporary.write_text("{}")
        assert not path.exists()
        assert temporary.parent == path.parent and temporary.suffix == ".json"
    assert path.read_text() == "{}"
    assert os.listdir(path.parent) == ["result.json"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_interrupted_block_leaves_the_old_file_and_no_rubbish(
    tmp_path: Path, error: type[BaseException]
) -> None:
    path = tmp_path / "result.json"
    path.write_text("old")
    with pytest.raises(error), atomic_write(path) as temporary:
        temporary.write_text("half")
        raise error
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["result.json"]


FULL = OSError(errno.ENOSPC, "No space left on device")
FULL_OF_TENSORS = SafetensorError("I/O error: No space left on device (os error 28)")
OTHER = SafetensorError("of another kind")


@pytest.mark.parametrize(
    ("error", "raised"),
    [(FULL, UserError), (FULL_OF_TENSORS, UserError), (OTHER, SafetensorError), (KeyError("a"), KeyError)],
)
def test_a_full_disk_is_one_line_for_the_user_and_other_errors_pass_unchanged(
    error: Exception, raised: type[Exception], tmp_path: Path
) -> None:
    words = r"^cannot write .*result\.png: the disk is full; free .*\.$" if raised is UserError else None
    with pytest.raises(raised, match=words), atomic_write(tmp_path / "result.png") as temporary:
        temporary.write_bytes(b"half")
        raise error
    assert os.listdir(tmp_path) == []


def test_a_file_or_folder_in_the_way_is_the_users_error(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    (tmp_path / "out.json").mkdir()
    for path, why in (
        ("plain/out.json", "a file, not a folder"),
        ("plain/deep/out.json", "a file, not a folder"),
        ("out.json", "a folder of that name"),
    ):
        with pytest.raises(UserError, match=why), atomic_write(tmp_path / path):
            pytest.fail("the block must not run")
    with pytest.raises(UserError, match="a file, not a folder"), atomic_folder(tmp_path / "plain" / "folder"):
        pytest.fail("the block must not run")
    with pytest.raises(UserError, match="cannot write"), atomic_folder(tmp_path / "plain"):
        pass
    assert sorted(os.listdir(tmp_path)) == ["out.json", "plain"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_folder_appears_whole_or_not_at_all(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "a" / "folder"
    with pytest.raises(error), atomic_folder(path) as temporary:
        (temporary / "half").write_text("")
        raise error
    assert os.listdir(path.parent) == []
    with atomic_folder(path) as temporary:
        (temporary / "file").write_text("")
        assert not path.exists() and temporary.parent == path.parent
    assert os.listdir(path.parent) == ["folder"] and os.listdir(path) == ["file"]


def test_a_folder_that_another_process_made_meanwhile_stays(tmp_path: Path) -> None:
    path = tmp_path / "folder"
    with atomic_folder(path) as temporary:
        (temporary / "mine").write_text("")
        path.mkdir()
        (path / "theirs").write_text("")
    assert os.listdir(tmp_path) == ["folder"] and os.listdir(path) == ["theirs"]


def test_arrays_are_read_as_they_are_indexed_however_they_lie_in_memory(tmp_path: Path) -> None:
    moved = np.moveaxis(np.arange(24.0).reshape(2, 3, 4), 0, 2)
    assert not moved.flags.c_contiguous
    write_arrays(tmp_path / "a.safetensors", {"moved": moved, "every other": moved[::2]}, {"of": "a test"})
    read, metadata = read_tensors(tmp_path / "a.safetensors")
    assert np.array_equal(read["moved"], moved) and np.array_equal(read["every other"], moved[::2])
    assert metadata == {"of": "a test"}
