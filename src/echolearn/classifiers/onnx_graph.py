"""From a captured torch program to an ONNX model, operator by operator.

`torch.onnx.export` translates any program, but it parses its library of 500 operators anew at every
call, which takes longer than fitting most classifiers. Scorers are made of the few operators below,
and each is one or two ONNX nodes:

    program (torch.export) --each node: TRANSLATIONS[its operator]--> nodes, initializers -->
    ModelProto

A program that holds anything else is refused (`Unknown`), and the caller takes the general
exporter. Names are those of the program, so equal programs give equal bytes.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
import onnx
import torch
from onnx import NodeProto, TensorProto, helper, numpy_helper
from torch.export import ExportedProgram
from torch.fx import Node

OPSET = 20
"""The first with Gelu."""

IR_VERSION = 10
"""That of the release which brought this operator set."""

TYPES = {
    torch.float32: TensorProto.FLOAT,
    torch.float64: TensorProto.DOUBLE,
    torch.int64: TensorProto.INT64,
    torch.bool: TensorProto.BOOL,
}

END = 2**63 - 1
"""Where a slice stops that takes all."""


class Unknown(Exception):
    """An operator, an argument or a type that has no translation here."""


class Graph:
    """An ONNX graph that grows; `names` says which value each node of the program has become."""

    def __init__(self) -> None:
        self.nodes: list[NodeProto] = []
        self.constants: list[TensorProto] = []
        self.names: dict[Node, str] = {}

    def add(self, kind: str, inputs: Sequence[str], name: str, **attributes: Any) -> str:
        """Append a node with one output and return its name."""
        self.nodes.append(helper.make_node(kind, inputs, [name], **attributes))
        return name

    def constant(self, value: Any, name: str) -> str:
        """Append an initializer and return its name."""
        self.constants.append(numpy_helper.from_array(np.array(value, order="C"), name))
        return name

    def apply(
        self,
        kind: str,
        node: Node,
        places: Iterable[int],
        more: Mapping[str, Any] = MappingProxyType({}),
        **attributes: Any,
    ) -> str:
        """Append what a program's node becomes: of its arguments at `places`, and `more` whole
        numbers by name.
        """
        inputs = [self.operand(node, place) for place in places]
        inputs += [
            self.constant(np.array(value, dtype=np.int64), f"{node.name}.{key}")
            for key, value in more.items()
        ]
        return self.add(kind, inputs, node.name, **attributes)

    def operand(self, node: Node, place: int) -> str:
        """Return the name of an argument; a number becomes a constant of the type of the first
        argument.
        """
        value, like = node.args[place], tensor_of(node.args[0]).dtype
        if isinstance(value, Node):
            return self.names[value] if tensor_of(value).dtype == like else refuse(self, node)
        if not isinstance(value, int | float) or (
            isinstance(value, float) and not like.is_floating_point
        ):
            return refuse(self, node)
        return self.constant(torch.tensor(value, dtype=like).numpy(), f"{node.name}.{place}")


def translate(program: ExportedProgram) -> onnx.ModelProto:
    """Return the ONNX model of a program from one input "x", first axis free, to one output
    "confidence" (B,).

    Raises:
        Unknown: the program holds something that has no translation here.
    """
    graph, kept = Graph(), stored(program)
    for node in program.graph.nodes:
        if node.op == "placeholder":
            graph.names[node] = (
                graph.constant(kept[node.name].numpy(), node.name)
                if node.name in kept
                else node.name
            )
        elif (
            node.op == "call_function"
            and str(node.target) != "aten._assert_tensor_metadata.default"
        ):
            graph.names[node] = attempt(graph, node)
    [given] = [node for node in graph.names if node.name in program.graph_signature.user_inputs]
    [[result]] = program.graph.output_node().args
    graph.add("Identity", [graph.names[result]], "confidence")
    return model_of(graph, given=given, result=result)


def attempt(graph: Graph, node: Node) -> str:
    """Add the translation of a node and return the name of its value."""
    translation = TRANSLATIONS.get(str(node.target), refuse)
    try:
        return (
            refuse(graph, node)
            if node.kwargs and translation is not zeros
            else translation(graph, node)
        )
    except (KeyError, TypeError, ValueError) as error:  # other arguments or types than expected
        raise Unknown(node.format_node()) from error


def stored(program: ExportedProgram) -> dict[str, torch.Tensor]:
    """Return the tensors that a program carries, by the names of their placeholders."""
    signature = program.graph_signature
    paths = {**signature.inputs_to_parameters, **signature.inputs_to_buffers}
    paths |= signature.inputs_to_lifted_tensor_constants
    tensors = {**program.state_dict, **program.constants}
    return {name: tensors[path].detach() for name, path in paths.items()}


def model_of(graph: Graph, *, given: Node, result: Node) -> onnx.ModelProto:
    """Return a finished graph as a model."""
    x, y = (
        helper.make_tensor_value_info(
            name, TYPES[tensor_of(node).dtype], ["batch", *tensor_of(node).shape[1:]]
        )
        for name, node in (("x", given), ("confidence", result))
    )
    body = helper.make_graph(graph.nodes, "main", [x], [y], graph.constants)
    opset = [helper.make_opsetid("", OPSET)]
    return helper.make_model(
        body, opset_imports=opset, ir_version=IR_VERSION, producer_name="echolearn"
    )


def tensor_of(node: Any) -> torch.Tensor:
    """Return a tensor of the shape and type of a node's value."""
    value: torch.Tensor = node.meta["val"]
    return value


def refuse(_graph: Graph, node: Node) -> str:
    """Give up."""
    raise Unknown(node.format_node())


def arguments(node: Node, *defaults: Any) -> tuple[Any, ...]:
    """Return the arguments of a node after the first; `defaults` stand for those left out."""
    return (*node.args[1:], *defaults[len(node.args) - 1 :])


def same(graph: Graph, node: Node) -> str:
    """Translate what does nothing."""
    return graph.operand(node, 0)


def pointwise(kind: str, graph: Graph, node: Node) -> str:
    """Translate a function of all arguments, entry by entry."""
    return graph.apply(kind, node, range(len(node.args)))


def reduce(kind: str, graph: Graph, node: Node) -> str:
    """Translate a reduction over listed axes."""
    axes, keep = arguments(node, None, False)
    return graph.apply(kind, node, [0], {"axes": axes}, keepdims=int(keep))


def cast(graph: Graph, node: Node) -> str:
    """Translate a change of type."""
    before, after = tensor_of(node.args[0]).dtype, tensor_of(node).dtype
    return same(graph, node) if before == after else graph.apply("Cast", node, [0], to=TYPES[after])


def clamp(graph: Graph, node: Node) -> str:
    """Translate limits, of which the upper may be left out."""
    low, high = arguments(node, None, None)
    if low is None:
        refuse(graph, node)
    return graph.apply("Clip", node, [0, 1] if high is None else [0, 1, 2])


def part(graph: Graph, node: Node) -> str:
    """Translate a slice."""
    axis, start, end, step = arguments(node, 0, None, None, 1)
    start, end = start or 0, END if end is None else end
    if (start, end, step) == (0, END, 1):
        return same(graph, node)
    return graph.apply(
        "Slice", node, [0], {"starts": [start], "ends": [end], "axes": [axis], "steps": [step]}
    )


def select(graph: Graph, node: Node) -> str:
    """Translate one index of an axis."""
    axis, index = arguments(node)
    return graph.apply("Gather", node, [0], {"index": index}, axis=axis)


def embedding(graph: Graph, node: Node) -> str:
    """Translate rows of a table."""
    [rows] = arguments(node)
    return graph.add("Gather", [graph.operand(node, 0), graph.names[rows]], node.name, axis=0)


def gather(graph: Graph, node: Node) -> str:
    """Translate one entry per index along an axis."""
    axis, index = arguments(node)
    return graph.add(
        "GatherElements", [graph.operand(node, 0), graph.names[index]], node.name, axis=axis
    )


def squeeze(graph: Graph, node: Node) -> str:
    """Translate the loss of an axis of length 1."""
    return graph.apply("Squeeze", node, [0], {"axes": [*arguments(node)]})


def flatten(graph: Graph, node: Node) -> str:
    """Translate the merging of all axes."""
    if arguments(node, 0, -1) != (0, -1):
        refuse(graph, node)
    return graph.apply("Reshape", node, [0], {"to": [-1]})


def transpose(graph: Graph, node: Node) -> str:
    """Translate the exchange of two axes."""
    axes = list(range(tensor_of(node).ndim))
    first, second = arguments(node)
    axes[first], axes[second] = axes[second], axes[first]
    return graph.apply("Transpose", node, [0], perm=axes)


def concatenate(graph: Graph, node: Node) -> str:
    """Translate concatenation."""
    (axis,), parts = arguments(node, 0), list(node.all_input_nodes)
    if parts != node.args[0]:
        refuse(graph, node)
    return graph.add("Concat", [graph.names[part] for part in parts], node.name, axis=axis)


def zeros(graph: Graph, node: Node) -> str:
    """Translate zeros of another tensor's shape."""
    shape = graph.add("Shape", [graph.operand(node, 0)], f"{node.name}.shape")
    value = numpy_helper.from_array(torch.zeros(1, dtype=tensor_of(node).dtype).numpy())
    return graph.add("ConstantOfShape", [shape], node.name, value=value)


def linear(graph: Graph, node: Node) -> str:
    """Translate x W' + b for rows x."""
    if len(node.args) != 3 or tensor_of(node.args[0]).ndim != 2:
        refuse(graph, node)
    return graph.apply("Gemm", node, range(3), transB=1)


def convolve(graph: Graph, node: Node) -> str:
    """Translate a convolution along one axis."""
    _, bias, stride, padding, dilation, groups = arguments(node, None, None, [1], [0], [1], 1)
    settings = {
        "strides": stride,
        "pads": [*padding, *padding],
        "dilations": dilation,
        "group": groups,
    }
    return graph.apply("Conv", node, range(2 if bias is None else 3), **settings)


Translation = Callable[[Graph, Node], str]

TRANSLATIONS: dict[str, Translation] = {
    "aten.add.Tensor": partial(pointwise, "Add"),
    "aten.sub.Tensor": partial(pointwise, "Sub"),
    "aten.mul.Tensor": partial(pointwise, "Mul"),
    "aten.div.Tensor": partial(pointwise, "Div"),
    "aten.gt.Tensor": partial(pointwise, "Greater"),
    "aten.gt.Scalar": partial(pointwise, "Greater"),
    "aten.maximum.default": partial(pointwise, "Max"),
    "aten.minimum.default": partial(pointwise, "Min"),
    "aten.matmul.default": partial(pointwise, "MatMul"),
    "aten.exp.default": partial(pointwise, "Exp"),
    "aten.sigmoid.default": partial(pointwise, "Sigmoid"),
    "aten.tanh.default": partial(pointwise, "Tanh"),
    "aten.relu.default": partial(pointwise, "Relu"),
    "aten.gelu.default": partial(pointwise, "Gelu"),
    "aten.sum.dim_IntList": partial(reduce, "ReduceSum"),
    "aten.mean.dim": partial(reduce, "ReduceMean"),
    "aten.amax.default": partial(reduce, "ReduceMax"),
    "aten.to.dtype": cast,
    "aten.clamp.default": clamp,
    "aten.slice.Tensor": part,
    "aten.select.int": select,
    "aten.embedding.default": embedding,
    "aten.gather.default": gather,
    "aten.squeeze.dim": squeeze,
    "aten.flatten.using_ints": flatten,
    "aten.transpose.int": transpose,
    "aten.cat.default": concatenate,
    "aten.zeros_like.default": zeros,
    "aten.linear.default": linear,
    "aten.conv1d.default": convolve,
    "aten.dropout.default": same,
}
