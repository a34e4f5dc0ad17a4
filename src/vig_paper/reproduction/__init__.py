"""The paper's section 5 as one run: data, training, methods under both renderers, tables and figures."""

from vig_paper.reproduction.folder import RENDERERS, RunFolder
from vig_paper.reproduction.run import reproduce
from vig_paper.reproduction.work import Run

__all__ = ["RENDERERS", "Run", "RunFolder", "reproduce"]
