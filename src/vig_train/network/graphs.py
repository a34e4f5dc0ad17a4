"""Graphs of the recognition network in ONNX's format, from its settings.

They do what `vig_train.network.network.RecognitionNetwork` does; weights have the names that they have there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from vig.io.checks import decode, parse_json, read_tensors, reading
from vig.io.files import atomic_write
from vig.recognition.graph import Graph, Node, Size, Tensor, Value
from vig.recognition.network import (
    ATTENTION_HEADS,
    ATTENTION_LAYERS,
    CELLS,
    STRIDES,
    NetworkSettings,
)
from vig.recognition.object_map import NUMBERS
from vig.recognition.recognizer import INPUT, graph_path, window_outputs
from vig.recognition.weights import FORMAT, network_weights, whole_tensors
from vig.scene import IMAGE_SIZE

Shapes = Mapping[str, tuple[int, ...]]


def write_graphs(weights: Path, settings: NetworkSettings, shapes: Shapes) -> None:
    """Write the graphs of a network beside its weights file.

    shapes: Of the network's weights, by name.
    """
    graphs = {"window": window_graph(settings, shapes)}
    if settings.object_map:
        graphs["map"] = map_graph(settings, shapes)
    for which, graph in graphs.items():
        with atomic_write(graph_path(weights, which)) as temporary:
            Path(temporary).write_bytes(graph.to_bytes())


def convert(weights: Path) -> None:
    """Write the graphs of a weights file beside it; UserError when it is none."""
    with reading(weights, "recognition weights", "Name a class pack or a file of `vig train`."):
        tensors, metadata = read_tensors(weights)
        if (kind := metadata.get("net", "vig")) != "vig":
            raise ValueError(f"it is of a network of kind '{kind[:40]}', which has no graph")
        if (version := metadata.get("format", "1")) != FORMAT:
            raise ValueError(f"it is of format {version[:40]}, where this vig reads {FORMAT}")
        settings = decode(NetworkSettings, parse_json(metadata["settings"]))
        own = network_weights(whole_tensors(tensors, metadata))
        write_graphs(weights, settings, {name: value.shape for name, value in own.items()})


def window_graph(settings: NetworkSettings, shapes: Shapes) -> Graph:
    """From images (N, 3, 150, 150) to what `window_outputs` names."""
    writer = _Writer(shapes)
    maps = _trunk(writer, settings)
    half, quarter, eighth, sixteenth, coarse = maps
    features = _dense(writer, settings, coarse)
    for name in ("azimuth", "numbers", "others"):
        writer.linear(features, name, result=name)
    finer = (eighth, quarter, half)
    sides = (19, 38, 75)
    if settings.context:
        merged = _context(writer, settings, (coarse, sixteenth), finer, sides)
    else:
        merged = _plain_decoder(writer, features, coarse, finer, sides)
    writer.convolution(merged, "mask", result="mask")
    outputs = [Tensor(name, ("N", *shape)) for name, shape in window_outputs(settings).items()]
    return writer.graph(("N", 3, IMAGE_SIZE, IMAGE_SIZE), outputs)


def map_graph(settings: NetworkSettings, shapes: Shapes) -> Graph:
    """From an image (1, 3, H, W) to `NUMBERS` of each cell."""
    writer = _Writer(shapes)
    x = writer.concat(_trunk(writer, settings)[-2:])
    for layer in range(7):
        groups = settings.object_map if layer % 2 else 1
        x = writer.block(x, f"object_map.layers.{layer}", groups=groups)
    writer.convolution(x, "object_map.numbers", result="numbers")
    return writer.graph((1, 3, "H", "W"), [Tensor("numbers", (1, NUMBERS, "h", "w"))])


class _Writer:
    """Operations one after the other; a weight that is used becomes an input."""

    def __init__(self, shapes: Shapes):
        self.shapes = shapes
        self.nodes: list[Node] = []
        self.used: dict[str, None] = {}
        self.constants: dict[str, str] = {}

    def graph(self, image: tuple[Size, ...], outputs: Sequence[Tensor]) -> Graph:
        weights = [Tensor(name, tuple(self.shapes[name])) for name in self.used]
        return Graph((Tensor(INPUT, image), *weights), tuple(outputs), tuple(self.nodes))

    def op(self, operator: str, *inputs: str, result: str = "", **attributes: Value) -> str:
        return self.operation(operator, inputs, attributes, result)

    def operation(
        self, operator: str, inputs: tuple[str, ...], attributes: dict[str, Value], result: str = ""
    ) -> str:
        result = result or f"{operator}_{len(self.nodes)}"
        self.nodes.append(Node(operator, inputs, (result,), tuple(attributes.items())))
        return result

    def weight(self, name: str) -> str:
        self.used[name] = None
        return name

    def constant(self, value: Value) -> str:
        key = repr(value)
        if key not in self.constants:
            kind = "value_float"
            if isinstance(value, tuple):
                kind = "value_ints" if isinstance(value[0], int) else "value_floats"
            self.constants[key] = self.operation("Constant", (), {kind: value})
        return self.constants[key]

    def convolution(self, x: str, name: str, stride: int = 1, groups: int = 1, result: str = "") -> str:
        kernel = self.shapes[f"{name}.weight"][2]
        inputs = [x, self.weight(f"{name}.weight")]
        if f"{name}.bias" in self.shapes:
            inputs.append(self.weight(f"{name}.bias"))
        return self.op(
            "Conv",
            *inputs,
            result=result,
            group=groups,
            kernel_shape=(kernel, kernel),
            pads=(kernel // 2,) * 4,
            strides=(stride, stride),
        )

    def normalised(self, x: str, name: str, stride: int = 1, groups: int = 1) -> str:
        """A convolution with normalisation."""
        x = self.convolution(x, f"{name}.0", stride, groups)
        parts = [f"{name}.1.{part}" for part in ("weight", "bias", "running_mean", "running_var")]
        return self.op("BatchNormalization", x, *map(self.weight, parts), epsilon=1e-3)

    def block(self, x: str, name: str, stride: int = 1, groups: int = 1) -> str:
        """A convolution with normalisation and ReLU6."""
        x = self.normalised(x, name, stride, groups)
        return self.op("Clip", x, self.constant(0.0), self.constant(6.0))

    def residual(self, x: str, name: str) -> str:
        """Two convolutions beside the identity."""
        change = self.normalised(self.block(x, f"{name}.first"), f"{name}.second")
        return self.op("Relu", self.op("Add", x, change))

    def linear(self, x: str, name: str, result: str = "") -> str:
        """A linear layer of vectors (N, C)."""
        weight, bias = (self.weight(f"{name}.{part}") for part in ("weight", "bias"))
        return self.op("Gemm", x, weight, bias, result=result, transB=1)

    def linear_of_rows(self, x: str, weight: str, bias: str) -> str:
        """A linear layer of each row of (N, R, C)."""
        turned = self.op("Transpose", self.weight(weight), perm=(1, 0))
        return self.op("Add", self.op("MatMul", x, turned), self.weight(bias))

    def concat(self, parts: Sequence[str]) -> str:
        return self.op("Concat", *parts, axis=1)

    def reshape(self, x: str, *shape: int) -> str:
        """To a shape; 0 keeps a size, one -1 takes what is left."""
        return self.op("Reshape", x, self.constant(shape))

    def doubled(self, x: str, side: int, linear: bool) -> str:
        """A map of twice the size, of which the first `side` rows and columns are kept."""
        places, mode = ("half_pixel", "linear") if linear else ("asymmetric", "nearest")
        how: dict[str, Value] = {"coordinate_transformation_mode": places, "mode": mode}
        if not linear:
            how["nearest_mode"] = "floor"
        x = self.operation("Resize", (x, "", self.constant((1.0, 1.0, 2.0, 2.0))), how)
        return self.op("Slice", x, self.constant((0, 0)), self.constant((side, side)), self.constant((2, 3)))


def _trunk(writer: _Writer, settings: NetworkSettings) -> list[str]:
    """Maps of the trunk's stages."""
    x = writer.op("Mul", INPUT, writer.constant(2.0))
    x = writer.op("Add", x, writer.constant(-1.0))
    x = writer.block(x, "stem", stride=2)
    maps, inputs = [], settings.channels[0]
    for stage, (outputs, count) in enumerate(zip(settings.channels[1:], settings.blocks, strict=True)):
        expansion = settings.expansion if stage else 1
        for number in range(count):
            name, stride = f"stages.{stage}.{number}", STRIDES[stage] if number == 0 else 1
            wide = writer.block(x, f"{name}.expand") if expansion > 1 else x
            wide = writer.block(wide, f"{name}.filter", stride, groups=inputs * expansion)
            projected = writer.normalised(wide, f"{name}.project")
            same = stride == 1 and inputs == outputs
            x, inputs = writer.op("Add", x, projected) if same else projected, outputs
        maps.append(x)
    return maps


def _dense(writer: _Writer, settings: NetworkSettings, coarse: str) -> str:
    """Features (N, D) of the dense layer."""
    x = writer.op("Flatten", writer.block(coarse, "dense.0"), axis=1)
    if settings.members == 1:
        return writer.op("Relu", writer.linear(x, "dense.2"))
    groups, outputs, inputs = settings.members, *writer.shapes["dense.2.weight"]
    weight = writer.reshape(writer.weight("dense.2.weight"), groups, outputs // groups, inputs)
    weight = writer.op("Transpose", weight, perm=(0, 2, 1))
    x = writer.op("Transpose", writer.reshape(x, -1, groups, inputs), perm=(1, 0, 2))
    x = writer.op("Transpose", writer.op("MatMul", x, weight), perm=(1, 0, 2))
    x = writer.op("Add", writer.reshape(x, -1, outputs), writer.weight("dense.2.bias"))
    return writer.op("Relu", x)


def _plain_decoder(
    writer: _Writer, features: str, coarse: str, finer: Sequence[str], sides: Sequence[int]
) -> str:
    recalled = writer.reshape(writer.linear(features, "recalled"), 0, -1, CELLS, CELLS)
    x = writer.concat([coarse, recalled])
    x = writer.block(writer.block(x, "deep.0"), "deep.1")
    for number, (seen, side) in enumerate(zip(finer, sides, strict=True)):
        beside = writer.block(seen, f"side.{number}")
        x = writer.op("Add", writer.doubled(x, side, linear=False), beside)
        x = writer.block(x, f"merge.{number}")
    return x


def _context(
    writer: _Writer,
    settings: NetworkSettings,
    coarse: Sequence[str],
    finer: Sequence[str],
    sides: Sequence[int],
) -> str:
    """`vig_train.network.decoder.ContextDecoder`."""
    x = writer.op("Flatten", writer.block(coarse[0], "context.recall.0"), axis=1)
    x = writer.linear(writer.op("Relu", writer.linear(x, "context.recall.2")), "context.recall.4")
    recalled = writer.reshape(x, 0, -1, CELLS, CELLS)
    x = writer.block(writer.concat([*coarse, recalled]), "context.enter")
    width = settings.context[0]
    rows = writer.op("Transpose", writer.reshape(x, 0, 0, -1), perm=(0, 2, 1))
    rows = writer.op("Add", rows, writer.weight("context.place"))
    for layer in range(ATTENTION_LAYERS):
        rows = _attention(writer, rows, f"context.attention.{layer}", width)
    x = writer.reshape(writer.op("Transpose", rows, perm=(0, 2, 1)), 0, 0, CELLS, CELLS)
    x = writer.residual(x, "context.mix")
    for number, (seen, side) in enumerate(zip(finer, sides, strict=True)):
        x = writer.doubled(writer.block(x, f"context.down.{number}"), side, linear=True)
        x = writer.op("Add", x, writer.block(seen, f"context.side.{number}"))
        x = writer.residual(x, f"context.merge.{number}")
    return x


def _attention(writer: _Writer, rows: str, name: str, width: int) -> str:
    """A layer of a transformer's encoder whose normalisation comes first; rows (N, R, C)."""

    def normalised(number: int) -> str:
        parts = [writer.weight(f"{name}.norm{number}.{part}") for part in ("weight", "bias")]
        return writer.op("LayerNormalization", rows, *parts, axis=-1, epsilon=1e-5)

    seen = writer.linear_of_rows(
        normalised(1), f"{name}.self_attn.in_proj_weight", f"{name}.self_attn.in_proj_bias"
    )
    depth = width // ATTENTION_HEADS
    ends = [writer.constant((place,)) for place in (0, width, 2 * width, 3 * width)]
    axis = writer.constant((2,))
    parts = []
    for begin, end, perm in zip(ends, ends[1:], ((0, 2, 1, 3), (0, 2, 3, 1), (0, 2, 1, 3)), strict=False):
        part = writer.op("Slice", seen, begin, end, axis)
        part = writer.reshape(part, 0, 0, ATTENTION_HEADS, depth)
        parts.append(writer.op("Transpose", part, perm=perm))
    query, key, value = parts
    query = writer.op("Mul", query, writer.constant(1 / math.sqrt(depth)))
    weights = writer.op("Softmax", writer.op("MatMul", query, key), axis=-1)
    mixed = writer.op("Transpose", writer.op("MatMul", weights, value), perm=(0, 2, 1, 3))
    mixed = writer.linear_of_rows(
        writer.reshape(mixed, 0, 0, width),
        f"{name}.self_attn.out_proj.weight",
        f"{name}.self_attn.out_proj.bias",
    )
    rows = writer.op("Add", rows, mixed)
    wide = writer.op(
        "Relu", writer.linear_of_rows(normalised(2), f"{name}.linear1.weight", f"{name}.linear1.bias")
    )
    return writer.op(
        "Add", rows, writer.linear_of_rows(wide, f"{name}.linear2.weight", f"{name}.linear2.bias")
    )
