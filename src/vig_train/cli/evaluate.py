"""`vig evaluate`: methods measured on a dataset, their errors and tables as files."""

import json
import sys
from math import inf

from rich.console import Console

from vig.inference import ExplainSettings, FitCalibration
from vig.inference.calibration import FILE
from vig.io.errors import UserError
from vig.io.printing import end
from vig.io.progress import Meter
from vig.recognition import Recognizer
from vig.scene import ObjectClass
from vig_train.cli.common import check_ranges, check_writable
from vig_train.cli.settings import Evaluate
from vig_train.evaluation.fits import FitRun
from vig_train.evaluation.presentation import blocks, save_table
from vig_train.evaluation.protocol import evaluate as run_methods
from vig_train.evaluation.protocol import fitted_likelihoods
from vig_train.evaluation.results import write_csv
from vig_train.evaluation.table import check_limits, summarise
from vig_world.dataset import read_dataset
from vig_world.dataset.format import read_info


def evaluate(settings: Evaluate) -> int:
    """Run the methods, write and print their results; returns the exit code."""
    _check(settings)
    object_class = ObjectClass.load(settings.object_class)
    dataset = read_dataset(settings.dataset, settings.split)
    if settings.limit is not None:
        dataset = dataset.first(settings.limit)
    dataset = dataset.at_network_size()
    check_limits(dataset.occlusion, settings.min_occlusion, settings.max_occlusion)
    renderer = read_info(settings.dataset)["splits"][settings.split]["tier"]
    recognizer = Recognizer.of_class(object_class, settings.weights)
    explain_settings = ExplainSettings()
    if settings.weights is not None:  # their own calibration, not the class's
        path = settings.weights.with_name(FILE)
        calibration = FitCalibration.load(path) if path.exists() else None
        explain_settings = ExplainSettings(calibrated=calibration is not None, calibration=calibration)
    check_writable(settings.out)
    fits = len(dataset) * len(fitted_likelihoods(settings.methods))
    with Meter(fits, 0, not settings.json, "fits") as meter:
        cache, cluster = settings.out / "fits", settings.cluster
        run = FitRun(object_class, settings.workers, meter.advance, cache, True, cluster)
        results = run_methods(dataset, recognizer, run, settings.methods, explain_settings)
    write_csv(settings.out / "errors.csv", dataset, results)
    table = summarise(results, dataset, renderer, settings.min_occlusion, settings.max_occlusion)
    save_table(settings.out / "table.json", table, blocks(table))
    if settings.json:
        print(json.dumps(table, indent=2))
        return 0
    console = Console(width=None if sys.stdout.isatty() else 100)
    for block in blocks(table):
        if block.title.startswith(("Table 1", "Failures")):  # the file has all tables
            console.print(block.rich())
    end(settings.out, f"measured: {settings.out / 'table.md'} has further tables, errors.csv each image")
    return 0


def _check(settings: Evaluate) -> None:
    """Refuse limits that no image can satisfy."""
    check_ranges(settings, max_occlusion=(0, 1), min_occlusion=(0, 1), limit=(1, inf), workers=(1, inf))
    if settings.min_occlusion >= settings.max_occlusion:
        raise UserError(
            f"expected --min-occlusion below --max-occlusion; got {settings.min_occlusion:g} and"
            f" {settings.max_occlusion:g}."
        )
