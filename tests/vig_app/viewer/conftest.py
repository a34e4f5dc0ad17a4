"""A photo that is open in `vig view`, explained once for all tests."""

import copy
from collections.abc import Iterator
from pathlib import Path

import pytest
from PIL import Image

import vig
from vig_app.examples import example_photos
from vig_app.viewer import Session
from vig_app.viewer.server import Viewer
from vig_app.viewer.walk import Walk


def large_photo(path: Path, number: int = 3) -> Path:
    """An example in the middle of a larger photo."""
    large = Image.new("RGB", (400, 300), (120, 120, 120))
    with Image.open(example_photos()[number].photo) as small:
        large.paste(small, (120, 70))
    large.save(path)
    return path


@pytest.fixture(scope="session")
def opened(explainer: vig.Explainer, tmp_path_factory: pytest.TempPathFactory) -> Session:
    return Session(explainer, large_photo(tmp_path_factory.mktemp("opened") / "photo.png"))


@pytest.fixture
def session(opened: Session) -> Session:
    """The photo as it was opened, of which a test may make states of its own."""
    own = copy.copy(opened)
    own.states = [*opened.states]
    return own


@pytest.fixture
def viewer(session: Session, tmp_path: Path) -> Iterator[Viewer]:
    walk = Walk.of_photo(session.path, "teapot", tmp_path / "saved")
    walk._ahead = 0, session  # as if it had been fitted in advance
    served = Viewer(walk, port=8441)
    yield served
    served.stop()
