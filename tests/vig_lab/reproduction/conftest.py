"""A run whose stages only write down that they were carried out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from vig_lab.reproduction import Run, RunFolder, Settings, stages


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Stages that leave an empty product and their name in this list."""
    names: list[str] = []

    def leave(name: str, product: Callable[..., Path]) -> Callable[..., None]:
        def work(run: Run, *about: str) -> None:
            names.append(" ".join((name, *about)))
            path = product(run, *about)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()

        return work

    products: dict[str, tuple[str, Callable[..., Path]]] = {
        "make_data": ("data", lambda run, name: run.dataset_folder(name) / "info.json"),
        "train": ("train", lambda run: run.folder.weights),
        "take_weights": ("train", lambda run: run.folder.weights),
        "calibrate": ("calibrate", lambda run: run.folder.weights),
        "evaluate": ("evaluate", lambda run, tier: run.folder.tables(tier)),
        "ablate": ("ablations", lambda run: run.folder.ablations),
        "draw_figures": ("figures", lambda run, tier: run.folder.figures(tier)),
    }
    for function, (name, product) in products.items():
        monkeypatch.setattr(stages, function, leave(name, product))
    return names


@pytest.fixture
def begin(tmp_path: Path) -> Callable[..., Run]:
    """A run in a folder of its own, with settings and tiers of one's choice."""

    def begun(tiers: tuple[str, ...] = ("raster",), workers: int | None = None, **chosen) -> Run:
        class Fixed(Run):
            def tiers(self) -> tuple[str, ...]:
                return tiers

        settings = Settings.of("tiny", **chosen)
        return Fixed(RunFolder(tmp_path / "run"), settings, workers=workers, say=lambda line: None)

    return begun
