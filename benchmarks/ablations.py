"""What each part of a fit is worth: `python -m benchmarks.ablations --dataset D --out R [--count N]`.

The default fit of the first N photos, and the same with one part after another switched off or another
optimiser, photo by photo. Prints `R/ablations.md` and writes `R/ablations.json` beside it; fits stay in
`R/fits`, so that a run that was killed goes on where it was.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path

from benchmarks.report import report, write
from vig.dataset import Dataset, read_dataset
from vig.errors import UserError
from vig.files import atomic_write
from vig.recognition import Recognizer
from vig.scene import ObjectClass
from vig_lab.ablation import ABLATIONS, ablation_markdown, run_ablations, variants


def first(dataset: Dataset, count: int) -> Dataset:
    """The first `count` samples of a dataset."""
    return replace(
        dataset,
        latents=dataset.latents[:count],
        occlusion=dataset.occlusion[:count],
        target_occlusion=dataset.target_occlusion[:count],
        cause=dataset.cause[:count],
        truncated=dataset.truncated[:count],
        design=dataset.design[:count],
    )


def main(given: list[str] | None = None) -> None:
    """Fit, compare, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--dataset", type=Path, required=True)
    parser.add_argument("--split", default="test")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--names", nargs="+", choices=list(ABLATIONS), help="only these; all by default")
    parser.add_argument("--class", dest="object_class", default="teapot")
    parser.add_argument("--weights", type=Path, help="other recognition weights than the class's own")
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    arguments = parser.parse_args(given)
    try:
        if arguments.count < 1:
            raise UserError(f"expected --count to be at least 1; got {arguments.count}")
        object_class = ObjectClass.load(arguments.object_class)
        dataset = first(read_dataset(arguments.dataset, arguments.split), arguments.count)
        recognizer = Recognizer.of_class(object_class, arguments.weights)
        total, done = len(dataset) * len(variants(names=arguments.names)), 0

        def advance(fitted: int) -> None:
            nonlocal done
            done += fitted
            if done % 100 == 0 or done == total:
                print(f"{done} of {total} fits", file=sys.stderr, flush=True)

        cache, threads = arguments.out / "fits", arguments.threads
        table = run_ablations(dataset, object_class, recognizer, cache, arguments.names, threads, advance)
        said = ablation_markdown(table)
        with atomic_write(arguments.out / "ablations.md") as temporary:
            temporary.write_text(said)
        machine = report([], threads=1)
        write(
            {"machine": machine["machine"], "versions": machine["versions"]} | table,
            arguments.out / "ablations.json",
        )
    except UserError as error:
        sys.exit(f"benchmarks.ablations: {error}")
    print(said)


if __name__ == "__main__":
    main()
