"""The laboratory's verbs of the command line."""

from vig.cli.verb import Verb
from vig_lab.cli.settings import Calibrate, Evaluate, Reproduce, Train

VERBS = (
    Verb("train", Train, "vig_lab.cli.train:train"),
    Verb("calibrate", Calibrate, "vig_lab.cli.calibrate:calibrate"),
    Verb("evaluate", Evaluate, "vig_lab.cli.evaluate:evaluate"),
    Verb("reproduce", Reproduce, "vig_lab.cli.reproduce:reproduce_paper"),
)

__all__ = ["VERBS"]
