"""Classes from meshes, training of their networks, calibration and evaluation, and their verbs.

Only names stand here, so that `vig --help` is quick.
"""

from typing import Literal, get_args

Method = Literal["baseline", "rm", "gaussian", "robust", "spatial"]
METHODS: tuple[Method, ...] = get_args(Method)
"""Compared methods: the training mean, the recognition model, and a fit under each likelihood."""
