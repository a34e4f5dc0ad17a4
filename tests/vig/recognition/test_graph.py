"""Graphs of networks: what was written is read again, and nothing else."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import onnxruntime
import pytest

from tests.fuzz.mutations import outcomes
from vig.io.errors import UserError
from vig.recognition.graph import Graph, Node, Tensor
from vig.scene.object_class import PACKAGED

onnx = pytest.importorskip("onnx")

LINEAR = Graph(
    (Tensor("image", ("N", 3)), Tensor("weight", (2, 3)), Tensor("bias", (2,))),
    (Tensor("found", ("N", 2)),),
    (Node("Gemm", ("image", "weight", "bias"), ("found",), (("transB", 1),)),),
)
WEIGHTS = {"weight": np.arange(6, dtype=np.float32).reshape(2, 3), "bias": np.ones(2, np.float32)}
PACKS = sorted(PACKAGED.glob("*/*.onnx"))


def test_what_was_written_is_read() -> None:
    assert Graph.from_bytes(LINEAR.to_bytes()) == LINEAR
    assert len(PACKS) == 6
    for path in PACKS:
        data = path.read_bytes()
        assert Graph.from_bytes(data).to_bytes() == data


def test_onnx_itself_takes_it() -> None:
    for data in (LINEAR.to_bytes(), LINEAR.with_weights(WEIGHTS), *(path.read_bytes() for path in PACKS)):
        onnx.checker.check_model(onnx.load_from_string(data), full_check=True)


def test_a_graph_with_weights_computes() -> None:
    session = onnxruntime.InferenceSession(LINEAR.with_weights(WEIGHTS), providers=["CPUExecutionProvider"])
    image = np.array([[1, 2, 3]], np.float32)
    np.testing.assert_array_equal(session.run(None, {"image": image})[0], image @ WEIGHTS["weight"].T + 1)
    assert [each.name for each in session.get_inputs()] == ["image"]


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"bias": None}, "weights are missing: 'bias'"),
        ({"bias": np.ones(3, np.float32)}, r"'bias' must be \(2,\) float32; it is \(3,\) float32"),
        ({"bias": np.ones(2)}, r"'bias' must be \(2,\) float32; it is \(2,\) float64"),
    ],
)
def test_weights_that_do_not_fit_are_refused(changed: dict[str, np.ndarray | None], why: str) -> None:
    weights = {name: value for name, value in (WEIGHTS | changed).items() if value is not None}
    with pytest.raises(ValueError, match=why):
        LINEAR.with_weights(weights)


def external(model: onnx.ModelProto) -> None:
    tensor = model.graph.initializer.add(name="bias", dims=[2], data_type=1, data_location=1)
    tensor.external_data.add(key="location", value="/etc/passwd")


def constant_from_a_file(model: onnx.ModelProto) -> None:
    tensor = onnx.TensorProto(name="c", dims=[2], data_type=1, data_location=1)
    tensor.external_data.add(key="location", value="../secret")
    model.graph.node.append(onnx.helper.make_node("Constant", [], ["c"], value=tensor))


def function(model: onnx.ModelProto) -> None:
    model.functions.add(name="f", domain="d")


def branch(model: onnx.ModelProto) -> None:
    inner = onnx.helper.make_graph([], "g", [], [])
    model.graph.node.append(
        onnx.helper.make_node("If", ["image"], ["y"], then_branch=inner, else_branch=inner)
    )


def huge_padding(model: onnx.ModelProto) -> None:
    node = onnx.helper.make_node("Conv", ["image", "weight"], ["y"], pads=[1 << 40] * 4)
    model.graph.node.append(node)


def half_precision(model: onnx.ModelProto) -> None:
    model.graph.input[0].type.tensor_type.elem_type = onnx.TensorProto.FLOAT16


def made_twice(model: onnx.ModelProto) -> None:
    model.graph.node.append(model.graph.node[0])


def unknown_value(model: onnx.ModelProto) -> None:
    model.graph.node[0].input[1] = "nothing"


def no_output(model: onnx.ModelProto) -> None:
    model.graph.output[0].name = "nothing"


def later_operators(model: onnx.ModelProto) -> None:
    model.opset_import[0].version = 21


def other_domain(model: onnx.ModelProto) -> None:
    model.graph.node[0].domain = "com.microsoft"


def enlarged(model: onnx.ModelProto) -> None:
    model.graph.node.extend(onnx.helper.make_node("Resize", ["image"], [f"r{i}"]) for i in range(9))


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (external, "holds or names weights"),
        (constant_from_a_file, "an attribute of 'Constant' is neither numbers nor a word"),
        (function, "its model has a field 25"),
        (branch, "the operation 'If'"),
        (huge_padding, "'pads' of 'Conv' has the value 1099511627776"),
        (half_precision, "must be arrays of float32"),
        (made_twice, "it names 'found' twice"),
        (unknown_value, "'nothing' is used before it is there"),
        (no_output, "its output 'nothing' is never made"),
        (later_operators, "not those of ONNX's set 17"),
        (other_domain, "an operation has a field 7"),
        (enlarged, "enlarges maps more often"),
    ],
)
def test_graphs_that_ask_for_more_are_refused(spoil: Callable, why: str) -> None:
    model = onnx.load_from_string(LINEAR.to_bytes())
    spoil(model)
    with pytest.raises(ValueError, match=why):
        Graph.from_bytes(model.SerializeToString())


def test_damaged_graphs_are_read_or_refused() -> None:
    whole, rng = PACKS[0].read_bytes(), np.random.default_rng(0)

    def damaged() -> bytes:
        data = bytearray(whole)
        for _ in range(int(rng.integers(1, 4))):
            data[int(rng.integers(len(data)))] = int(rng.integers(256))
        return bytes(data[: int(rng.integers(len(data)))] if rng.random() < 0.2 else data)

    def read(data: bytes) -> None:
        try:
            Graph.from_bytes(data)
        except (ValueError, UnicodeDecodeError) as error:
            raise UserError(str(error)) from error

    counts = outcomes((damaged() for _ in range(300)), read)
    assert counts.total() == 300 and counts["refused"] > 100
