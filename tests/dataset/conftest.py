from __future__ import annotations

from pathlib import Path

import pytest

from vig.dataset import Dataset, make_dataset, read_dataset
from vig.scene import ObjectClass


@pytest.fixture(scope="session")
def teapot() -> ObjectClass:
    return ObjectClass.load("teapot")


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory, teapot: ObjectClass) -> Path:
    """A small dataset made by one worker."""
    out = tmp_path_factory.mktemp("dataset") / "one"
    return make_dataset(out, count=10, seed=5, workers=1, progress=False, object_class=teapot)


@pytest.fixture(scope="session")
def dataset(made: Path) -> Dataset:
    return read_dataset(made)
