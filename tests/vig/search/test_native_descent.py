"""Searches in native code beside the same in torch, and the steps of a valuation beside plain algebra."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import vig.search.levenberg_marquardt as module
from tests.support import points_of
from vig.inference import Objective
from vig.likelihood import Likelihood, Photos
from vig.search import Budget, LevenbergMarquardt
from vig.search.native_descent import (
    CLEAR,
    COMBINE,
    COPY,
    FILL,
    PROJECT,
    SQUARE,
    NativeProblem,
    Valuation,
    descend,
)


@dataclass
class Steps:
    """A problem without a value whose valuation takes given steps."""

    steps: list[tuple[int, ...]]
    size: int = 3
    dtype: torch.dtype = torch.float64
    device: str = "cpu"
    lower: torch.Tensor = field(init=False)
    upper: torch.Tensor = field(init=False)

    def __post_init__(self) -> None:
        self.lower, self.upper = (torch.full((self.size,), bound, dtype=self.dtype) for bound in (-9.0, 9.0))
        self.point, self.gradient = torch.zeros(2, self.size, dtype=self.dtype)
        self.value, self.normal = torch.zeros(1, dtype=torch.float64), torch.eye(self.size, dtype=self.dtype)

    def __call__(self, *_: object) -> None:
        raise AssertionError("native code values this")

    @contextmanager
    def valuation(self, photo: int, sigma: float, derivatives: bool = True) -> Iterator[Valuation | None]:
        yield Valuation(self.point, self.value, self.gradient[None], self.normal[None], self.steps, {})


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(("lines", "across"), [(1, 5), (4, 64), (17, 7908), (6, 131)])
def test_each_step_does_what_it_says(dtype: torch.dtype, lines: int, across: int) -> None:
    rng = np.random.default_rng(lines)

    def drawn(*shape: int) -> torch.Tensor:
        return torch.from_numpy(rng.normal(size=shape)).to(dtype)

    rows, weights, place = drawn(lines, across), drawn(lines), drawn(across)
    combined, projected = drawn(across), drawn(lines)
    table, filled, squared = drawn(100, 48), torch.tensor([70], dtype=torch.int32), drawn(48, 48)
    over, whole = torch.tensor([300], dtype=torch.int32), drawn(48, 48)
    keys, cleared, copied = torch.arange(10), torch.arange(9, dtype=torch.uint8), drawn(5)
    at = torch.Tensor.data_ptr
    problem = Steps(
        [
            (COMBINE, at(combined), at(weights), at(rows), lines, across),
            (PROJECT, at(projected), at(place), at(rows), lines, across),
            (SQUARE, at(squared), at(table), at(filled), 100, 48),
            (SQUARE, at(whole), at(table), at(over), 100, 48),
            (FILL, at(keys), 7, (1 << 63) - 1),
            (CLEAR, at(cleared), 8),
            (COPY, at(copied), at(table[3]), 4),
        ],
        dtype=dtype,
    )
    last = float(copied[4])
    assert isinstance(problem, NativeProblem)
    starts, photo = torch.zeros(1, 3, dtype=dtype), torch.zeros(1, dtype=torch.int32)
    assert descend(problem, starts, photo, 0.1, Budget(0, 1.0), 0.1, 1e4) is not None
    near = {"rtol": 0, "atol": (1e-4 if dtype is torch.float32 else 1e-12) * lines * across**0.5}
    torch.testing.assert_close(combined, weights @ rows, **near)
    torch.testing.assert_close(projected, rows @ place, **near)
    torch.testing.assert_close(squared, table[:70].T @ table[:70], rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(whole, table.T @ table, rtol=1e-4, atol=1e-4)
    assert keys.tolist() == [(1 << 63) - 1] * 7 + [7, 8, 9] and cleared.tolist() == [0] * 8 + [8]
    assert copied[:4].tolist() == table[3, :4].tolist() and float(copied[4]) == last


@pytest.mark.parametrize("threads", [1, 3])
def test_a_search_is_that_of_torch(studio, teapot, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """In double precision sums in another order stay far below what a search tells apart."""
    rng = np.random.default_rng(11)
    latents = studio.latents(rng, 5)
    log_prior = torch.from_numpy(np.log(rng.dirichlet((5, 2, 3), (2, 150, 150))))
    photos = Photos(torch.cat([studio.photo(rng, latents[:1]), studio.photo(rng, latents[1:2])]), log_prior)
    objective = Objective(Likelihood(studio.geometry, studio.camera, photos), teapot, free_framing=True)
    starts = objective.point(latents)
    starts[3] = starts[2]  # and alike
    photo = torch.ones(5, dtype=torch.int32)
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        for budget in (Budget(0, 1.0), Budget(4, 0.5), Budget(12, 20.0)):
            native = LevenbergMarquardt()(objective, starts, photo, 0.05, budget)
            with monkeypatch.context() as patch:
                patch.setattr(module, "descend", lambda *_: None)
                expected = LevenbergMarquardt()(objective, starts, photo, 0.05, budget)
            assert native.evaluations.tolist() == expected.evaluations.tolist()
            assert native.converged.tolist() == expected.converged.tolist()
            assert (native.normal is None) == (budget.iterations == 0)  # starts are only valued
            for name in ("points", "value", "path", *(["normal"] if budget.iterations else [])):
                one, other = getattr(native, name), getattr(expected, name)
                assert one.dtype == other.dtype and one.shape == other.shape, name
                torch.testing.assert_close(one, other, rtol=1e-5, atol=1e-6 * float(other.abs().max()))
    finally:
        torch.set_num_threads(before)
    assert expected.converged.any() and len(expected.path) > 5


def test_what_native_code_does_not_take_goes_the_long_way(studio, teapot) -> None:
    """Starts of several photos; wrong input is refused there by name."""
    rng = np.random.default_rng(2)
    latents = studio.latents(rng, 2)
    photos = Photos(studio.photo(rng, latents), torch.full((2, 150, 150, 3), -1.0, dtype=torch.float64))
    objective = Objective(Likelihood(studio.geometry, studio.camera, photos), teapot)
    starts, budget, search = points_of(latents), Budget(2, 1.0), LevenbergMarquardt()
    both = search(objective, starts, torch.arange(2, dtype=torch.int32), 0.05, budget)
    for number in range(2):
        alone = search(objective, starts[number : number + 1], torch.tensor([number]), 0.05, budget)
        torch.testing.assert_close(alone.points[0], both.points[number], rtol=1e-5, atol=1e-6)
    zero = torch.zeros(2, dtype=torch.int32)
    with pytest.raises(ValueError, match="photo must be indices of the 2 photos; got 7 to 7"):
        search(objective, starts, zero + 7, 0.05, budget)
    with pytest.raises(ValueError, match="sigma must be positive"):
        search(objective, starts, zero, -0.05, budget)
    for wrong, whose, why in (
        (starts[:, :-4], zero, "points must be"),
        (torch.cat([starts] * 200, 1), zero, "points must be"),
        (starts, zero[:1], "photo and sigma must be"),
        (starts, zero[:, None], "photo and sigma must be"),
        (starts, zero + 0.5, "photo must be whole numbers"),
    ):
        with pytest.raises(ValueError, match=why):
            search(objective, wrong, whose, 0.05, budget)
    starts[1, 4] = float("nan")
    with pytest.raises(ValueError, match="points must be finite; got nan in column 4 of point 1"):
        search(objective, starts, zero, 0.05, budget)


def test_a_subclass_that_values_otherwise_is_asked(studio, teapot) -> None:
    class Counting(Objective):
        calls = 0

        def __call__(self, *arguments: Any, **options: Any) -> Any:
            self.calls += 1
            return super().__call__(*arguments, **options)

    class Other(Likelihood):
        calls = 0

        def at(self, *arguments: Any, **options: Any) -> Any:
            self.calls += 1
            return super().at(*arguments, **options)

    rng = np.random.default_rng(4)
    latents = studio.latents(rng, 1)
    photos = Photos(studio.photo(rng, latents), torch.full((1, 150, 150, 3), -1.0, dtype=torch.float64))
    likelihood, other = (kind(studio.geometry, studio.camera, photos) for kind in (Likelihood, Other))
    photo, budget = torch.zeros(1, dtype=torch.int32), Budget(2, 0.0)
    for objective in (Counting(likelihood, teapot), Objective(other, teapot)):
        found = LevenbergMarquardt()(objective, points_of(latents), photo, 0.05, budget)
        asked = objective.calls if isinstance(objective, Counting) else other.calls
        assert asked == int(found.evaluations) > 1


def test_a_valuation_outlasts_others_of_its_thread(studio, teapot) -> None:
    """What is valued in between, also by another valuation, does not change what its launches write to."""
    rng = np.random.default_rng(6)
    latents = studio.latents(rng, 1)
    photos = Photos(studio.photo(rng, latents), torch.full((1, 150, 150, 3), -1.0, dtype=torch.float64))
    objective = Objective(Likelihood(studio.geometry, studio.camera, photos), teapot)
    with objective.valuation(0, 0.05) as one:
        assert one is not None
        before = [[*bytes_of(launch)] for launch in one.launches.values()]
        objective.of_one(points_of(latents), 0.05)
        with objective.valuation(0, 0.05) as other:
            assert other is not None and other.point.data_ptr() != one.point.data_ptr()
        assert [[*bytes_of(launch)] for launch in one.launches.values()] == before


def bytes_of(launch: Any) -> bytes:
    """The arguments of a recorded launch."""
    return ctypes.string_at(launch.addresses[2], ctypes.sizeof(launch.packed))


@pytest.mark.slow
def test_threads_of_a_new_process_load_no_kernels_at_once(tmp_path: Path) -> None:
    """Loading them side by side ends the process."""
    code = """
import torch, vig
from vig.inference import ExplainSettings, explain_one, resolve
from vig.photo import as_photo
from vig.recognition import Recognizer
from vig_app.examples import example_photos
torch.set_num_threads(4)
teapot = vig.ObjectClass.load("teapot")
pixels = torch.from_numpy(as_photo(example_photos()[1].photo))
prediction = Recognizer.of_class(teapot)(pixels[None])
print(explain_one(pixels, prediction, teapot, resolve(ExplainSettings(), teapot)).evaluations)
"""
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0 and int(done.stdout) > 20, done.stderr
