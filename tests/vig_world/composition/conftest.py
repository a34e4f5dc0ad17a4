"""The assets of the validation split, for all tests of composition but those that name another."""

import pytest

from vig_world.library import Library


@pytest.fixture(scope="session")
def library() -> Library:
    return Library("validation")
