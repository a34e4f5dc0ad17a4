"""The verb of the paper: name, settings, and `module:function` that does the work."""

from vig_paper.settings import Reproduce

VERBS = (("reproduce", Reproduce, "vig_paper.cli.reproduce:reproduce_paper"),)
