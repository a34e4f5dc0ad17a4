"""What a large photo adds to a fit: `python -m benchmarks.photos [--json FILE]`.

`vig fit` of one example photo, enlarged to 1, 12, 48 and 96 megapixels and kept as JPEG and PNG, each run in
a process of its own: processor time of all threads and peak memory, less those of the photo at its own size.
Loading, finding the object, the fit and all written files are in it. Minimum of several runs.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image

from benchmarks.measuring import metric, report, write
from vig_app.examples import example_photos

MEGAPIXELS = (1, 12, 48, 96)
FORMATS = ("jpg", "png")
RUNS = 3


def cost(photo: Path, out: Path) -> tuple[float, float]:
    """Processor seconds and peak megabytes of `vig fit` of a photo; RuntimeError when it fails."""
    command = [sys.executable, "-c", "from vig_app.cli.main import main; main()"]
    command += ["fit", str(photo), "--out", str(out), "--json"]
    with open(os.devnull, "w") as nowhere:
        actions = [(os.POSIX_SPAWN_DUP2, nowhere.fileno(), 1)]
        started = os.posix_spawn(command[0], command, os.environ, file_actions=actions)
        _, status, used = os.wait4(started, 0)
    if status:
        raise RuntimeError(f"vig fit {photo.name} ended with {os.waitstatus_to_exitcode(status)}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1000  # kilobytes on Linux


def enlarged(photo: Path, megapixels: int, path: Path) -> None:
    """Write a photo of so many megapixels in the format of the name."""
    with Image.open(photo) as opened:
        picture = opened.convert("RGB")
    factor = (megapixels * 1e6 / (picture.width * picture.height)) ** 0.5
    size = round(picture.width * factor), round(picture.height * factor)
    picture.resize(size, Image.Resampling.BICUBIC).save(path, quality=92, compress_level=1)


def measure(megapixels: tuple[int, ...], runs: int) -> list[dict[str, Any]]:
    """Metrics of all sizes and formats, printed as they are found."""
    original, found = example_photos()[0].photo, []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plain = [cost(original, folder / "out") for _ in range(runs)]
        least = [min(each) for each in zip(*plain, strict=True)]
        for ending in FORMATS:
            for size in megapixels:
                photo = folder / f"photo.{ending}"
                enlarged(original, size, photo)
                costs = [cost(photo, folder / "out") for _ in range(runs)]
                for what, unit, values, base in zip(
                    ("s", "mb"), ("s", "MB"), zip(*costs, strict=True), least, strict=True
                ):
                    added = [value - base for value in values]
                    row = metric(f"{ending}_{size}_megapixels_added_{what}", added, unit)
                    found.append(row | {"value": float(f"{min(added):.4g}")})
                    print(f"{row['name']}: {min(added):.4g} {unit}", flush=True)
    return found


def main() -> None:
    """Measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--megapixels", type=int, nargs="+", default=MEGAPIXELS)
    arguments = parser.parse_args()
    if min(arguments.runs, *arguments.megapixels) < 1:
        parser.error("expected numbers of 1 or more")
    metrics = measure(tuple(arguments.megapixels), arguments.runs)
    if arguments.json:
        write(report(metrics, threads=os.cpu_count() or 1), arguments.json)


if __name__ == "__main__":
    main()
