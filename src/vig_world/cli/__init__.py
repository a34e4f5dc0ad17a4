"""The generator's verbs of the command line."""

from vig_world.cli.settings import Check, ExportDataset, Make, Show

VERBS = (
    ("dataset make", Make, "vig_world.cli.dataset:make"),
    ("dataset check", Check, "vig_world.cli.dataset:check"),
    ("dataset show", Show, "vig_world.cli.dataset:show"),
    ("dataset export", ExportDataset, "vig_world.cli.dataset:export"),
)
