"""Files that the maker of a dataset writes."""

from pathlib import Path

from vig_world.generation.files import write_picture


def test_a_picture_takes_the_place_of_what_is_there(tmp_path: Path) -> None:
    """Half a file that a killed run left, and a link, which is not followed."""
    whole, half, link, other = (tmp_path / name for name in ("new/a.png", "b.png", "c.png", "other"))
    half.write_bytes(b"hal")
    other.write_bytes(b"mine")
    link.symlink_to(other)
    for path in (whole, half, link):
        write_picture(path, b"picture")
        assert path.read_bytes() == b"picture" and not path.is_symlink()
    assert other.read_bytes() == b"mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.png", "c.png", "new", "other"]
