"""Seeded damage to files, and what must come of reading them: a value, or one line for the user."""

import copy
import json
import resource
import signal
import struct
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from vig.io.errors import UserError

SECONDS = 10
"""A mutant may take; the machine that runs this may be busy."""
MAX_MEMORY = 600 << 20
"""Bytes by which the process may grow over all mutants of a test."""

REVIEW_ORDER: list[Any] = [
    None, True, False, 0, -1, 1, 2**31, 2**63, 2**70, -(2**70), 1e308, -1e308, 1e-320, 0.5, "", "x" * 5000,
    "../..", "/dev/zero", "\0", [], {}, [1, 2], [[]], {"a": 1}, [0] * 2000,
]  # fmt: skip
TEXTS = ["[" * 100_000, '{"a":' * 50_000, "NaN", "Infinity", "1e999", "9" * 5000, '"', "", "null", "[]", "{}"]


class TooLong(BaseException):
    """No reader may swallow it."""


def outcomes(mutants: Iterable[Any], read: Callable[[Any], object]) -> Counter[str]:
    """Read all mutants; how many were `accepted` and `refused`.

    Anything but a value or a UserError of one line fails the test, as do a mutant that takes longer than
    SECONDS and memory that grows by more than MAX_MEMORY.
    """

    def ring(*_: object) -> None:
        raise TooLong

    counts: Counter[str] = Counter()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    former = signal.signal(signal.SIGALRM, ring)
    try:
        for mutant in mutants:
            signal.alarm(SECONDS)
            try:
                read(mutant)
                counts["accepted"] += 1
            except UserError as error:
                assert str(error) and "\n" not in str(error) and len(str(error)) < 1000
                counts["refused"] += 1
            finally:
                signal.alarm(0)
    finally:
        signal.signal(signal.SIGALRM, former)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) << 10
    assert grown < MAX_MEMORY, f"reading took {grown >> 20} MiB"
    print(dict(counts))
    return counts


Damage = Callable[[bytes, np.random.Generator], bytes]


def read_damaged(
    path: Path, damage: Damage, read: Callable[[Path], object], count: int, seed: int, refused: int
) -> Counter[str]:
    """Read a file `count` times with other damage each; more than `refused` of them must be refused.

    The file can be read before and is whole again at the end.
    """
    whole, rng = path.read_bytes(), np.random.default_rng(seed)

    def read_mutant(_: int) -> None:
        path.write_bytes(damage(whole, rng))
        read(path)

    read(path)
    counts = outcomes(range(count), read_mutant)
    path.write_bytes(whole)
    assert counts.total() == count and counts["refused"] > refused
    return counts


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """One way in which a file breaks: flipped, cut, spliced, repeated, overwritten or blown up."""
    out, size = bytearray(data), len(data)
    where = int(rng.integers(0, max(size, 1)))
    length = int(rng.integers(1, 64))
    kind = int(rng.integers(0, 8))
    if kind in (0, 1):
        for _ in range(1 if kind else int(rng.integers(2, 30))):
            out[int(rng.integers(0, size))] ^= 1 << int(rng.integers(0, 8))
    elif kind == 2:
        del out[where:]
    elif kind == 3:
        del out[where : where + length]
    elif kind == 4:
        out[where:where] = rng.integers(0, 256, length, np.uint8).tobytes()
    elif kind == 5:
        source = int(rng.integers(0, size))
        out[where : where + length] = data[source : source + length]
    elif kind == 6:
        number = [0, 1, 0xFFFFFFFF, 0x7FFFFFFF, 0x80000000, 1 << 20][int(rng.integers(0, 6))]
        out[where : where + 4] = struct.pack("<I" if rng.random() < 0.5 else ">I", number)
    else:
        out[where:where] = data[where : where + length] * int(rng.integers(2, 300))
    return bytes(out)


def places(tree: Any) -> list[tuple[Any, Any]]:
    """Every container and key in a tree of JSON."""
    found: list[tuple[Any, Any]] = []
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        found += [(tree, key), *places(value)]
    return found


def damaged_json(data: bytes, rng: np.random.Generator) -> bytes:
    """JSON of which a value was swapped for another, lost, renamed or added; now and then broken text."""
    if rng.random() < 0.2:
        return damaged(data, rng)
    tree = copy.deepcopy(json.loads(data))
    spots = places(tree)
    container, key = spots[int(rng.integers(0, len(spots)))]
    kind = int(rng.integers(0, 8))
    if kind == 0:
        del container[key]
    elif kind == 1 and isinstance(container, dict):
        container[str(key) + "x"] = container.pop(key)
    elif kind == 2 and isinstance(container, list):
        container.append(container[key])
    elif kind == 3:
        other, name = spots[int(rng.integers(0, len(spots)))]
        container[key] = copy.deepcopy(other[name])
    elif kind == 4:
        container[key] = "MARK"
        return json.dumps(tree).replace('"MARK"', TEXTS[int(rng.integers(0, len(TEXTS)))]).encode()
    else:
        container[key] = REVIEW_ORDER[int(rng.integers(0, len(REVIEW_ORDER)))]
    return json.dumps(tree).encode()


def damaged_tensors(data: bytes, rng: np.random.Generator) -> bytes:
    """A safetensors file with a damaged header, header values of other types, or numbers out of range."""
    (length,) = struct.unpack("<Q", data[:8])
    header, body = data[8 : 8 + length], data[8 + length :]
    kind = int(rng.integers(0, 4))
    if kind == 0:
        return damaged(data, rng)
    if kind == 1:
        header = damaged_json(header, rng)
    elif kind == 2:  # another type or shape of the same size
        tree = json.loads(header)
        name = [each for each in tree if each != "__metadata__"][int(rng.integers(0, len(tree))) - 1]
        entry = tree[name]
        if rng.random() < 0.5:
            entry["dtype"] = {"F32": "I32", "I32": "F32", "F16": "I16", "I64": "F64"}.get(
                entry["dtype"], "U8"
            )
        else:
            entry["shape"] = [[int(np.prod(entry["shape"]))], entry["shape"][::-1], [*entry["shape"], 1]][
                int(rng.integers(0, 3))
            ]
        header = json.dumps(tree).encode()
    else:
        numbers = np.frombuffer(body[: len(body) // 4 * 4], np.float32).copy()
        where = rng.integers(0, len(numbers), int(rng.integers(1, 10)))
        strange = np.array([np.nan, np.inf, 3e38, -1e-40, 1e9], np.float32)
        whole = np.array([-1, 2**31 - 1, -(2**31), 10**6, 100], np.int32).view(np.float32)
        numbers[where] = rng.choice(np.concatenate([strange, whole]), len(where))
        body = numbers.tobytes() + body[len(body) // 4 * 4 :]
    return struct.pack("<Q", len(header)) + header + body
