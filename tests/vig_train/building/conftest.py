"""A class that is built once for all tests of building."""

from pathlib import Path

import pytest

from tests.vig_train.building.things import folder_of_finned
from vig_train.building import BuildResult, BuildSettings, build_class

SETTINGS = BuildSettings("finned", vertices=300, length=0.3, shows="the fin")


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Meshes of finned boxes, of a ball, and a text."""
    return folder_of_finned(tmp_path_factory.mktemp("meshes") / "finned")


@pytest.fixture(scope="session")
def built(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[BuildResult, Path]:
    """A class of the finned boxes, and its pack."""
    pack = tmp_path_factory.mktemp("packs") / "finned"
    return build_class(folder, pack, SETTINGS, lambda line: None), pack
