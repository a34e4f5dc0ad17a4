"""Whether every processor explains photos alike: `python -m benchmarks.instruction_sets [--json FILE]`.

Each photo of the validation world (raster renderer, through a camera model) is explained once for each set:
vig's native library, torch and oneDNN are held to it by the environment. ONNX Runtime takes the processor's
own whatever is said, so for every set but the first the network sees the photo changed by `ROUNDING`, which
changes the last digits of predictions as another processor does. Printed: the share of photos whose azimuths
are within a tenth of the stated deviation of those under the first set, of equal verdicts, and the
evaluations of a fit.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from benchmarks import inputs
from benchmarks.measuring import metric, report, write
from vig.inference import ExplainSettings, explain_one, resolve
from vig.parallel import set_thread_count
from vig.recognition import Recognizer
from vig.scene import ObjectClass, latent_layout
from vig_native.processor import instruction_sets
from vig_world.generation.write import make_dataset

LIBRARIES = {
    "avx512": {},
    "avx2": {"ATEN_CPU_CAPABILITY": "avx2", "ONEDNN_MAX_CPU_ISA": "AVX2"},
    "plain": {"ATEN_CPU_CAPABILITY": "default", "ONEDNN_MAX_CPU_ISA": "SSE41"},
}
"""What holds torch and oneDNN to an instruction set."""
ROUNDING = 3e-7
"""Standard deviation of the change of a pixel for the network, a share of its value: predictions then move by
1e-6 of their stated deviations (root mean square), as far as those of ONNX Runtime and torch lie apart.
"""
MIN_AGREEMENT = 0.99
"""Share of photos below which the program exits with 1."""


def explain(photos: np.ndarray, rounding: float) -> list[tuple[float, float, str, int]]:
    """Azimuth and its deviation, radians, verdict and evaluations of each photo, fitted as a photograph."""
    noise = np.random.default_rng(0)
    set_thread_count(1)
    teapot = ObjectClass.load("teapot")
    settings, recognizer = resolve(ExplainSettings(), teapot, photo=True), Recognizer.of_class(teapot)
    place, rows = latent_layout(teapot.shape_model.modes).at("azimuth"), []
    for photo in photos:
        seen = photo * (1 + rounding * noise.standard_normal(photo.shape, np.float32))
        fit = explain_one(photo, recognizer(seen[None]), teapot, settings)
        turn, deviation = float(fit.latents.azimuth[0]), float(fit.deviation[place])
        rows.append((turn, deviation, str(fit.verdict), fit.evaluations))
    return rows


def explained_under(name: str, dataset: Path, count: int, rounding: float) -> list[list]:
    """`explain` in a process of its own under an instruction set."""
    command = [sys.executable, "-m", "benchmarks.instruction_sets", "--one", str(dataset)]
    environment = os.environ | LIBRARIES[name] | {"VIG_ISA": name}
    run = subprocess.run(
        [*command, "--count", str(count), "--rounding", str(rounding)],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    rows: list[list] = json.loads(run.stdout.splitlines()[-1])
    return rows


def main() -> None:
    """Explain under each set, compare, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--rounding", type=float, default=ROUNDING, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one is not None:
        chosen = argparse.Namespace(dataset=arguments.one, split="validation", count=arguments.count)
        photos = inputs.chosen(chosen, ObjectClass.load("teapot"))[0]
        print(json.dumps(explain(photos, arguments.rounding)))
        return
    names = [name for name in instruction_sets() if find_spec(f"vig_native._{name}")]
    with tempfile.TemporaryDirectory() as folder:
        dataset = Path(folder) / "photos"
        make_dataset(dataset, arguments.count, arguments.seed, split="validation", photo=True, workers=1)
        roundings = [0.0] + [arguments.rounding] * (len(names) - 1)
        first, *others = [
            explained_under(name, dataset, arguments.count, rounding)
            for name, rounding in zip(names, roundings, strict=True)
        ]
    metrics = [metric("evaluations_per_photograph_fit", [row[3] for row in first], "evaluations")]
    for name, rows in zip(names[1:], others, strict=True):
        pairs = list(zip(first, rows, strict=True))
        near = [abs(math.remainder(a[0] - b[0], math.tau)) <= 0.1 * min(a[1], b[1]) for a, b in pairs]
        equal = [a[2] == b[2] for a, b in pairs]
        print(
            f"{name} against {names[0]}, {len(pairs)} photos: azimuth within a tenth of its deviation"
            f" {sum(near) / len(near):.3f}, verdict equal {sum(equal) / len(equal):.3f}"
        )
        metrics.append(metric(f"azimuth_agrees_{name}", [sum(near) / len(near)], "share", "higher"))
        metrics.append(metric(f"verdict_agrees_{name}", [sum(equal) / len(equal)], "share", "higher"))
    if arguments.json:
        write(report(metrics, threads=1), arguments.json)
    if any(each["better"] == "higher" and each["value"] < MIN_AGREEMENT for each in metrics):
        sys.exit(1)


if __name__ == "__main__":
    main()
