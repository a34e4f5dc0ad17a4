"""The paper's own experiments: its networks and optimisers, ablations, figures, tables, `vig reproduce`.

Only names stand here, so that `vig --help` is quick.
"""

from typing import Literal, get_args

Network = Literal["vig", "paper"]
"""The recognition model: vig's one network, or the paper's four."""

Objects = Literal["model", "designs"]
"""What test photos show: shapes drawn from the shape model, or designs that it was not made of."""

Scale = Literal["tiny", "small", "paper"]
"""How large a reproduction is."""

StepKind = Literal["data", "train", "calibrate", "evaluate", "ablations", "figures", "page"]
STEP_KINDS: tuple[StepKind, ...] = get_args(StepKind)
"""The kinds of steps of a reproduction in their order: data, evaluate and figures have several steps."""
