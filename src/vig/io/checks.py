"""Checks of data that others wrote: files are read whole, bounded and of the right types, or refused.

The functions raise ValueError or OSError with a few plain words; `reading` turns any error of a parser
into the one line (UserError) that a user sees.
"""

import json
import math
import os
import stat
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from numbers import Real
from pathlib import Path
from typing import Any, Literal, NoReturn

import msgspec
import numpy as np
from safetensors import safe_open

from vig.io.errors import UserError
from vig_renderer.checks import check_indices as check_indices

MAX_JSON = 16 << 20  # bytes of a JSON file, unless its reader has another limit
MAX_TABLE = 1 << 30  # bytes of a JSON file with an entry for each of many photos
MAX_TENSORS = 1 << 30  # bytes of a safetensors file

_LEARNING = threading.RLock()  # held where msgspec learns types, as it does not expect two threads there
if hasattr(os, "register_at_fork"):  # a child has no thread that could release it
    os.register_at_fork(
        before=_LEARNING.acquire, after_in_parent=_LEARNING.release, after_in_child=_LEARNING.release
    )


@contextmanager
def reading(path: str | Path, expected: str, remedy: str) -> Iterator[None]:
    """Convert any exception of the block, which reads and checks `path`, to one UserError.

    Args:
        path: The file or folder that is read.
        expected: Expected kind, such as "a calibration".
        remedy: Remedy for the user, a sentence.

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
    if isinstance(error, msgspec.ValidationError):  # well formed, but with other contents
        return f"something else ({text})"
    if isinstance(error, KeyError):
        return f"a damaged file (without {text})"
    return f"a damaged file ({text or type(error).__name__})"


def read_bytes(path: str | Path, most: int = MAX_JSON) -> bytes:
    """Read a regular file of at most `most` bytes. OSError or ValueError for anything else."""
    # Without O_NONBLOCK, opening a named pipe would wait for its writer.
    with open(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as file:
        _check_regular(os.fstat(file.fileno()), most)
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"it has more than the {most:,} bytes that are read")
    return data


def name_stand_in(data: bytes) -> str | None:
    """Return the kind of a file that stands for another, and the remedy, by its first bytes; else None."""
    start = data[:1024].removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    if start.startswith(b"version https://git-lfs"):
        return "a Git LFS pointer; run git lfs pull"
    if start.startswith((b"/annex/objects/", b"../.git/annex/", b".git/annex/")):
        return "a git-annex pointer; run git annex get"
    if start.startswith(b"<"):  # like no mesh and no picture but SVG
        kind = "a web page" if b"html" in start else "an XML document"
        return f"{kind}; download the file itself (GitHub: Raw)"
    return None


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


def read_json(path: str | Path, most: int = MAX_JSON) -> Any:
    """Read a JSON file of at most `most` bytes. OSError or ValueError as `read_bytes` and `parse_json`."""
    return parse_json(read_bytes(path, most))


def _not_finite(text: str) -> NoReturn:
    raise ValueError(f"a number in it is {text}")


def _finite_float(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _not_finite(text)


def read_tensors(
    path: str | Path, framework: Literal["np", "pt"] = "np", most: int = MAX_TENSORS, finite: bool = True
) -> tuple[dict[str, Any], dict[str, str]]:
    """Read the tensors and the metadata of a safetensors file.

    Args:
        path: A regular file of at most `most` bytes.
        framework: "np" gives numpy arrays, "pt" torch tensors.
        finite: Whether to refuse NaN and infinity.

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
        arrays: Arrays by name.
        expected: By name, the dtypes that an array may have, separated by blanks; its shape. A letter in a
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


def number_of(value: Any) -> float | None:
    """Return a number as a float, be it Python's, numpy's or a tensor's of no dimension; None for others."""
    if getattr(value, "shape", None) == () and hasattr(value, "item"):
        value = value.item()
    return float(value) if isinstance(value, Real) and not isinstance(value, bool) else None


def check_number(name: str, value: Any, low: float, high: float) -> float:
    """Return a number of a file, as a float. ValueError unless it is one in [low, high]."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not low <= value <= high:
        raise ValueError(f"{name} must be a number from {low:g} to {high:g}; it is {str(value)[:40]}")
    return float(value)


def decode(kind: Any, value: Any) -> Any:
    """Build a value of type `kind` from parsed JSON; every part is checked against the annotations.

    Args:
        kind: A type for `msgspec.convert`: a dataclass or Struct, int, float, str, bool, None, Any, Literal,
            an enumeration, tuple, dict[str, ...] or a union.
        value: Result of a JSON parser; lists become tuples.

    Raises:
        ValueError: A value has another type, a field is missing or unknown, or a number is 2^63 or more.
    """
    try:
        with _LEARNING:
            decoded = msgspec.convert(value, kind)
            built_in = msgspec.to_builtins(decoded, builtin_types=(tuple,))
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from error
    _check_parts(value, built_in, "$")
    return decoded


def _check_parts(value: Any, decoded: Any, path: str) -> None:
    """Refuse fields that a dataclass did not take, which `msgspec.convert` ignores, and huge numbers."""
    if isinstance(value, dict):
        for name, part in value.items():
            if name not in decoded:
                raise ValueError(f"Object contains unknown field `{name[:40]}` - at `{path}`")
            _check_parts(part, decoded[name], f"{path}.{name[:40]}")
    elif isinstance(value, list | tuple):
        for part, of_part in zip(value, decoded, strict=True):
            _check_parts(part, of_part, f"{path}[...]")
    elif isinstance(value, int | float) and not -(2**63) <= value < 2**63:
        raise ValueError(f"Expected a number of ordinary size, got {str(value)[:40]} - at `{path}`")
