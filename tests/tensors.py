"""What vig computes in arrays, seen as tensors: for tests whose references are written in torch."""

from __future__ import annotations

import dataclasses
import enum
import functools
import types
from typing import Any

import numpy as np
import torch

DATA = {
    "Latents",
    "Evaluation",
    "ObjectiveValue",
    "Descent",
    "RefinedStarts",
    "Selection",
    "Fit",
    "OtherView",
}
"""Classes that only hold numbers."""
PLAIN = {"LatentLayout", "Block", "Camera", "ObjectClass", "ShapeModel", "Symmetry", "Window"}
"""Classes that take tensors, or none."""


def tensors(value: Any) -> Any:
    """The same with tensors for arrays; objects of vig become ones that take and give tensors."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        return torch.from_numpy(
            value if value.flags.writeable and all(s >= 0 for s in value.strides) else value.copy()
        )
    if isinstance(value, np.floating):
        return torch.tensor(value.item(), dtype=torch.float64 if value.dtype == np.float64 else torch.float32)
    if type(value) in (tuple, list):
        return type(value)(map(tensors, value))
    if type(value) is dict:
        return {name: tensors(each) for name, each in value.items()}
    if type(value).__name__ in DATA:
        fields = [each for each in dataclasses.fields(value) if each.init]
        return type(value)(**{each.name: tensors(getattr(value, each.name)) for each in fields})
    if type(value).__name__ in PLAIN:
        return value
    module = getattr(value, "__module__", "")
    if isinstance(value, enum.Enum):
        return value
    if isinstance(value, types.FunctionType | types.MethodType):
        return wrap(value)
    return Seen(value) if module.split(".")[0] == "vig" and not isinstance(value, type | str | int) else value


def arrays(value: Any) -> Any:
    """The same with arrays for tensors."""
    if isinstance(value, torch.Tensor):
        return value.detach().numpy()
    if isinstance(value, Seen):
        return vars(value)["real"]
    if type(value) in (tuple, list):
        return type(value)(map(arrays, value))
    if type(value) is dict:
        return {name: arrays(each) for name, each in value.items()}
    if isinstance(value, torch.dtype):
        return np.dtype(str(value).removeprefix("torch."))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {each.name: getattr(value, each.name) for each in dataclasses.fields(value) if each.init}
        if any(isinstance(each, torch.Tensor | Seen) for each in fields.values()):
            return type(value)(**arrays(fields))
    return value


class Seen:
    """An object of vig that takes and gives tensors."""

    def __init__(self, real: Any):
        vars(self)["real"] = real

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return tensors(getattr(vars(self)["real"], name))

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(vars(self)["real"], name, arrays(value))

    def __call__(self, *given: Any, **named: Any) -> Any:
        return tensors(vars(self)["real"](*arrays(given), **arrays(named)))

    def __len__(self) -> int:
        return len(vars(self)["real"])

    def __getitem__(self, index: Any) -> Any:
        return tensors(vars(self)["real"][arrays(index)])


class _SeenClass(Seen):
    def __instancecheck__(self, value: Any) -> bool:
        return isinstance(arrays(value), vars(self)["real"])


def wrap(real: Any) -> Any:
    """A function, class or object of vig that takes and gives tensors."""
    if isinstance(real, types.FunctionType | types.MethodType):

        @functools.wraps(real)
        def within(*given: Any, **named: Any) -> Any:
            return tensors(real(*arrays(given), **arrays(named)))

        return within
    return _SeenClass(real) if isinstance(real, type) else Seen(real)


def replace(value: Any, **changes: Any) -> Any:
    """`dataclasses.replace`, also of what is seen in tensors."""
    if not isinstance(value, Seen):
        return dataclasses.replace(value, **changes)
    return Seen(dataclasses.replace(arrays(value), **arrays(changes)))
