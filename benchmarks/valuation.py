"""Where the time of a valuation goes, and what bounds it: `python -m benchmarks.valuation [--photos N]`.

One core, packaged teapot, fitted poses of the raster generator's photos (test split), at full and half size.
By kernel: microseconds while all it reads is in the cache, and per unit of its work, which is counted. Then
all kernels with a warm cache and with one that holds other things, and a whole valuation of a search. Beside
these the arithmetic that can be counted exactly, that of the linear algebra, over the rate of a product of
such matrices, and the bytes that are read at least, over the rate at which they come.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from benchmarks import inputs
from vig.inference import ExplainSettings, explain_one, resolve
from vig.inference.objective import Objective
from vig.inference.posterior import objectives_of
from vig.likelihood.passes import Pass
from vig.recognition import Recognizer
from vig.scene import ObjectClass
from vig.scene.light import L_COUNT
from vig.search import Budget, LevenbergMarquardt
from vig_renderer import NOTHING

REPEATS = 20
OTHERS = 64 << 20
"""Bytes that are read between valuations, so that the cache holds nothing of them."""
KERNELS = (
    *("look", "place", "rasterize_faces", "collect_edges", "use_seen", "shade", "interior", "interior_rows"),
    *("boundary", "unshade", "add_values", "assemble"),
)
"""Of a valuation with gradient and normal matrix, in their order."""
PARTS = (KERNELS[0], "combine", *KERNELS[1:-1], "project", "square", KERNELS[-1])
"""With the products by components and rows."""
UNITS = {
    "place": "vertices",
    "rasterize_faces": "faces",
    "collect_edges": "edges",
    "use_seen": "pixels",
    "shade": "vertices used",
    "interior": "pixels covered",
    "interior_rows": "rows",
    "boundary": "rows",
    "unshade": "vertices used",
}


@dataclass(frozen=True)
class Point:
    """A fitted point (1, P') of an objective, and a pass that holds its photo."""

    objective: Objective
    place: torch.Tensor
    sigma: float
    run: Pass

    def begin(self) -> None:
        """Clear the pass as a valuation does, and set its point."""
        run = self.run
        run.points.copy_(self.place)
        run.albedo.copy_(run._blocks["albedo"])
        run.keys.fill_(NOTHING)
        for cleared in run._cleared:
            cleared.zero_()

    def parts(self) -> Iterator[tuple[str, Callable[[], object]]]:
        """Kernels and products in their order."""
        run, positions = self.run, self.run.geometry.positions
        on_world, rows = run.on_world.view(1, -1), run.rows[0]
        program = dict(zip(KERNELS, [run._look, *run._program(2, False), run._assemble], strict=True))
        products = {
            "combine": lambda: torch.mm(run._with_one, positions, out=run.world.view(1, -1)),
            "project": lambda: torch.mm(on_world, positions[1:].T, out=run.shape_gradient),
            "square": lambda: torch.mm(
                rows[: int(run.row_counts)].T, rows[: int(run.row_counts)], out=run.products[0]
            ),
        }
        for name in PARTS:
            yield name, (program | products)[name]

    def work(self) -> dict[str, int]:
        """Units of work of the last valuation."""
        run, geometry = self.run, self.run.geometry
        return {
            "vertices": geometry.vertex_count,
            "faces": len(geometry.faces),
            "edges": len(geometry.edges),
            "pixels": run.keys.shape[1],
            "vertices used": int((run.used > 0).sum()),
            "vertices seen": int((run.used > 1).sum()),
            "pixels covered": int((run.keys < NOTHING).sum()),
            "rows": int(run.row_counts.sum()),
        }

    def arithmetic(self, work: dict[str, int]) -> int:
        """Multiplications and additions of the products with components, transfer and rows."""
        geometry = self.run.geometry
        shape, width = geometry.rows.shape, geometry.rows.width
        products = 2 * 2 * (geometry.rows.modes + 1) * 3 * work["vertices"]
        transfer = 2 * 2 * L_COUNT * shape * work["vertices used"] * geometry.shadowed
        rings = 2 * 6 * 3 * shape * work["vertices seen"]  # of a vertex's six neighbours, on average
        rows = 2 * 3 * width * work["rows"]  # of a face's three corners
        return products + transfer + rings + rows + width * (width + 1) * work["rows"]

    def least_bytes(self, work: dict[str, int]) -> int:
        """That are read at least once: components, transfer, faces, edges, the photo and its prior."""
        geometry, run = self.run.geometry, self.run
        number = run.points.element_size()
        tables = (
            geometry.positions.numel()
            + (3 + L_COUNT * geometry.shadowed) * geometry.rows.shape * (work["vertices used"])
        )
        faces = 4 * (geometry.faces.numel() + geometry.edges.numel())
        return number * tables + faces + number * 6 * work["pixels covered"] + 8 * work["pixels"]


def points(count: int, scale: float, seed: int = 0) -> Iterator[Point]:
    """Fits of `count` photos, with the settings of photographs."""
    teapot = ObjectClass.load("teapot")
    arguments = argparse.Namespace(dataset=None, count=count, seed=seed)
    photos = inputs.chosen(arguments, teapot)[0]
    prediction = Recognizer.of_class(teapot)(photos)
    settings = resolve(ExplainSettings(), teapot, photo=True)
    for number in range(count):
        photo, guess = photos[number], prediction[number : number + 1]
        fit = explain_one(photo, guess, teapot, settings)
        objective = objectives_of(photo, guess, teapot, settings, (scale,))[scale]
        with objective.likelihood._pass(1) as run:
            run.photo.fill_(0)
            run.sigma.fill_(settings.likelihood.sigma)
            place = objective.point(fit.latents, fit.framing[None])
        # Nobody else borrows the pass before the next photo.
        yield Point(objective, place, settings.likelihood.sigma, run)


def rates() -> tuple[float, float]:
    """Operations a nanosecond in a matrix product, and bytes a nanosecond from beyond the cache."""
    left, right = torch.rand(2048, 32), torch.rand(2048, 32)
    operations = 2 * left.shape[0] * 32 * 32 / min(_times(lambda: left.T @ right))
    far = torch.rand(OTHERS // 4)
    return operations, OTHERS / min(_times(lambda: far.sum()))


def _times(call: Callable[[], object]) -> list[float]:
    """Nanoseconds of each of several calls."""
    found = []
    for _ in range(REPEATS):
        started = time.perf_counter_ns()
        call()
        found.append(float(time.perf_counter_ns() - started))
    return found


def measure(count: int, scale: float) -> None:
    """Print one size's tables."""
    by_kernel: dict[str, list[float]] = defaultdict(list)
    work: dict[str, list[int]] = defaultdict(list)
    whole: dict[str, list[float]] = defaultdict(list)
    bounds: dict[str, list[float]] = defaultdict(list)
    operations, stream = rates()
    others = torch.rand(OTHERS // 4)
    for point in points(count, scale):
        for _ in range(REPEATS):
            point.begin()
            for name, launch in point.parts():
                started = time.perf_counter_ns()
                launch()
                by_kernel[name].append(time.perf_counter_ns() - started)
        counted = point.work()
        for name, number in counted.items():
            work[name].append(number)
        bounds["arithmetic"].append(point.arithmetic(counted) / operations)
        bounds["bytes from beyond the cache"].append(point.least_bytes(counted) / stream)
        for name, evict in (("all, warm", False), ("all, cold", True)):
            for _ in range(REPEATS):
                whole[name].append(_valuation(point, others if evict else None))
    for point in points(count, scale):
        whole["in a search"].append(_in_a_search(point))
    units = {name: float(np.median(numbers)) for name, numbers in work.items()}
    print(f"\nat {scale:g} of the size: " + ", ".join(f"{units[name]:.0f} {name}" for name in units))
    for name in PARTS:
        spent, unit = float(np.median(by_kernel[name])), UNITS.get(name)
        each = f", {spent / units[unit]:.1f} ns for each of the {unit}" if unit else ""
        print(f"  {name:16} {spent / 1000:6.1f} us{each}")
    for name, times in whole.items():
        print(f"  {name:16} {np.median(times) / 1000:6.1f} us")
    for name, least in bounds.items():
        print(f"  {name} alone {np.median(least) / 1000:6.1f} us")


def _in_a_search(point: Point) -> float:
    """Nanoseconds of each valuation of a search, step and acceptance included."""
    photo, taken = torch.zeros(1, dtype=torch.int32), []
    for _ in range(3):
        started = time.perf_counter_ns()
        found = LevenbergMarquardt()(point.objective, point.place, photo, point.sigma, Budget(8, 0.0))
        taken.append((time.perf_counter_ns() - started) / int(found.evaluations))
    return min(taken)


def _valuation(point: Point, others: Any) -> float:
    """Nanoseconds of all parts of a valuation, after `others` were read."""
    point.begin()
    if others is not None:
        others.sum()
    started = time.perf_counter_ns()
    for _, launch in point.parts():
        launch()
    return float(time.perf_counter_ns() - started)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--photos", type=int, default=12)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    operations, stream = rates()
    print(f"this core: {operations:.0f} operations and {stream:.1f} bytes a nanosecond")
    for scale in (1.0, 0.5):
        measure(arguments.photos, scale)


if __name__ == "__main__":
    main()
