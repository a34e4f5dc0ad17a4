"""Names that the experiments share and the command line offers. Nothing heavy is imported here."""

from __future__ import annotations

from typing import Literal, get_args

Method = Literal["baseline", "rm", "gaussian", "robust", "spatial"]
METHODS: tuple[Method, ...] = get_args(Method)
"""What is compared: the training mean, the recognition model, and a fit under each likelihood."""

Network = Literal["vig", "paper"]
"""The recognition model: vig's one network, or the paper's four."""

Scale = Literal["tiny", "small", "paper"]
"""How large a reproduction is."""

StepKind = Literal["data", "train", "calibrate", "evaluate", "ablations", "figures", "page"]
STEP_KINDS: tuple[StepKind, ...] = get_args(StepKind)
"""The kinds of steps of a reproduction in their order: data, evaluate and figures have several steps."""
