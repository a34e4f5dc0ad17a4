"""`vig calibrate`: uncertainties of a network and of fits, calibrated on validation photos."""

import shutil
from math import inf

from vig.inference.calibration import FILE
from vig.io.errors import UserError
from vig.io.printing import end
from vig.io.progress import Meter
from vig.recognition import Recognizer
from vig.scene import ObjectClass
from vig_train.calibration.learning import describe
from vig_train.calibration.positions import POSITION_PHOTOS, calibrate_positions
from vig_train.calibration.samples import StudioPhotos, calibrate_fits, fit_count
from vig_train.cli.common import check_ranges, check_writable
from vig_train.cli.settings import Calibrate
from vig_train.evaluation.fits import FitRun
from vig_train.evaluation.protocol import check_class
from vig_train.plots import report_calibration
from vig_train.training.calibration import calibrate_network, check_count
from vig_world.dataset import Dataset, read_dataset


def calibrate(settings: Calibrate) -> int:
    """Calibrate the weights in place, then fits that start from them; returns the exit code."""
    check_ranges(settings, workers=(1, inf), studio=(0, inf), seed=(0, inf))
    if not settings.datasets and not settings.studio:
        raise UserError("expected a dataset or --studio above 0 to calibrate on; got neither. Give one.")
    object_class = ObjectClass.load(settings.object_class)
    datasets = [read_dataset(path, settings.split).at_network_size() for path in settings.datasets]
    for dataset in datasets:
        check_class(dataset, object_class)
    check_count(sum(map(len, datasets)) + settings.studio)
    Recognizer.of_class(object_class, settings.weights)  # refuses invalid weights
    folder = settings.weights.parent
    check_writable(folder)
    # Stopped before the end it leaves weights without a calibration, not with that of others.
    (folder / FILE).unlink(missing_ok=True)
    lines: list[str] = []
    calibration_sets: list[Dataset | StudioPhotos] = [*datasets]
    studio_examples = []
    if settings.studio:
        photos, examples = StudioPhotos.draw(
            object_class, settings.split, settings.studio, settings.seed, props=str(settings.props or "")
        )
        calibration_sets.append(photos)
        studio_examples.append(examples)
    result = calibrate_network(settings.weights, datasets, studio_examples, object_class)
    report_calibration(settings.weights, result, lines.append)
    recognizer = Recognizer.of_class(object_class, settings.weights)
    fits = folder / "calibration_fits"  # so that a run that is stopped continues
    with Meter(sum(map(fit_count, calibration_sets)), 0, not settings.json, "fits") as meter:
        run = FitRun(object_class, settings.workers, meter.advance, fits, processes=True)
        calibration, samples = calibrate_fits(calibration_sets, recognizer, run)
    positions = sum(min(len(dataset), POSITION_PHOTOS) for dataset in datasets if dataset.world != "paper")
    with Meter(positions, 0, not settings.json, "positions") as meter:
        calibration = calibrate_positions(
            calibration, datasets, object_class, recognizer, advance=meter.advance
        )
    calibration.save(folder / FILE)
    shutil.rmtree(fits, ignore_errors=True)
    lines += describe(calibration, samples)
    path = folder / FILE
    printed = {"report": lines, "calibration": str(path)} if settings.json else None
    end(folder, f"calibrated: {path} holds for its weights; vig evaluate measures them", printed, lines)
    return 0
