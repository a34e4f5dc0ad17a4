"""Processor seconds of single commands, start included: `python -m benchmarks.startup [--json FILE]`.

`vig fit` of a packaged example with a box as any later time (warm) and as the first after an installation,
without caches (cold; pip has compiled the Python), without a box (find), and `vig --help`: processor time of
all threads, the minimum of several runs, each in a process of its own.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from benchmarks.measuring import metric, report, write
from vig_app.examples import example_photos

WARM_RUNS, COLD_RUNS = 5, 2
BOX = "7,42,124,78"
"""Box of the object in the first packaged example: x, y, width, height in pixels."""


def processor_seconds(arguments: Iterable[str], environment: Mapping[str, str]) -> float:
    """Processor time of `vig` with these arguments in a new process; RuntimeError when it fails."""
    command = [sys.executable, "-c", "from vig_app.cli.main import main; main()", *arguments]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, env=dict(environment), capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"vig {' '.join(arguments)} ended with {done.returncode}: {done.stderr.strip()}")
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def measure(warm: int, cold: int) -> dict[str, list[float]]:
    """Seconds of every run of each command, by the name of its metric."""
    # As many threads as a user gets, where `benchmarks` itself sets one; and Python keeps what it compiles.
    unset = {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "PYTHONDONTWRITEBYTECODE"}
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    with tempfile.TemporaryDirectory() as folder:
        find = ["fit", str(example_photos()[0].photo), "--out", str(Path(folder) / "fit")]
        fit = [*find, "--box", BOX]
        names = "fit_warm_s", "fit_cold_s", "find_warm_s", "help_s"
        seconds: dict[str, list[float]] = {name: [] for name in names}
        for run in range(cold):
            fresh = {"XDG_CACHE_HOME": str(Path(folder) / f"cache{run}")}
            seconds["fit_cold_s"].append(processor_seconds(fit, environment | fresh))
        for _ in range(warm):
            seconds["fit_warm_s"].append(processor_seconds(fit, environment))
            seconds["find_warm_s"].append(processor_seconds(find, environment))
            seconds["help_s"].append(processor_seconds(["--help"], environment))
    return seconds


def metrics_of(seconds: Mapping[str, list[float]]) -> list[dict[str, Any]]:
    """Metrics of which the value is the minimum: whatever else the machine does only adds to a time."""
    return [
        metric(name, values, "s") | {"value": float(f"{min(values):.4g}")} for name, values in seconds.items()
    ]


def arguments_of(given: list[str] | None = None) -> argparse.Namespace:
    """The parsed arguments, by default those of the process."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--warm", type=int, default=WARM_RUNS, help="runs of `vig fit` and `vig --help`")
    parser.add_argument("--cold", type=int, default=COLD_RUNS, help="runs of `vig fit` without caches")
    arguments = parser.parse_args(given)
    if min(arguments.warm, arguments.cold) < 1:
        parser.error(f"expected at least one run of each; got {arguments.warm} and {arguments.cold}")
    return arguments


def main() -> None:
    """Measure, print, and write JSON where asked."""
    arguments = arguments_of()
    metrics = metrics_of(measure(arguments.warm, arguments.cold))
    for each in metrics:
        print(f"{each['name']}: {each['value']} {each['unit']} (interquartile range {each['iqr']})")
    if arguments.json:
        write(report(metrics, threads=os.cpu_count() or 1), arguments.json)


if __name__ == "__main__":
    main()
