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
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NoReturn, get_args, get_origin, get_type_hints

import numpy as np
from safetensors import safe_open

from vig.errors import UserError

MOST_JSON = 16 << 20
"""Bytes of a JSON file, unless its reader knows better."""
MOST_TENSORS = 1 << 30
"""Bytes of a safetensors file."""


@contextmanager
def reading(path: str | Path, expected: str, remedy: str) -> Iterator[None]:
    """Report whatever goes wrong in the block, which reads and checks `path`, as one UserError.

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
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise ValueError("it is a folder, device or pipe, not a file")
        if status.st_size > most:
            raise ValueError(f"it has {status.st_size:,} bytes where at most {most:,} are read")
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"it has more than the {most:,} bytes that are read")
    return data


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
    """Read a safetensors file: its tensors and its metadata.

    Args:
        path: A regular file.
        framework: "np" gives numpy arrays, "pt" torch tensors.
        most: Bytes that the file may have.
        finite: Refuse NaN and infinity.

    Raises:
        ValueError, OSError, SafetensorError: It is missing, too large, damaged, or a number is not finite.
    """
    status = os.stat(path)
    if not stat.S_ISREG(status.st_mode):
        raise ValueError("it is a folder, device or pipe, not a file")
    if status.st_size > most:
        raise ValueError(f"it has {status.st_size:,} bytes where at most {most:,} are read")
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
    """Check dtypes and shapes of arrays against each other.

    Args:
        arrays: By name.
        expected: Of each name, the dtypes that it may have, separated by blanks, and its shape. A letter in a
            shape stands for the same number everywhere.

    Returns:
        The numbers that the letters stand for.

    Raises:
        ValueError: An array is missing, or of another dtype or shape.
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


def check_number(name: str, value: Any, low: float, high: float) -> float:
    """A number of a file, as a float. ValueError unless it is one in [low, high]."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not low <= value <= high:
        raise ValueError(f"{name} must be a number from {low:g} to {high:g}; it is {str(value)[:40]}")
    return float(value)


def inside(folder: str | Path, name: str | Path) -> Path:
    """The path of a file that data name, which must lie in `folder`. ValueError when it does not.

    Absolute names, names with `..` and symbolic links that lead out of the folder are refused.
    """
    named, root = Path(name), os.path.realpath(folder)
    if named.is_absolute() or ".." in named.parts or "\0" in str(name):
        raise ValueError(f"the name '{name}' leads out of its folder")
    if not os.path.realpath(os.path.join(root, named)).startswith(os.path.join(root, "")):
        raise ValueError(f"'{name}' is a link that leads out of its folder")
    return Path(folder) / named


def decode(kind: Any, value: Any) -> Any:
    """Build a value of type `kind` from parsed JSON, every part of the type that annotations say.

    Args:
        kind: A dataclass, int, float, str, bool, None, Any, Literal, tuple, dict[str, ...] or a union.
        value: What a JSON parser gave; lists become tuples, numbers stay as they are.

    Raises:
        ValueError: A value has another type, or a field is missing or unknown.
    """
    return _decoder(kind)(value, getattr(kind, "__name__", "value"))


@functools.cache
def _decoder(kind: Any) -> Callable[[Any, str], Any]:
    """A function of a value and its name that does what `decode` says."""

    def refuse(value: Any, name: str, wanted: str | None = None) -> NoReturn:
        what = wanted or getattr(kind, "__name__", str(kind))
        raise ValueError(f"{name} must be {what}; it is {json.dumps(value)[:40]}")

    if kind is Any:
        return lambda value, _: value
    if dataclasses.is_dataclass(kind):
        hints = get_type_hints(kind)
        parts = {field.name: _decoder(hints[field.name]) for field in dataclasses.fields(kind)}
        needed = {
            field.name
            for field in dataclasses.fields(kind)
            if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        }

        def of_dataclass(value: Any, name: str) -> Any:
            if not isinstance(value, dict):
                refuse(value, name, "an object")
            if not needed <= value.keys() <= parts.keys():
                odd = sorted((needed - value.keys()) | (value.keys() - parts.keys()))
                raise ValueError(f"{name} has fields missing or unknown: {', '.join(odd)[:100]}")
            made: Any = kind
            return made(**{key: parts[key](item, key) for key, item in value.items()})

        return of_dataclass
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Literal:
        allowed = {(type(each), each) for each in arguments}

        def of_literal(value: Any, name: str) -> Any:
            if not isinstance(value, str | int) or (type(value), value) not in allowed:
                refuse(value, name, "one of " + ", ".join(map(str, arguments)))
            return value

        return of_literal
    if origin is tuple:
        each = [_decoder(part) for part in arguments if part is not Ellipsis]
        length = None if Ellipsis in arguments else len(each)

        def of_tuple(value: Any, name: str) -> Any:
            if not isinstance(value, list | tuple) or length not in (None, len(value)):
                refuse(value, name, "a list" if length is None else f"a list of {length}")
            if length is None:
                return tuple([each[0](item, name) for item in value])
            return tuple([part(item, name) for part, item in zip(each, value, strict=True)])

        return of_tuple
    if origin is dict:
        inner = _decoder(arguments[1])

        def of_dict(value: Any, name: str) -> Any:
            if not isinstance(value, dict):
                refuse(value, name, "an object")
            return {key: inner(item, key) for key, item in value.items()}

        return of_dict
    if origin is types.UnionType:
        options = [_decoder(part) for part in arguments]

        def of_union(value: Any, name: str) -> Any:
            for option in options:
                try:
                    return option(value, name)
                except ValueError:
                    continue
            refuse(value, name)

        return of_union
    accepted = {
        int: (int,),
        float: (int, float),
        str: (str,),
        bool: (bool,),
        types.NoneType: (types.NoneType,),
    }[kind]

    def of_scalar(value: Any, name: str) -> Any:
        if type(value) not in accepted:
            refuse(value, name)
        if kind in (int, float) and not -(2**63) <= value < 2**63:
            refuse(value, name, "a number of ordinary size")
        return value

    return of_scalar
