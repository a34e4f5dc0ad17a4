"""What the path-traced tier costs and how noisy it is: `python -m benchmarks.cycles`.

Needs Blender (docs/cycles.md). Prints seconds per scene for one worker of two threads and for two workers of
one, then, for some numbers of samples, the error of the pictures and of the light against pictures of many
samples. Processor seconds are the worker's; they suffer less than the wall clock from what else runs.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from pathlib import Path

import numpy as np

from benchmarks.report import metric, report, write
from vig.scene import ObjectClass, srgb_from_linear
from vig_world.composition.sampling import sample
from vig_world.library import Library
from vig_world.renderers.cycles import CyclesRenderer, renderer

SEED = 5
SAMPLES = (16, 32, 64)
MANY = 512
PROBES = ((32, 16), (32, 64), (64, 8), (64, 16))
REFERENCE_PROBE = (128, 64)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=20, help="for the times")
    parser.add_argument("--compared", type=int, default=4, help="scenes for the errors; 0 for none")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    metrics = []
    for workers, threads in ((1, 2), (2, 1)):
        began = time.perf_counter()
        shares = [(range(start, arguments.scenes, workers), threads) for start in range(workers)]
        with multiprocessing.get_context("spawn").Pool(workers) as pool:
            spent = [seconds for share in pool.map(timed, shares, chunksize=1) for seconds in share]
        wall = (time.perf_counter() - began) / arguments.scenes
        name = f"workers{workers}_threads{threads}"
        metrics.append(metric(f"cycles_s_per_image_{name}", [wall], "s"))
        metrics.append(metric(f"cycles_cpu_s_per_image_{name}", spent, "s"))
    metrics += errors(arguments.compared) if arguments.compared else []
    for found in metrics:
        print(f"{found['name']:40} {found['value']:8} {found['unit']}")
    if arguments.json:
        write(report(metrics, 2), arguments.json)


def timed(share: tuple[range, int]) -> list[float]:
    """Processor seconds of the worker for each scene."""
    indices, threads = share
    library, teapot = Library("train"), ObjectClass.load("teapot")
    spent = []
    with CyclesRenderer(library, teapot, threads=threads) as cycles:
        for index in indices:
            cycles.render(sample(library, teapot, SEED, index))
            spent.append(cycles.timing["cpu_s"])
    return spent


def errors(count: int) -> list[dict]:
    """Root mean square error of pictures, in 8-bit levels, and largest of a light's nine, per cent of L00."""
    library, teapot = Library("train"), ObjectClass.load("teapot")
    specs = [sample(library, teapot, SEED, index) for index in range(count)]
    standard = renderer.PROBE_HEIGHT, renderer.PROBE_SAMPLES
    renderer.PROBE_HEIGHT, renderer.PROBE_SAMPLES = REFERENCE_PROBE
    with CyclesRenderer(library, teapot, samples=MANY, threads=2) as cycles:
        references = [cycles.render(spec) for spec in specs]
    found = []
    for samples in SAMPLES:
        renderer.PROBE_HEIGHT, renderer.PROBE_SAMPLES = standard
        with CyclesRenderer(library, teapot, samples=samples, threads=2) as cycles:
            linear = [cycles.render(spec).linear for spec in specs]
        pairs = zip(linear, references, strict=True)
        apart = [255 * (srgb_from_linear(a) - srgb_from_linear(b.linear)) for a, b in pairs]
        rms = [float(np.sqrt((difference**2).mean())) for difference in apart]
        found.append(metric(f"picture_rms_{samples}_samples", rms, "levels"))
    for height, samples in PROBES:
        renderer.PROBE_HEIGHT, renderer.PROBE_SAMPLES = height, samples
        with CyclesRenderer(library, teapot, samples=1, threads=2) as cycles:
            lights = [cycles.render(spec).light for spec in specs]
        pairs = zip(lights, references, strict=True)
        off = [100 * float(np.abs(a - b.light).max() / b.light[0]) for a, b in pairs]
        found.append(metric(f"light_error_probe_{height}_rows_{samples}_samples", off, "% of L00"))
    return found


if __name__ == "__main__":
    main()
