"""The paper's section 5 as one run: data, training, methods under both renderers, tables and figures."""

from vig_paper.reproduction.folder import RENDERERS as RENDERERS
from vig_paper.reproduction.folder import RunFolder as RunFolder
from vig_paper.reproduction.run import reproduce as reproduce
from vig_paper.reproduction.work import Run as Run
