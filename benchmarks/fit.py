"""How long a fit takes, and how many fit in a second: `python -m benchmarks.fit [--json FILE] [--quick]`.

On one thread: one descent from the recognition model's best guess at full size until it
converges, one whole fit with all its starts, one with the settings of photographs, how often the objective
is valued in each, one valuation with gradient and normal matrix when it is asked for by itself, and one
within the search. Then fits per second on one
thread and on two, in batches of 1 to 256 photos (with --quick to 16). The photos are made by the raster
generator (test split), or are the last ones of `--dataset DIR`. Medians and interquartile ranges; wall clock,
with the processor time beside it.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import inputs
from benchmarks.measuring import Time, metric, report, timed, write
from benchmarks.throughput import BATCHES, QUICK_BATCHES, Fits, descent_budget, table, throughput
from vig.inference import ExplainSettings, explain_one, objective_of, resolve
from vig.parallel import set_thread_count
from vig.scene import ObjectClass

BAR_MS, AIM_MS = 50.0, 25.0
"""Bar and aim for a photograph's fit on one core."""


@dataclass
class Samples:
    """One number per fit: times of descents from one start, whole fits and single valuations, and counts."""

    one_start: list[Time]
    whole: list[Time]
    of_photographs: list[Time]
    valuation: list[Time]
    one_start_evaluations: list[int]
    evaluations: list[int]
    evaluations_of_photographs: list[int]
    converged: list[bool]


def measure(fits: Fits, repeats: int) -> Samples:
    """Fit every photo `repeats` times on one thread."""
    set_thread_count(1)
    settings, found = fits.settings, Samples([], [], [], [], [], [], [], [])
    of_photographs = resolve(ExplainSettings(), fits.object_class, photo=True)
    zero, sigma = np.zeros(1, np.int32), settings.likelihood.sigma
    fits.whole(np.arange(1))  # first uses
    for index in list(range(len(fits.photos))) * repeats:
        photo, prediction = fits.photos[index], fits.prediction[index : index + 1]
        explanation, time = timed(lambda: explain_one(photo, prediction, fits.object_class, settings))  # noqa: B023
        found.whole.append(time)
        found.evaluations.append(explanation.evaluations)
        explanation, time = timed(lambda: explain_one(photo, prediction, fits.object_class, of_photographs))  # noqa: B023
        found.of_photographs.append(time)
        found.evaluations_of_photographs.append(explanation.evaluations)
        objective = objective_of(photo, prediction, fits.object_class, settings)
        start = objective.point(prediction.best())
        budget = descent_budget(settings)
        descent, time = timed(lambda: settings.optimizer(objective, start, zero, sigma, budget))  # noqa: B023
        found.one_start.append(time)
        found.one_start_evaluations.append(int(descent.evaluations[0]))
        found.converged.append(bool(descent.converged[0]))
        noise = np.array([sigma])
        objective(start, zero, noise)  # recorded launches are bound to the photo
        found.valuation.append(timed(lambda: objective(start, zero, noise))[1])  # noqa: B023
    return found


def metrics_of(found: Samples) -> list[dict[str, Any]]:
    """Metrics in DESIGN's form, by the wall clock."""

    def walls(times: list[Time]) -> list[float]:
        return [time.wall_ms for time in times]

    return [
        metric("fit_ms_per_core", walls(found.one_start), "ms"),
        metric("whole_fit_ms_per_core", walls(found.whole), "ms"),
        metric("photograph_fit_ms_per_core", walls(found.of_photographs), "ms"),
        metric("full_evaluation_ms", walls(found.valuation), "ms"),
        metric(
            "search_ms_per_evaluation",
            [
                wall / count
                for wall, count in zip(walls(found.one_start), found.one_start_evaluations, strict=True)
            ],
            "ms",
        ),
        metric("evaluations_per_start", found.one_start_evaluations, "evaluations"),
        metric("evaluations_per_fit", found.evaluations, "evaluations"),
        metric("evaluations_per_photograph_fit", found.evaluations_of_photographs, "evaluations"),
    ]


def printed(found: Samples, starts: int) -> str:
    """The measurements for people, with processor times and how far the bar and the aim are."""
    rows = {row["name"]: row for row in metrics_of(found)}
    processor = {
        "fit_ms_per_core": found.one_start,
        "whole_fit_ms_per_core": found.whole,
        "photograph_fit_ms_per_core": found.of_photographs,
        "full_evaluation_ms": found.valuation,
    }
    lines = []
    for name, row in rows.items():
        line = f"{name}: {row['value']} {row['unit']} (interquartile range {row['iqr']})"
        if name in processor:
            beside = metric(name, [time.processor_ms for time in processor[name]], "ms")
            line += f"; processor {beside['value']} ms ({beside['iqr']})"
        lines.append(line)
    waited = rows["photograph_fit_ms_per_core"]["value"]
    lines += [
        f"{sum(found.converged)} of {len(found.converged)} descents from one start converged",
        f"a photograph's fit by its {starts} starts, {waited} ms: {against(waited)}",
    ]
    return "\n".join(lines)


def against(milliseconds: float) -> str:
    """How a whole fit's time compares with the bar and the aim."""
    met = "within" if milliseconds <= BAR_MS else "over"
    return (
        f"{met} the bar of {BAR_MS:g} ms ({milliseconds / BAR_MS:.2f} of it),"
        f" {milliseconds / AIM_MS:.2f} times the aim of {AIM_MS:g} ms"
    )


def main() -> None:
    """Measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    inputs.add_arguments(parser, count=24)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--quick", action="store_true")
    arguments = parser.parse_args()
    teapot = ObjectClass.load("teapot")
    fits = Fits(teapot, inputs.chosen(arguments, teapot)[0])
    samples = measure(fits, arguments.repeats)
    print(f"{len(fits.photos)} photos, {arguments.repeats} times each, one thread")
    of_photographs = resolve(ExplainSettings(), teapot, photo=True)
    print(printed(samples, of_photographs.stages[0].starts), flush=True)
    rates = throughput(fits, QUICK_BATCHES if arguments.quick else BATCHES)
    print(table(rates))
    if arguments.json:
        metrics = [*metrics_of(samples), *(rate.metric() for rate in rates)]
        write(report(metrics, threads=1), arguments.json)


if __name__ == "__main__":
    main()
