"""A run whose steps only record that they were done."""

from collections.abc import Callable
from pathlib import Path

import pytest

from vig_paper.reproduction import Run, RunFolder, work
from vig_paper.settings import ReproductionSettings


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Steps that leave an empty product and their name in this list."""
    names: list[str] = []

    def leave(name: str, product: Callable[..., Path]) -> Callable[..., None]:
        def step(run: Run, *about: str) -> None:
            names.append(" ".join((name, *about)))
            path = product(run, *about)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()

        return step

    products: dict[str, tuple[str, Callable[..., Path]]] = {
        "make_data": ("data", lambda run, name: run.dataset_folder(name) / "info.json"),
        "train": ("train", lambda run: run.folder.weights),
        "take_weights": ("train", lambda run: run.folder.weights),
        "calibrate": ("calibrate", lambda run: run.folder.weights),
        "evaluate": ("evaluate", lambda run, renderer: run.folder.tables(renderer)),
        "ablate": ("ablations", lambda run: run.folder.ablations),
        "draw_figures": ("figures", lambda run, renderer: run.folder.figures(renderer)),
    }
    for function, (name, product) in products.items():
        monkeypatch.setattr(work, function, leave(name, product))
    return names


@pytest.fixture
def begin(tmp_path: Path) -> Callable[..., Run]:
    """A run in a folder of its own, with chosen settings and renderers."""

    def begun(renderers: tuple[str, ...] = ("raster",), workers: int | None = None, **chosen) -> Run:
        class Fixed(Run):
            def renderers(self) -> tuple[str, ...]:
                return renderers

        settings = ReproductionSettings.of("tiny", **chosen)
        return Fixed(RunFolder(tmp_path / "run"), settings, workers=workers, report=lambda line: None)

    return begun
