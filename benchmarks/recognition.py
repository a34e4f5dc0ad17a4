"""Photos per second of the recognition network, by threads: `python -m benchmarks.recognition [--json FILE]`.

The photos are made by the raster generator (test split), or are the last ones of `--dataset DIR`; each number
of threads runs over all of them `--repeats` times, after a run that does not count. Then milliseconds of one
window on one core, by ONNX Runtime and by torch in turn: the fastest of `WINDOWS`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks import inputs
from benchmarks.measuring import metric, report, timed, write
from vig.parallel import set_thread_count, thread_count
from vig.recognition import WEIGHTS_FILE, Recognizer
from vig.scene import ObjectClass

THREADS = (1, 2)
WINDOWS = 30
"""Times that a window is predicted in each way."""


def rates(recognizer: Recognizer, linear: np.ndarray, threads: int, repeats: int) -> list[float]:
    """Photos (N, H, W, 3) per second of `repeats` runs over all, after one that does not count."""
    before = thread_count()
    set_thread_count(threads)
    try:
        recognizer(linear)
        return [1000 * len(linear) / timed(lambda: recognizer(linear))[1].wall_ms for _ in range(repeats)]
    finally:
        set_thread_count(before)


def milliseconds_of_a_window(recognizer: Recognizer, path: Path) -> dict[str, float]:
    """Time the network alone; torch in bfloat16 only where the processor multiplies so."""
    import torch

    from vig_train.network.network import has_bfloat16
    from vig_train.network.weights import read_network

    torch.set_num_threads(1)
    image, network = np.random.default_rng(0).random((1, 3, 150, 150), np.float32), read_network(path)
    tensor = torch.from_numpy(image)

    def by_torch(half: bool) -> None:
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=half):
            network(tensor)

    ways: dict[str, Callable[[], object]] = {
        "onnx": lambda: recognizer.heads(image, (False,)),
        "torch": lambda: by_torch(False),
    }
    if has_bfloat16():
        ways["torch_bfloat16"] = lambda: by_torch(True)
    taken: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(WINDOWS):
        for name, way in ways.items():
            taken[name].append(timed(way)[1].wall_ms)
    return {name: min(times) for name, times in taken.items()}


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
    for name, fastest in milliseconds_of_a_window(recognizer, teapot.folder / WEIGHTS_FILE).items():
        metrics.append(metric(f"window_{name}_ms", [fastest], "ms"))
        print("{name}: {value} {unit}".format(**metrics[-1]), flush=True)
    if arguments.json:
        write(report(metrics, threads=max(THREADS)), arguments.json)


if __name__ == "__main__":
    main()
