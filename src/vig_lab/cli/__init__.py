"""The experiments' verbs of the command line."""

from vig.cli.common import Verb
from vig_lab.cli.settings import Calibrate, Demo, Evaluate, Reproduce, Train, TrainClass

VERBS = (
    Verb("demo", Demo, "vig_lab.cli.demo:demo"),
    Verb("train", Train, "vig_lab.cli.train:train"),
    Verb("class train", TrainClass, "vig_lab.cli.class_train:train_class"),
    Verb("calibrate", Calibrate, "vig_lab.cli.calibrate:calibrate"),
    Verb("evaluate", Evaluate, "vig_lab.cli.evaluate:evaluate"),
    Verb("reproduce", Reproduce, "vig_lab.cli.reproduce:reproduce_paper"),
)

__all__ = ["VERBS"]
