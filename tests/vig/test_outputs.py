"""The core explains photos without the application, and finds what that makes by entry points."""

import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from vig import outputs
from vig.io.errors import UserError
from vig_app.examples import FOLDER

ALONE = """
import sys, vig
explanation = vig.Explainer("teapot").explain(sys.argv[1], box=(30, 35, 90, 90))
explanation.to_dict(), explanation.render(), explanation.mask, explanation.pinhole_pose()
print([name for name in sys.modules if name.startswith("vig_app")])
"""


def test_a_photo_is_explained_without_the_application() -> None:
    command = [sys.executable, "-c", ALONE, str(FOLDER / "02_egg_cup.png")]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "[]\n"


def test_every_output_has_a_function() -> None:
    with open(Path(__file__).parents[2] / "pyproject.toml", "rb") as file:
        points = tomllib.load(file)["project"]["entry-points"][outputs.GROUP]
    assert {"save", "export", "report", "overlay", "panels", "scene_save", "scene_overlay"} == points.keys()
    assert all(callable(EntryPoint(name, value, outputs.GROUP).load()) for name, value in points.items())


def test_an_output_that_no_package_makes_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nothing is registered, and where the metadata name a package that is not there."""
    missing = EntryPoint("poster", "vig_posters:poster", outputs.GROUP)
    for points in ((), (missing,)):
        monkeypatch.setattr(outputs, "entry_points", lambda points=points, **_: points)
        with pytest.raises(UserError, match="expected the package vig_app, which makes 'poster'"):
            outputs.output("poster")
