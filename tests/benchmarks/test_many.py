"""The files that are no photos: each is refused, with a line that names it."""

from pathlib import Path

import pytest
from PIL import Image

from benchmarks.many import BROKEN, add_broken
from vig.io.errors import UserError
from vig.photo.images import coded_photo
from vig_app.cli.photos import photos_of


def test_every_broken_file_is_refused_and_none_is_waited_for(tmp_path: Path) -> None:
    Image.new("RGB", (64, 64), (90, 120, 30)).save(tmp_path / "0.jpg")
    names = add_broken(tmp_path)
    assert len(set(names)) == BROKEN
    refused = {}
    for photo in photos_of((tmp_path,), tmp_path):
        if photo.name != "0.jpg":
            with pytest.raises(UserError) as told:
                coded_photo(photo)
            refused[photo.name] = str(told.value)
    assert refused.keys() == set(names)
    assert all(str(UserError(name)) in reason and "\n" not in reason for name, reason in refused.items())
