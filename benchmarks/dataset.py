"""How fast synthetic scenes are made, and whether memory stays flat: `python -m benchmarks.dataset`.

Makes a dataset in a temporary folder, as `vig dataset make` does, everything included: choosing rooms,
occluders and views, drawing, encoding and writing files. Two rates are printed: the whole call's, worker
processes' start and first assets included, and the steady one, of the last three quarters of the samples.
Then images are made in this process, twice each: `raster_image_ms` is the processor time of the second
time, when all assets are in memory, in blocks of `BLOCK`, files included.

For memory, the resident sizes of this process and its children are added up four times a second.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measuring import metric, report, write
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world import WORLDS, World
from vig_world.dataset.format import image_paths
from vig_world.generation.job import Job, Maker, store
from vig_world.generation.write import make_dataset
from vig_world.renderers.cycles.renderer import find_python

RASTER_COUNT, CYCLES_COUNT = 6000, 40
RUNS = 1
IMAGES, BLOCK = 300, 25
"""Images made in this process, and how many of them are timed at once."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, help="where to write the figures")
    parser.add_argument("--raster", type=int, default=RASTER_COUNT, help="samples of a raster run")
    parser.add_argument("--cycles", type=int, default=CYCLES_COUNT, help="path-traced samples; 0 for none")
    parser.add_argument("--runs", type=int, default=RUNS, help="raster runs; the median counts, 0: none")
    parser.add_argument("--images", type=int, default=IMAGES, help="made in one process; 0 for none")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--size", default="150x150", help="of images made in one process")
    parser.add_argument("--world", choices=WORLDS, default="paper", help="what scenes are like")
    arguments = parser.parse_args()
    if arguments.cycles:
        try:
            find_python()
        except UserError as error:
            parser.error(f"{error}, or pass --cycles 0")

    metrics: list[dict[str, Any]] = []
    world = arguments.world
    runs = [Run.of("raster", arguments.raster, arguments.workers, n, world) for n in range(arguments.runs)]
    if runs:
        metrics.append(metric("raster_images_per_s", [run.steady for run in runs], "1/s", "higher"))
        metrics.append(metric("raster_images_per_s_with_start", [run.whole for run in runs], "1/s", "higher"))
        metrics.append(metric("raster_processor_ms", [run.processor for run in runs], "ms"))
        metrics.append(metric("raster_memory_mib", [run.late for run in runs], "MiB"))
        metrics.append(metric("raster_memory_growth_mib", [run.growth for run in runs], "MiB"))
    if arguments.images:
        metrics.append(
            metric("raster_image_ms", image_ms(arguments.images, world, _size(arguments.size)), "ms")
        )
    if arguments.cycles:
        run = Run.of("cycles", arguments.cycles, arguments.workers, 0, world)
        metrics.append(metric("cycles_s_per_image", [1 / run.steady], "s"))
        metrics.append(metric("cycles_s_per_image_with_start", [1 / run.whole], "s"))
        metrics.append(metric("cycles_memory_mib", [run.late], "MiB"))
        metrics.append(metric("cycles_memory_growth_mib", [run.growth], "MiB"))
    for each in metrics:
        print(f"{each['name']:32} {each['value']:10} {each['unit']:5} (iqr {each['iqr']})")
    if arguments.json:
        write(report(metrics, arguments.workers), arguments.json)
        print(arguments.json)


class Run:
    """One generated dataset.

    whole, steady: samples per second; processor: ms of all processes' time for each sample of the whole run;
    memory: MiB over time, of all processes.
    """

    def __init__(self, whole: float, steady: float, processor: float, memory: np.ndarray) -> None:
        self.whole, self.steady, self.processor, self.memory = whole, steady, processor, memory

    @staticmethod
    def of(renderer: str, count: int, workers: int, seed: int, world: World) -> Run:
        """Make `count` samples with a renderer, "raster" or "cycles"."""
        with tempfile.TemporaryDirectory() as folder, Memory() as memory:
            out = Path(folder) / "dataset"
            started, busy = time.perf_counter(), _processor()
            make_dataset(out, count, seed, tier=renderer, workers=workers, progress=False, world=world)
            whole = count / (time.perf_counter() - started)
            busy = 1000 * (_processor() - busy) / count
            written = [image_paths(out / "train", i)["rgb"].stat().st_mtime for i in range(count)]
        late = np.sort(written)[count // 4 :]
        return Run(whole, (len(late) - 1) / (late[-1] - late[0]), busy, np.array(memory.sizes))

    @property
    def growth(self) -> float:
        """MiB between the middle of the run and its end: medians of a tenth of the run each."""
        tenth = max(1, len(self.memory) // 10)
        middle = len(self.memory) // 2
        before, after = self.memory[middle : middle + tenth], self.memory[-2 * tenth : -tenth]
        return float(np.median(after) - np.median(before))

    @property
    def late(self) -> float:
        """MiB towards the end of the run: the median of its last fifth but for the last tenth."""
        tenth = max(1, len(self.memory) // 10)
        return float(np.median(self.memory[-2 * tenth : -tenth]))


def _size(text: str) -> tuple[int, int]:
    width, height = map(int, text.split("x"))
    return width, height


def image_ms(count: int, world: World, size: tuple[int, int]) -> list[float]:
    """Milliseconds of processor time of an image in each block of images, made in this process."""
    job, blocks = Job(0, "train", "raster", ObjectClass.load("teapot"), world=world, size=size), []
    maker = Maker(job)
    with tempfile.TemporaryDirectory() as folder:
        for name in ("first", "second"):
            blocks = []
            for start in range(0, count, BLOCK):
                numbers, before = range(start, min(start + BLOCK, count)), time.process_time()
                for number in numbers:
                    store(Path(folder) / name, maker.make(number))
                blocks.append(1000 * (time.process_time() - before) / len(numbers))
    return blocks


class Memory:
    """Adds up the resident memory of this process and all below it while it is open (Linux)."""

    def __init__(self) -> None:
        self.sizes: list[float] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Memory:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._done.wait(0.25):
            self.sizes.append(sum(_resident(pid) for pid in _family(os.getpid())) / 2**20)


def _processor() -> float:
    """Seconds of processor time of this process and of those below it that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def _family(root: int) -> list[int]:
    """Process ids of a process and all its descendants."""
    parents = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parents[int(folder.name)] = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
        except OSError:  # it has gone
            continue
    family = [root]
    for pid in family:
        family += [child for child, parent in parents.items() if parent == pid]
    return family


def _resident(pid: int) -> int:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


if __name__ == "__main__":
    main()
