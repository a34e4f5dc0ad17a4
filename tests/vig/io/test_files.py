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


def test_a_full_disk_is_one_line_for_the_user(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"^cannot write .*result\.png: the disk is full; free .*\.$"):
        with atomic_write(tmp_path / "result.png") as temporary:
            temporary.write_bytes(b"half")
            raise OSError(errno.ENOSPC, "No space left on device")
    assert os.listdir(tmp_path) == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the always-full device of Linux")
def test_the_operating_systems_own_full_disk_is_recognised(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="the disk is full"), atomic_write(tmp_path / "result.png"):
        Path("/dev/full").write_bytes(b"anything")
    with pytest.raises(UserError, match="the disk is full"), atomic_write(tmp_path / "result.safetensors"):
        raise SafetensorError("I/O error: No space left on device (os error 28)")
    with pytest.raises(SafetensorError), atomic_write(tmp_path / "result.safetensors"):
        raise SafetensorError("of another kind")


def test_a_parent_that_is_a_file_is_the_users_error(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    with (
        pytest.raises(UserError, match="a file, not a folder"),
        atomic_write(tmp_path / "plain" / "out.json"),
    ):
        pytest.fail("the block must not run")
    with pytest.raises(UserError, match="a file, not a folder"):
        with atomic_write(tmp_path / "plain" / "deep" / "out.json"):
            pytest.fail("the block must not run")


def test_a_folder_in_the_way_is_the_users_error(tmp_path: Path) -> None:
    (tmp_path / "out.json").mkdir()
    with pytest.raises(UserError, match="a folder of that name"), atomic_write(tmp_path / "out.json"):
        pytest.fail("the block must not run")


def test_other_errors_of_the_block_pass_unchanged(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), atomic_write(tmp_path / "out.json"):
        (tmp_path / "missing.txt").read_text()


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


def test_a_folder_where_a_file_is_in_the_way_is_the_users_error(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    with pytest.raises(UserError, match="a file, not a folder"), atomic_folder(tmp_path / "plain" / "folder"):
        pytest.fail("the block must not run")
    with pytest.raises(UserError, match="cannot write"), atomic_folder(tmp_path / "plain"):
        pass
    assert os.listdir(tmp_path) == ["plain"]


def test_arrays_are_read_as_they_are_indexed_however_they_lie_in_memory(tmp_path: Path) -> None:
    moved = np.moveaxis(np.arange(24.0).reshape(2, 3, 4), 0, 2)
    assert not moved.flags.c_contiguous
    write_arrays(tmp_path / "a.safetensors", {"moved": moved, "every other": moved[::2]}, {"of": "a test"})
    read, metadata = read_tensors(tmp_path / "a.safetensors")
    assert np.array_equal(read["moved"], moved) and np.array_equal(read["every other"], moved[::2])
    assert metadata == {"of": "a test"}
