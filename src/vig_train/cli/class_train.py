"""`vig class train`: recognition weights for a class pack within a budget of minutes."""

import contextlib
import sys
from math import inf

from vig.io.errors import UserError
from vig.io.printing import end
from vig.scene import ObjectClass
from vig_train.class_training import ClassTraining
from vig_train.cli.common import check_ranges, check_writable
from vig_train.cli.settings import TrainClass


def train_class(settings: TrainClass) -> int:
    """Run `vig class train`."""
    if not settings.pack.is_dir():
        raise UserError(
            f"expected the folder of a class pack; got '{settings.pack}'. `vig class build` makes one."
        )
    check_ranges(settings, minutes=(1, 10_000), seed=(0, inf), workers=(1, inf))
    ObjectClass.load(settings.pack, unfinished=True)
    check_writable(settings.pack)
    with contextlib.redirect_stdout(sys.stderr) if settings.json else contextlib.nullcontext():
        training = ClassTraining(
            settings.pack, settings.minutes, settings.seed, settings.workers, props=str(settings.props or "")
        )
        errors = training.run()
    card = settings.pack / "card.md"
    words = f"trained: vig fit photo.jpg --class {settings.pack} takes it; its errors are in {card}"
    end(settings.pack, words, {"steps": training.record.data["steps"]} | errors if settings.json else None)
    return 0
