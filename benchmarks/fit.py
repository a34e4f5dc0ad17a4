"""How long a fit takes on one core: `python -m benchmarks.fit [--json FILE] [--repeats N]`.

Fits the packaged example photos with the default settings, kernels warm, one thread. Prints medians and
interquartile ranges: one whole fit with all its starts, one descent from one start at full size, how often
the objective is valued in a fit, and one valuation with gradient and normal matrix.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import torch

from benchmarks.report import metric, report, write
from vig.examples import example_photos
from vig.images import read_photo
from vig.inference import Budget, ExplainSettings, LevenbergMarquardt, explain_one, objective_of
from vig.recognition import Recognizer
from vig.scene import ObjectClass


def measure(repeats: int) -> list[dict]:
    """Time every example photo `repeats` times; metrics in DESIGN's form."""
    torch.set_num_threads(1)
    teapot = ObjectClass.load("teapot")
    recognizer = Recognizer((teapot.folder or Path()) / "recognition.safetensors")
    photos = [torch.from_numpy(read_photo(example.photo)) for example in example_photos()]
    predictions = [recognizer(photo[None]) for photo in photos]
    settings = ExplainSettings()
    zero, sigma = torch.zeros(1, dtype=torch.int32), torch.tensor([settings.likelihood.sigma])
    explain_one(photos[0], predictions[0], teapot, settings)  # compile the kernels
    whole, single, valuation, evaluations = [], [], [], []
    for _ in range(repeats):
        for photo, prediction in zip(photos, predictions, strict=True):
            started = time.perf_counter()
            explanation = explain_one(photo, prediction, teapot, settings)
            whole.append(1000 * (time.perf_counter() - started))
            evaluations.append(explanation.evaluations)
            objective = objective_of(photo, prediction, teapot, settings)
            point = objective.point(prediction.best())
            started = time.perf_counter()
            LevenbergMarquardt()(objective, point, zero, settings.likelihood.sigma, Budget())
            single.append(1000 * (time.perf_counter() - started))
            started = time.perf_counter()
            objective(point, zero, sigma)
            valuation.append(1000 * (time.perf_counter() - started))
    return [
        metric("whole_fit_ms_per_core", whole, "ms"),
        metric("fit_ms_per_core", single, "ms"),
        metric("full_evaluation_ms", valuation, "ms"),
        metric("evaluations_per_fit", evaluations, "evaluations"),
    ]


def main() -> None:
    """Measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    found = report(measure(arguments.repeats), threads=1)
    for row in found["metrics"]:
        print(f"{row['name']}: {row['value']} {row['unit']} (interquartile range {row['iqr']})")
    if arguments.json:
        write(found, arguments.json)


if __name__ == "__main__":
    main()
