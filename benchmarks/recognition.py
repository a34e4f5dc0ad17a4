"""Photos per second of the recognition network, by threads: `python -m benchmarks.recognition [--json FILE]`.

The photos are made by the raster generator (test split), or are the last ones of `--dataset DIR`; each number
of threads runs over all of them `--repeats` times, after a run that does not count.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from benchmarks import inputs
from benchmarks.measuring import metric, report, timed, write
from vig.parallel import set_thread_count, thread_count
from vig.recognition import Recognizer
from vig.scene import ObjectClass

THREADS = (1, 2)


def rates(recognizer: Recognizer, linear: np.ndarray, threads: int, repeats: int) -> list[float]:
    """Photos (N, H, W, 3) per second of `repeats` runs over all, after one that does not count."""
    before = thread_count()
    set_thread_count(threads)
    try:
        recognizer(linear)
        return [1000 * len(linear) / timed(lambda: recognizer(linear))[1].wall_ms for _ in range(repeats)]
    finally:
        set_thread_count(before)


def main() -> None:
    """Measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    inputs.add_arguments(parser, count=320)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    teapot = ObjectClass.load("teapot")
    recognizer, linear = Recognizer.of_class(teapot), inputs.chosen(arguments, teapot)[0]
    metrics = []
    for threads in THREADS:
        found = rates(recognizer, linear, threads, arguments.repeats)
        metrics.append(metric(f"recognised_per_s_threads{threads}", found, "photos/s", "higher"))
        print("{name}: {value} +-{iqr} {unit}".format(**metrics[-1]), flush=True)
    if arguments.json:
        write(report(metrics, threads=max(THREADS)), arguments.json)


if __name__ == "__main__":
    main()
