"""Checks of data that others wrote: files are read whole, bounded and of the right types, or refused.

The functions raise ValueError or OSError with a few plain words; `reading` turns whatever a parser raises
into the one line (UserError) that a user sees.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import os
import stat
import types
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from numbers import Real
from pathlib import Path
from typing import Any, Literal, NoReturn, get_args, get_origin, get_type_hints

import numpy as np
from safetensors import safe_open

from vig.io.errors import UserError

MOST_JSON = 16 << 20
"""Bytes of a JSON file, unless its reader has another limit."""
MOST_TENSORS = 1 << 30
"""Bytes of a safetensors file."""


@contextmanager
def reading(path: str | Path, expected: str, remedy: str) -> Iterator[None]:
    """Convert any exception of the block, which reads and checks `path`, to one UserError.

    Args:
        path: The file or folder that is read.
        expected: What it should be, such as "a calibration".
        remedy: What the user can do, a sentence.

    Raises:
        UserError: `expected <expected> at '<path>'; got <reason>. <remedy>`. A UserError passes.
    """
    try:
        yield
    except UserError:
        raise
    except Exception as error:  # a parser may raise anything on a damaged file
        raise UserError(f"expected {expected} at '{path}'; got {_came(error)}. {remedy}") from error


def _came(error: Exception) -> str:
    text = (str(error).splitlines() or [""])[0][:200]
    if isinstance(error, FileNotFoundError):
        return "nothing of that name"
    if isinstance(error, OSError) and error.strerror:
        return f"a file that cannot be read ({error.strerror})"
    if isinstance(error, RecursionError):
        return "a damaged file (nested too deeply)"
    if isinstance(error, MemoryError):
        return "a file too large for the memory"
    if isinstance(error, KeyError):
        return f"a damaged file (without {text})"
    return f"a damaged file ({text or type(error).__name__})"


def read_bytes(path: str | Path, most: int = MOST_JSON) -> bytes:
    """Read a regular file of at most `most` bytes. OSError or ValueError for anything else."""
    # Without O_NONBLOCK, opening a named pipe would wait for its writer.
    with open(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as file:
        _check_regular(os.fstat(file.fileno()), most)
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"it has more than the {most:,} bytes that are read")
    return data


def _check_regular(status: os.stat_result, most: int) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise ValueError("it is a folder, device or pipe, not a file")
    if status.st_size > most:
        raise ValueError(f"it has {status.st_size:,} bytes where at most {most:,} are read")


def parse_json(data: bytes | str) -> Any:
    """Parse JSON without NaN and infinity. ValueError for anything else, however deeply it is nested."""
    try:
        return json.loads(data, parse_constant=_not_finite, parse_float=_finite_float)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    except json.JSONDecodeError as error:
        raise ValueError(f"no JSON from line {error.lineno} on") from error


def read_json(path: str | Path, most: int = MOST_JSON) -> Any:
    """Read a JSON file of at most `most` bytes. OSError or ValueError as `read_bytes` and `parse_json`."""
    return parse_json(read_bytes(path, most))


def _not_finite(text: str) -> NoReturn:
    raise ValueError(f"a number in it is {text}")


def _finite_float(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _not_finite(text)


def read_tensors(
    path: str | Path,
    framework: Literal["np", "pt"] = "np",
    most: int = MOST_TENSORS,
    finite: bool = True,
) -> tuple[dict[str, Any], dict[str, str]]:
    """Read the tensors and the metadata of a safetensors file.

    Args:
        path: A regular file of at most `most` bytes.
        framework: "np" gives numpy arrays, "pt" torch tensors.
        finite: Refuse NaN and infinity.

    Raises:
        ValueError, OSError, SafetensorError: It is missing, too large or damaged.
    """
    _check_regular(os.stat(path), most)
    with safe_open(path, framework=framework) as file:
        metadata = dict(file.metadata() or {})
        tensors = {name: file.get_tensor(name) for name in file.keys()}
    for name, tensor in tensors.items() if finite else ():
        good = np.isfinite(tensor) if framework == "np" else tensor.isfinite()
        if not good.all():
            raise ValueError(f"'{name}' has numbers that are not finite")
    return tensors, metadata


def check_arrays(
    arrays: Mapping[str, np.ndarray], expected: Mapping[str, tuple[str, tuple[int | str, ...]]]
) -> dict[str, int]:
    """Check dtypes and shapes of arrays against each other; ValueError where they do not fit.

    Args:
        arrays: By name.
        expected: Of each name, the dtypes that it may have, separated by blanks, and its shape. A letter in a
            shape stands for the same number everywhere.

    Returns:
        The numbers that the letters stand for.
    """
    sizes: dict[str, int] = {}
    for name, (dtypes, shape) in expected.items():
        if name not in arrays:
            raise ValueError(f"'{name}' is missing")
        array = arrays[name]
        if str(array.dtype) not in dtypes.split():
            raise ValueError(f"{name} must be {' or '.join(dtypes.split())}; it is {array.dtype}")
        fits = array.ndim == len(shape) and all(
            size == (sizes.setdefault(want, size) if isinstance(want, str) else want)
            for size, want in zip(array.shape, shape, strict=True)
        )
        if not fits:
            wanted = ", ".join(f"{sizes.get(w, w)}" if isinstance(w, str) else f"{w}" for w in shape)
            raise ValueError(f"{name} must be ({wanted}); it is {tuple(array.shape)}")
    return sizes


def check_indices(name: str, indices: Any, count: int, least: int = 0) -> None:
    """ValueError unless all of an integer array or tensor lie in [least, count)."""
    if 0 in indices.shape:
        return
    low, high = int(indices.min()), int(indices.max())
    if low < least or high >= count:
        raise ValueError(f"{name} must be from {least} to {count - 1}; they are from {low} to {high}")


def number_of(value: Any) -> float | None:
    """A number as a float, whether it is Python's, numpy's or a tensor's of no dimension; None for others."""
    if getattr(value, "shape", None) == () and hasattr(value, "item"):
        value = value.item()
    return float(value) if isinstance(value, Real) and not isinstance(value, bool) else None


def check_number(name: str, value: Any, low: float, high: float) -> float:
    """A number of a file, as a float. ValueError unless it is one in [low, high]."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not low <= value <= high:
        raise ValueError(f"{name} must be a number from {low:g} to {high:g}; it is {str(value)[:40]}")
    return float(value)


def decode(kind: Any, value: Any, name: str = "") -> Any:
    """Build a value of type `kind` from parsed JSON; every part is checked against the annotations.

    Args:
        kind: A dataclass, int, float, str, bool, None, Any, Literal, tuple, dict[str, ...] or a union.
        value: What a JSON parser gave; lists become tuples, numbers stay as they are.
        name: What errors call the value, its type's name by default.

    Raises:
        ValueError: A value has another type, or a field is missing or unknown.
    """
    name = name or getattr(kind, "__name__", "value")
    form, parts = _form(kind)
    wanted = getattr(kind, "__name__", str(kind))
    if form is Any:
        return value
    if form is _Record:
        if isinstance(value, dict):
            of_field, needed = parts
            if not needed <= value.keys() <= of_field.keys():
                odd = sorted((needed - value.keys()) | (value.keys() - of_field.keys()))
                raise ValueError(f"{name} has fields missing or unknown: {', '.join(odd)[:100]}")
            return kind(**{key: decode(of_field[key], item, key) for key, item in value.items()})
        wanted = "an object"
    elif form is Literal:
        if any(type(value) is type(each) and value == each for each in parts):
            return value
        wanted = "one of " + ", ".join(map(str, parts))
    elif form is tuple:
        repeated = Ellipsis in parts
        if isinstance(value, list | tuple) and (repeated or len(value) == len(parts)):
            kinds = parts[:1] * len(value) if repeated else parts
            return tuple([decode(each, item, name) for each, item in zip(kinds, value, strict=True)])
        wanted = "a list" if repeated else f"a list of {len(parts)}"
    elif form is dict:
        if isinstance(value, dict):
            return {key: decode(parts[1], item, key) for key, item in value.items()}
        wanted = "an object"
    elif form is types.UnionType:
        for each in parts:
            with suppress(ValueError):
                return decode(each, value, name)
    elif type(value) is kind or (kind is float and type(value) is int):
        if kind not in (int, float) or -(2**63) <= value < 2**63:
            return value
        wanted = "a number of ordinary size"
    raise ValueError(f"{name} must be {wanted}; it is {json.dumps(value)[:40]}")


class _Record:
    """The form of a dataclass."""


@functools.cache
def _form(kind: Any) -> tuple[Any, Any]:
    """What sort of type this is, and its parts; of a dataclass, its fields' types and the names it needs."""
    if not dataclasses.is_dataclass(kind):
        return get_origin(kind) or kind, get_args(kind)
    hints, fields, missing = get_type_hints(kind), dataclasses.fields(kind), dataclasses.MISSING
    needed = {each.name for each in fields if each.default is each.default_factory is missing}
    return _Record, ({each.name: hints[each.name] for each in fields}, needed)
