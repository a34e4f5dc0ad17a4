"""The recognition network as a model in ONNX's format, put together from its settings and weights.

It does what `vig_train.network.network.RecognitionNetwork` does; weights have the names that they have there.
ONNX Runtime gets only models that are written here: no file in ONNX's format is ever read.
"""

import functools
import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from vig.recognition.network import (
    ATTENTION_HEADS,
    ATTENTION_LAYERS,
    CELLS,
    KERNELS,
    MASK_CLASSES,
    MASK_STRIDE,
    STRIDES,
    NetworkSettings,
)
from vig.recognition.object_map import NUMBERS
from vig.scene import IMAGE_SIZE, regressed_layout

OPSET, IR_VERSION = 17, 8
"""Versions of ONNX's operators and of its format."""
INPUT = "image"
"""Name of a model's image: (N, 3, H, W), sRGB in [0, 1]."""

Value = float | int | str | tuple[float, ...] | tuple[int, ...]
Shape = tuple[int | str, ...]
"""Sizes of an array; a letter where one varies."""


def window_outputs(settings: NetworkSettings) -> dict[str, tuple[int, ...]]:
    """Return the outputs of the network for windows, by name, and the shape of each for one window."""
    cells = -(-IMAGE_SIZE // MASK_STRIDE)
    return {
        "azimuth": (settings.azimuth_bins,),
        "numbers": (2 * regressed_layout(settings.modes).size,),
        "others": (2,),
        "mask": (len(MASK_CLASSES), cells, cells),
    }


def weight_shapes(settings: NetworkSettings) -> dict[str, tuple[int, ...]]:
    """Return the shapes of all weights of a network, by name."""
    writers = [_window(settings)] + ([_map(settings)] if settings.object_map else [])
    return {name: shape for writer in writers for name, shape in writer.weights.items()}


def window_model(settings: NetworkSettings, weights: Mapping[str, np.ndarray]) -> bytes:
    """Write the model from windows (N, 3, 150, 150) to the outputs of `window_outputs`."""
    outputs: dict[str, Shape] = {name: ("N", *shape) for name, shape in window_outputs(settings).items()}
    return _window(settings).model(("N", 3, IMAGE_SIZE, IMAGE_SIZE), outputs, weights)


def map_model(settings: NetworkSettings, weights: Mapping[str, np.ndarray]) -> bytes:
    """Write the model from an image (1, 3, H, W) to `NUMBERS` of each cell."""
    return _map(settings).model((1, 3, "H", "W"), {"numbers": (1, NUMBERS, "h", "w")}, weights)


class _Array(NamedTuple):
    """An array (N, C, ...) within a model: its name, and C."""

    name: str
    channels: int


class _Writer:
    """Operations one after the other, and the shapes of the weights that they use."""

    def __init__(self) -> None:
        self.nodes: list[bytes] = []
        self.weights: dict[str, tuple[int, ...]] = {}
        self.constants: dict[str, str] = {}

    def model(self, image: Shape, outputs: Mapping[str, Shape], weights: Mapping[str, np.ndarray]) -> bytes:
        graph: list[bytes | memoryview] = [_field(1, node) for node in self.nodes]
        graph.append(_field(2, "vig"))
        for name in self.weights:
            graph += _initializer(name, weights[name])
        graph += [_field(11, _array(INPUT, image)), *(_field(12, _array(*each)) for each in outputs.items())]
        opset = _field(1, "") + _field(2, OPSET)
        head = _field(1, IR_VERSION) + _field(2, "vig") + _field(8, opset)
        # All is joined once: the weights are megabytes.
        return b"".join((head, *_length_delimited(7, graph)))

    def op(self, operator: str, *inputs: str, result: str = "", **attributes: Value) -> str:
        return self.operation(operator, inputs, attributes, result)

    def operation(
        self, operator: str, inputs: Iterable[str], attributes: Mapping[str, Value], result: str = ""
    ) -> str:
        result = result or f"{operator}_{len(self.nodes)}"
        parts = [*(_field(1, name) for name in inputs), _field(2, result)]
        # Named after its output: ONNX Runtime 1.20 fails on models whose operations have no names.
        parts += [_field(3, result), _field(4, operator)]
        parts += [_field(5, _attribute(*each)) for each in attributes.items()]
        self.nodes.append(b"".join(parts))
        return result

    def weight(self, name: str, *shape: int) -> str:
        self.weights[name] = shape
        return name

    def constant(self, value: Value) -> str:
        key = repr(value)
        if key not in self.constants:
            kind = "value_float"
            if isinstance(value, tuple):
                kind = "value_ints" if isinstance(value[0], int) else "value_floats"
            self.constants[key] = self.operation("Constant", (), {kind: value})
        return self.constants[key]

    def convolution(
        self,
        x: _Array,
        name: str,
        outputs: int,
        kernel: int = 1,
        stride: int = 1,
        groups: int = 1,
        biased: bool = False,
        result: str = "",
    ) -> _Array:
        inputs = [x.name, self.weight(f"{name}.weight", outputs, x.channels // groups, kernel, kernel)]
        if biased:
            inputs.append(self.weight(f"{name}.bias", outputs))
        how: dict[str, Value] = {"group": groups, "kernel_shape": (kernel, kernel)}
        how |= {"pads": (kernel // 2,) * 4, "strides": (stride, stride)}
        return _Array(self.operation("Conv", inputs, how, result), outputs)

    def convolve_and_normalise(
        self, x: _Array, name: str, outputs: int, kernel: int = 1, stride: int = 1, groups: int = 1
    ) -> _Array:
        """Return a convolution with normalisation."""
        x = self.convolution(x, f"{name}.0", outputs, kernel, stride, groups)
        parts = ("weight", "bias", "running_mean", "running_var")
        scales = [self.weight(f"{name}.1.{part}", outputs) for part in parts]
        return _Array(self.op("BatchNormalization", x.name, *scales, epsilon=1e-3), outputs)

    def block(
        self, x: _Array, name: str, outputs: int, kernel: int = 1, stride: int = 1, groups: int = 1
    ) -> _Array:
        """Return a convolution with normalisation and ReLU6."""
        x = self.convolve_and_normalise(x, name, outputs, kernel, stride, groups)
        return _Array(self.op("Clip", x.name, self.constant(0.0), self.constant(6.0)), outputs)

    def residual(self, x: _Array, name: str) -> _Array:
        """Return two convolutions with a skip connection."""
        change = self.block(x, f"{name}.first", x.channels, 3)
        return self.sum(x, self.convolve_and_normalise(change, f"{name}.second", x.channels, 3), "Relu")

    def sum(self, x: _Array, other: _Array, after: str = "") -> _Array:
        total = self.op("Add", x.name, other.name)
        return _Array(self.op(after, total) if after else total, x.channels)

    def linear(self, x: _Array, name: str, outputs: int, result: str = "") -> _Array:
        """Return a linear layer of vectors (N, C)."""
        parts = self.weight(f"{name}.weight", outputs, x.channels), self.weight(f"{name}.bias", outputs)
        return _Array(self.op("Gemm", x.name, *parts, result=result, transB=1), outputs)

    def linear_of_rows(self, x: _Array, name: str, outputs: int, separator: str = ".") -> _Array:
        """Return a linear layer of each row of (N, R, C)."""
        weight = self.weight(f"{name}{separator}weight", outputs, x.channels)
        product = self.op("MatMul", x.name, self.op("Transpose", weight, perm=(1, 0)))
        return _Array(self.op("Add", product, self.weight(f"{name}{separator}bias", outputs)), outputs)

    def concat(self, parts: Sequence[_Array]) -> _Array:
        joined = self.op("Concat", *(part.name for part in parts), axis=1)
        return _Array(joined, sum(part.channels for part in parts))

    def flat(self, x: _Array, size: int) -> _Array:
        """Flatten maps of `size` numbers a channel to vectors."""
        return _Array(self.op("Flatten", x.name, axis=1), size * x.channels)

    def reshape(self, x: str, *shape: int) -> str:
        """Reshape a tensor; 0 keeps a size, one -1 takes the rest."""
        return self.op("Reshape", x, self.constant(shape))

    def cells(self, x: _Array) -> _Array:
        """Return vectors as channels of `CELLS` a side."""
        return _Array(self.reshape(x.name, 0, -1, CELLS, CELLS), x.channels // CELLS**2)

    def upsample(self, x: _Array, side: int, linear: bool) -> _Array:
        """Return a map of twice the size, of which the first `side` rows and columns are kept."""
        places, mode = ("half_pixel", "linear") if linear else ("asymmetric", "nearest")
        how: dict[str, Value] = {"coordinate_transformation_mode": places, "mode": mode}
        if not linear:
            how["nearest_mode"] = "floor"
        large = self.operation("Resize", (x.name, "", self.constant((1.0, 1.0, 2.0, 2.0))), how)
        part = self.constant((0, 0)), self.constant((side, side)), self.constant((2, 3))
        return _Array(self.op("Slice", large, *part), x.channels)


@functools.lru_cache(maxsize=8)
def _window(settings: NetworkSettings) -> _Writer:
    writer = _Writer()
    *finer, sixteenth, coarse = _trunk(writer, settings)
    features = _dense(writer, settings, coarse)
    for name, (outputs, *cells) in window_outputs(settings).items():
        if not cells:
            writer.linear(features, name, outputs, result=name)
    if settings.context:
        merged = _context_decoder(writer, settings, coarse, sixteenth, finer)
    else:
        merged = _plain_decoder(writer, settings, features, coarse, finer)
    writer.convolution(merged, "mask", len(MASK_CLASSES), biased=True, result="mask")
    return writer


@functools.lru_cache(maxsize=8)
def _map(settings: NetworkSettings) -> _Writer:
    writer, width = _Writer(), settings.object_map
    x = writer.concat(_trunk(writer, settings)[-2:])
    for layer in range(7):
        deep = {"kernel": 3, "groups": width} if layer % 2 else {}
        x = writer.block(x, f"object_map.layers.{layer}", width, **deep)
    writer.convolution(x, "object_map.numbers", NUMBERS, biased=True, result="numbers")
    return writer


def _trunk(writer: _Writer, settings: NetworkSettings) -> list[_Array]:
    """Return maps of the trunk's stages, from fine to coarse."""
    doubled = writer.op("Mul", INPUT, writer.constant(2.0))
    x = _Array(writer.op("Add", doubled, writer.constant(-1.0)), 3)
    x = writer.block(x, "stem", settings.channels[0], 3, stride=2)
    maps = []
    for stage, (outputs, count) in enumerate(zip(settings.channels[1:], settings.blocks, strict=True)):
        expansion = settings.expansion if stage else 1
        for number in range(count):
            name, stride = f"stages.{stage}.{number}", STRIDES[stage] if number == 0 else 1
            wide = writer.block(x, f"{name}.expand", x.channels * expansion) if expansion > 1 else x
            width = wide.channels
            wide = writer.block(wide, f"{name}.filter", width, KERNELS[stage], stride, groups=width)
            projected = writer.convolve_and_normalise(wide, f"{name}.project", outputs)
            same = stride == 1 and x.channels == outputs
            x = writer.sum(x, projected) if same else projected
        maps.append(x)
    return maps


def _dense(writer: _Writer, settings: NetworkSettings, coarse: _Array) -> _Array:
    """Return features (N, D) of the dense layer."""
    x = writer.flat(writer.block(coarse, "dense.0", settings.squeezed), CELLS**2)
    groups, outputs = settings.members, settings.features
    if groups == 1:
        return _Array(writer.op("Relu", writer.linear(x, "dense.2", outputs).name), outputs)
    inputs = x.channels // groups
    weight = writer.weight("dense.2.weight", outputs, inputs)
    weight = writer.reshape(weight, groups, outputs // groups, inputs)
    weight = writer.op("Transpose", weight, perm=(0, 2, 1))
    rows = writer.op("Transpose", writer.reshape(x.name, -1, groups, inputs), perm=(1, 0, 2))
    rows = writer.op("Transpose", writer.op("MatMul", rows, weight), perm=(1, 0, 2))
    rows = writer.op("Add", writer.reshape(rows, -1, outputs), writer.weight("dense.2.bias", outputs))
    return _Array(writer.op("Relu", rows), outputs)


def _sides(finer: Sequence[_Array]) -> list[tuple[int, int, _Array]]:
    """Return numbers, sides in pixels and maps, from coarse to fine."""
    sides = [-(-IMAGE_SIZE // 2**halved) for halved in range(len(finer), 0, -1)]
    return list(zip(range(len(finer)), sides, reversed(finer), strict=True))


def _plain_decoder(
    writer: _Writer, settings: NetworkSettings, features: _Array, coarse: _Array, finer: Sequence[_Array]
) -> _Array:
    wide, narrow = settings.decoder, settings.decoder // 2
    recalled = writer.cells(writer.linear(features, "recalled", settings.recalled * CELLS**2))
    x = writer.block(writer.concat([coarse, recalled]), "deep.0", wide)
    x = writer.block(x, "deep.1", wide, 3)
    for number, side, seen in _sides(finer):
        beside = writer.block(seen, f"side.{number}", x.channels)
        x = writer.sum(writer.upsample(x, side, linear=False), beside)
        x = writer.block(x, f"merge.{number}", narrow if number else wide, 3)
    return x


def _context_decoder(
    writer: _Writer, settings: NetworkSettings, coarse: _Array, sixteenth: _Array, finer: Sequence[_Array]
) -> _Array:
    """Write `vig_train.network.decoder.ContextDecoder`."""
    width, *narrower = settings.context
    x = writer.flat(writer.block(coarse, "context.recall.0", settings.squeezed), CELLS**2)
    x = writer.linear(x, "context.recall.2", settings.features)
    x = _Array(writer.op("Relu", x.name), x.channels)
    recalled = writer.cells(writer.linear(x, "context.recall.4", settings.recalled * CELLS**2))
    x = writer.block(writer.concat([coarse, sixteenth, recalled]), "context.enter", width)
    rows = writer.op("Transpose", writer.reshape(x.name, 0, 0, -1), perm=(0, 2, 1))
    place = writer.weight("context.place", 1, CELLS**2, width)
    x = _Array(writer.op("Add", rows, place), width)
    for layer in range(ATTENTION_LAYERS):
        x = _attention(writer, x, f"context.attention.{layer}")
    rows = writer.op("Transpose", x.name, perm=(0, 2, 1))
    x = writer.residual(_Array(writer.reshape(rows, 0, 0, CELLS, CELLS), width), "context.mix")
    for (number, side, seen), outputs in zip(_sides(finer), narrower, strict=True):
        x = writer.upsample(writer.block(x, f"context.down.{number}", outputs), side, linear=True)
        x = writer.sum(x, writer.block(seen, f"context.side.{number}", outputs))
        x = writer.residual(x, f"context.merge.{number}")
    return x


def _attention(writer: _Writer, rows: _Array, name: str) -> _Array:
    """Return a layer of a transformer's encoder whose normalisation comes first; rows (N, R, C)."""
    width = rows.channels

    def normalise_rows(x: _Array, number: int) -> _Array:
        parts = [writer.weight(f"{name}.norm{number}.{part}", width) for part in ("weight", "bias")]
        return _Array(writer.op("LayerNormalization", x.name, *parts, axis=-1, epsilon=1e-5), width)

    seen = writer.linear_of_rows(normalise_rows(rows, 1), f"{name}.self_attn.in_proj", 3 * width, "_")
    depth = width // ATTENTION_HEADS
    ends = [writer.constant((place,)) for place in (0, width, 2 * width, 3 * width)]
    axis = writer.constant((2,))
    parts = []
    for begin, end, perm in zip(ends, ends[1:], ((0, 2, 1, 3), (0, 2, 3, 1), (0, 2, 1, 3)), strict=False):
        part = writer.reshape(writer.op("Slice", seen.name, begin, end, axis), 0, 0, ATTENTION_HEADS, depth)
        parts.append(writer.op("Transpose", part, perm=perm))
    query, key, value = parts
    query = writer.op("Mul", query, writer.constant(1 / math.sqrt(depth)))
    weights = writer.op("Softmax", writer.op("MatMul", query, key), axis=-1)
    mixed = writer.op("Transpose", writer.op("MatMul", weights, value), perm=(0, 2, 1, 3))
    mixed = writer.reshape(mixed, 0, 0, width)
    rows = writer.sum(rows, writer.linear_of_rows(_Array(mixed, width), f"{name}.self_attn.out_proj", width))
    wide = writer.linear_of_rows(normalise_rows(rows, 2), f"{name}.linear1", 2 * width)
    wide = _Array(writer.op("Relu", wide.name), wide.channels)
    return writer.sum(rows, writer.linear_of_rows(wide, f"{name}.linear2", width))


# -- messages of ONNX as protocol buffers write them ------------------------------------------------------


@functools.lru_cache(maxsize=4096)
def _varint(number: int) -> bytes:
    number &= 0xFFFF_FFFF_FFFF_FFFF
    parts = bytearray()
    while number > 0x7F:
        parts.append(number & 0x7F | 0x80)
        number >>= 7
    parts.append(number)
    return bytes(parts)


def _field(number: int, value: float | str | bytes) -> bytes:
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    if isinstance(value, float):
        return _varint(number << 3 | 5) + struct.pack("<f", value)
    data = value.encode() if isinstance(value, str) else value
    return b"".join((_varint(number << 3 | 2), _varint(len(data)), data))


def _length_delimited(number: int, parts: Sequence[bytes | memoryview]) -> list[bytes | memoryview]:
    """Return `_field` of the parts together, which are not copied."""
    size = sum(len(part) for part in parts)
    return [_varint(number << 3 | 2) + _varint(size), *parts]


def _initializer(name: str, array: np.ndarray) -> list[bytes | memoryview]:
    head = [*(_field(1, size) for size in array.shape), _field(2, 1), _field(8, name)]
    numbers = np.ascontiguousarray(array, np.float32).data.cast("B")
    return _length_delimited(5, [*head, *_length_delimited(9, [numbers])])


def _array(name: str, shape: Shape) -> bytes:
    dims = [_field(1, _field(2 if isinstance(size, str) else 1, size)) for size in shape]
    kind = _field(1, 1) + _field(2, b"".join(dims))
    return _field(1, name) + _field(2, _field(1, kind))


def _attribute(name: str, value: Value) -> bytes:
    many = value if isinstance(value, tuple) else (value,)
    kind = 1 if isinstance(many[0], float) else 2 if isinstance(many[0], int) else 3
    several = isinstance(value, tuple)
    held = b"".join(_field(kind + (6 if several else 1), each) for each in many)
    return _field(1, name) + held + _field(20, kind + 5 * several)
