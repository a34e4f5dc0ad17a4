"""The generator's verbs of the command line."""

from vig.cli.common import Verb
from vig_world.cli.settings import Build, Check, Export, Groups, Make, Show

VERBS = (
    Verb("class build", Build, "vig_world.cli.classes:build"),
    Verb("dataset make", Make, "vig_world.cli.dataset:make"),
    Verb("dataset groups", Groups, "vig_world.cli.dataset:groups"),
    Verb("dataset check", Check, "vig_world.cli.dataset:check"),
    Verb("dataset show", Show, "vig_world.cli.dataset:show"),
    Verb("dataset export", Export, "vig_world.cli.dataset:export"),
)

__all__ = ["VERBS"]
