"""Graphs of networks in ONNX's format without their weights, as class packs hold them.

A file is read by what is written here, not by ONNX Runtime: it sees a model that is put together anew of the
nodes that were read and of the pack's own weights. Nothing in a file can name another file.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

OPSET, IR_VERSION = 17, 8
"""Versions of ONNX's operators and of its format."""
MOST_BYTES, MOST_NODES = 1 << 20, 4000
"""Limits of a file: bytes and operations."""
MOST_RESIZES, MOST_JOINS = 8, 40
"""Limits of a graph: operations that enlarge maps, `Resize` and `Concat`."""
SMALL, LARGE = 16, 1 << 16
"""Bounds of a node's numbers: paddings, strides and factors; sizes."""

Value = float | int | str | tuple[float, ...] | tuple[int, ...]
Size = int | str
"""The length of a dimension: a number, or a letter for one that varies."""

_OPERATORS: dict[str, dict[str, type]] = {
    "Add": {},
    "BatchNormalization": {"epsilon": float},
    "Clip": {},
    "Concat": {"axis": int},
    "Constant": {"value_float": float, "value_floats": float, "value_ints": int},
    "Conv": dict.fromkeys(("dilations", "group", "kernel_shape", "pads", "strides"), int),
    "Flatten": {"axis": int},
    "Gemm": {"transB": int},
    "LayerNormalization": {"axis": int, "epsilon": float},
    "MatMul": {},
    "Mul": {},
    "Relu": {},
    "Reshape": {},
    "Resize": {"coordinate_transformation_mode": str, "mode": str, "nearest_mode": str},
    "Slice": {},
    "Softmax": {"axis": int},
    "Split": {"axis": int},
    "Squeeze": {},
    "Transpose": {"perm": int},
}
"""Operators that a graph may have, and the types of their attributes."""


@dataclass(frozen=True)
class Tensor:
    """Name and shape of a float32 array that enters or leaves a graph."""

    name: str
    shape: tuple[Size, ...]


@dataclass(frozen=True)
class Node:
    """One operation."""

    operator: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    attributes: tuple[tuple[str, Value], ...] = ()


@dataclass(frozen=True)
class Graph:
    """Operations in the order in which they are done.

    Attributes:
        inputs: The image first, then the weights, by the names of a weights file.
        outputs: The results.
        nodes: The operations.
    """

    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]
    nodes: tuple[Node, ...]

    @property
    def weights(self) -> tuple[Tensor, ...]:
        """The inputs that a weights file holds."""
        return self.inputs[1:]

    def to_bytes(self) -> bytes:
        """Write an ONNX file without weights."""
        return _model(self.inputs, self.outputs, self.nodes, ())

    def with_weights(self, weights: Mapping[str, np.ndarray]) -> bytes:
        """Write a whole ONNX model. ValueError where weights are missing, or have other shapes or types."""
        for wanted in self.weights:
            if wanted.name not in weights:
                raise ValueError(f"weights are missing: '{wanted.name[:100]}'")
            held = weights[wanted.name]
            if held.shape != wanted.shape or held.dtype != np.float32:
                raise ValueError(
                    f"'{wanted.name[:100]}' must be {wanted.shape} float32; it is {held.shape} {held.dtype}"
                )
        stored = (_initializer(each.name, weights[each.name]) for each in self.weights)
        return _model(self.inputs[:1], self.outputs, self.nodes, stored)

    @staticmethod
    def from_bytes(data: bytes) -> Graph:
        """Read what `to_bytes` wrote. ValueError for anything else."""
        graph = b""
        for number, value in _fields(data, "model"):
            if number == 7:
                graph += _part(value)
            elif number == 8:
                opset = dict(_fields(_part(value), "set of operators"))
                if opset.keys() - {1, 2} or opset.get(1, b"") != b"" or opset.get(2) != OPSET:
                    raise ValueError(f"its operators are not those of ONNX's set {OPSET}")
            elif number == 1:
                if value != IR_VERSION:
                    raise ValueError(f"it is of ONNX's format {value!r:.20}, where {IR_VERSION} is read")
            elif number not in (2, 3):
                raise ValueError(f"its model has a field {number} that no graph of vig has")
        inputs: list[Tensor] = []
        outputs: list[Tensor] = []
        nodes = []
        for number, value in _fields(graph, "graph"):
            if number == 1:
                nodes.append(_read_node(_part(value)))
            elif number in (11, 12):
                (inputs if number == 11 else outputs).append(_read_tensor(_part(value)))
            elif number in (5, 15):
                raise ValueError("it holds or names weights, which belong into the weights file")
            elif number != 2:
                raise ValueError(f"it has a field {number} that no graph of vig has")
        read = Graph(tuple(inputs), tuple(outputs), tuple(nodes))
        read._check()
        return read

    def _check(self) -> None:
        """ValueError unless each node's inputs come before it. Memory is bounded in `recognizer`."""
        if not self.inputs or not self.outputs or len(self.nodes) > MOST_NODES:
            raise ValueError(f"it has {len(self.inputs)} inputs and {len(self.nodes)} operations")
        known: set[str] = set()
        for name in [each.name for each in self.inputs]:
            _check_new(name, known)
        for node in self.nodes:
            for name in node.inputs:
                if name and name not in known:
                    raise ValueError(f"'{name[:100]}' is used before it is there")
            for name in node.outputs:
                _check_new(name, known)
        for each in self.outputs:
            if each.name not in known:
                raise ValueError(f"its output '{each.name[:100]}' is never made")
        used = [node.operator for node in self.nodes]
        if used.count("Resize") > MOST_RESIZES or used.count("Concat") > MOST_JOINS:
            raise ValueError("it enlarges maps more often than any network of vig")


def _check_new(name: str, known: set[str]) -> None:
    if not name or len(name) > 200 or name in known:
        raise ValueError(f"it names '{name[:100]}' twice or not at all")
    known.add(name)


# -- the wire format of protocol buffers ------------------------------------------------------------------


def _varint(number: int) -> bytes:
    number &= 0xFFFF_FFFF_FFFF_FFFF
    parts = bytearray()
    while number > 0x7F:
        parts.append(number & 0x7F | 0x80)
        number >>= 7
    parts.append(number)
    return bytes(parts)


def _field(number: int, value: int | float | str | bytes | memoryview) -> bytes:
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    if isinstance(value, float):
        return _varint(number << 3 | 5) + struct.pack("<f", value)
    data = value.encode() if isinstance(value, str) else value
    return b"".join((_varint(number << 3 | 2), _varint(len(data)), data))


def _fields(data: bytes, what: str) -> Iterator[tuple[int, int | float | bytes]]:
    """Numbers and values of a message; a fixed 32-bit value as a float."""
    at = 0

    def varint() -> int:
        nonlocal at
        value = 0
        for shift in range(0, 64, 7):
            if at >= len(data):
                break
            byte = data[at]
            at += 1
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
        raise ValueError(f"its {what} is cut off")

    while at < len(data):
        key = varint()
        kind = key & 7
        if kind == 0:
            yield key >> 3, varint()
            continue
        if kind not in (2, 5):
            raise ValueError(f"its {what} is no message of ONNX")
        size = varint() if kind == 2 else 4
        if at + size > len(data):
            raise ValueError(f"its {what} is cut off")
        value = data[at : at + size]
        at += size
        yield key >> 3, value if kind == 2 else struct.unpack("<f", value)[0]


def _part(value: int | float | bytes) -> bytes:
    if not isinstance(value, bytes):
        raise ValueError("a number stands where a message of ONNX should")
    return value


def _text(value: int | float | bytes) -> str:
    return _part(value).decode()


def _signed(number: int) -> int:
    return number - (1 << 64) if number >> 63 else number


# -- what it carries --------------------------------------------------------------------------------------


def _model(
    inputs: Iterable[Tensor], outputs: Iterable[Tensor], nodes: Iterable[Node], stored: Iterable[bytes]
) -> bytes:
    graph = [_field(1, _written_node(node)) for node in nodes]
    graph += [_field(2, "vig"), *(_field(5, each) for each in stored)]
    graph += [_field(11, _written_tensor(each)) for each in inputs]
    graph += [_field(12, _written_tensor(each)) for each in outputs]
    opset = _field(1, "") + _field(2, OPSET)
    return b"".join((_field(1, IR_VERSION), _field(2, "vig"), _field(8, opset), _field(7, b"".join(graph))))


def _initializer(name: str, array: np.ndarray) -> bytes:
    dims = b"".join(_field(1, size) for size in array.shape)
    return b"".join((dims, _field(2, 1), _field(8, name), _field(9, np.ascontiguousarray(array).tobytes())))


def _written_tensor(tensor: Tensor) -> bytes:
    dims = [_field(1, _field(2 if isinstance(size, str) else 1, size)) for size in tensor.shape]
    kind = _field(1, 1) + _field(2, b"".join(dims))
    return _field(1, tensor.name) + _field(2, _field(1, kind))


def _read_tensor(data: bytes) -> Tensor:
    held = dict(_fields(data, "input"))
    kind = dict(_fields(_part(dict(_fields(_part(held.get(2, b"")), "type")).get(1, b"")), "type"))
    if held.keys() != {1, 2} or kind.keys() - {1, 2} or kind.get(1) != 1:
        raise ValueError("its inputs and outputs must be arrays of float32")
    shape: list[Size] = []
    for number, value in _fields(_part(kind.get(2, b"")), "shape"):
        size = list(_fields(_part(value), "shape"))
        if number != 1 or len(size) != 1 or size[0][0] not in (1, 2):
            raise ValueError("the shape of an input or output is none")
        shape.append(size[0][1] if isinstance(size[0][1], int) else _text(size[0][1]))
    return Tensor(_text(held[1]), tuple(shape))


def _written_node(node: Node) -> bytes:
    parts = [_field(1, name) for name in node.inputs] + [_field(2, name) for name in node.outputs]
    # Named after its first output: ONNX Runtime 1.20 fails on graphs whose nodes have no names.
    parts += [_field(3, node.outputs[0]), _field(4, node.operator)]
    for name, value in node.attributes:
        many = value if isinstance(value, tuple) else (value,)
        kind = 1 if isinstance(many[0], float) else 2 if isinstance(many[0], int) else 3
        number = (kind + 1) if not isinstance(value, tuple) else kind + 6
        held = b"".join(_field(number, each) for each in many)
        code = kind if not isinstance(value, tuple) else kind + 5
        parts.append(_field(5, _field(1, name) + held + _field(20, code)))
    return b"".join(parts)


def _read_node(data: bytes) -> Node:
    inputs: list[str] = []
    outputs: list[str] = []
    operator, attributes = "", []
    for number, value in _fields(data, "operation"):
        if number in (1, 2):
            (inputs if number == 1 else outputs).append(_text(value))
        elif number == 4:
            operator = _text(value)
        elif number == 5:
            attributes.append(_part(value))
        elif number != 3:
            raise ValueError(f"an operation has a field {number} that none of vig has")
    if operator not in _OPERATORS:
        raise ValueError(f"it has the operation '{operator[:40]}', which no network of vig has")
    return Node(
        operator, tuple(inputs), tuple(outputs), tuple(_read_attribute(operator, each) for each in attributes)
    )


def _read_attribute(operator: str, data: bytes) -> tuple[str, Value]:
    name, code = "", 0
    values: list[Any] = []
    for number, value in _fields(data, "attribute"):
        if number == 1:
            name = _text(value)
        elif number == 20 and isinstance(value, int):
            code = value
        elif number in (2, 7) and isinstance(value, float):
            values.append(value)
        elif number in (3, 8) and isinstance(value, int):
            values.append(_signed(value))
        elif number == 4:
            values.append(_text(value))
        else:
            raise ValueError(f"an attribute of '{operator}' is neither numbers nor a word")
    kind = {1: float, 2: int, 3: str, 6: float, 7: int}.get(code)
    if kind is None or kind is not _OPERATORS[operator].get(name) or not values:
        raise ValueError(f"'{operator}' has an attribute '{name[:40]}' that no network of vig has")
    most = LARGE if operator == "Constant" or name == "group" else SMALL
    for each in values:
        bound = most if kind is int else SMALL
        if not isinstance(each, kind) or (isinstance(each, int | float) and not abs(each) <= bound):
            raise ValueError(f"'{name}' of '{operator}' has the value {str(each)[:40]}")
    if code < 6 and len(values) > 1:
        raise ValueError(f"'{name}' of '{operator}' has several values")
    return name, tuple(values) if code > 5 else values[0]
