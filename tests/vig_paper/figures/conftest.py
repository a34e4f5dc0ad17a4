"""Figures caught before they are written."""

from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest


@pytest.fixture()
def caught(monkeypatch: pytest.MonkeyPatch) -> Callable[[ModuleType], list[Any]]:
    """The list into which a module's figures go, besides to their file."""

    def watch(module: ModuleType) -> list[Any]:
        figures: list[Any] = []
        save = module.save

        def catch(figure, path):
            figures.append(figure)
            return save(figure, path)

        monkeypatch.setattr(module, "save", catch)
        return figures

    return watch
