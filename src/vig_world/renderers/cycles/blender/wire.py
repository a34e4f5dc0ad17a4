"""Messages between vig and the process that Blender runs in: a JSON header, then arrays as raw bytes.

A message is its header's length (8 bytes, little-endian), the header, and the arrays one after another in the
order in which the header's `arrays` names them with type and shape.
"""

from __future__ import annotations

import io
import json
import struct
from typing import Any, BinaryIO

import numpy as np

Readable = io.RawIOBase | io.BufferedIOBase
_LENGTH = struct.Struct("<Q")


def send(stream: BinaryIO, header: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    """Write one message. Raises BrokenPipeError when the other side has closed the pipe."""
    contiguous = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    listed = [[name, array.dtype.str, array.shape] for name, array in contiguous.items()]
    text = json.dumps({**header, "arrays": listed}).encode()
    stream.write(_LENGTH.pack(len(text)) + text)
    for array in contiguous.values():
        stream.write(array.reshape(-1).view(np.uint8).data)
    stream.flush()


def receive(stream: Readable) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read one message: its header and its arrays. Raises EOFError when the other side has closed."""
    (length,) = _LENGTH.unpack(_exactly(stream, _LENGTH.size))
    header = json.loads(_exactly(stream, length))
    arrays = {}
    for name, kind, shape in header.pop("arrays"):
        dtype = np.dtype(kind)
        count = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
        arrays[name] = np.frombuffer(_exactly(stream, count), dtype).reshape(shape)
    return header, arrays


def _exactly(stream: Readable, count: int) -> bytearray:
    """Read `count` bytes. Raises EOFError when there are no more."""
    data = bytearray(count)
    view, got = memoryview(data), 0
    while got < count:
        read = stream.readinto(view[got:])
        if not read:
            raise EOFError(f"{got} of {count} bytes came")
        got += read
    return data
