"""Two ONNX files as one: what an earlier filter believes, and the plane that looks at it.

    x -> the earlier filter's columns -> its file -> c -> log c - log (1 - c) -> g
    x, g side by side -> the plane's file -> confidence

The earlier filter may come from a bundle, of which nothing is known but its file. So that is taken
as it is, under names of its own, and the few operators between the two are written by hand.
"""

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from onnx.compose import add_prefix

from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.classifiers.earlier import SUREST, EarlierFilter

EARLIER = "earlier_"
BEHIND = "behind_"


def behind(
    earlier: EarlierFilter, plane: bytes, *, columns: int | None, shape: tuple[int, ...]
) -> bytes:
    """Return one file from inputs to confidence.

    Args:
        earlier: filter whose columns come first among the inputs.
        plane: ONNX file, from columns and the logit (B, K + 1), or the logit alone, to confidence.
        columns: number of the earlier filter's columns; None if it sees a tensor.
        shape: of an input.

    Raises:
        BadValue: the earlier filter's file is of another operator set.
    """
    last = onnx.load_from_string(plane)
    first = onnx.load_from_string(earlier.model)
    sets = [{each.domain: each.version for each in model.opset_import} for model in (first, last)]
    allowed = f"must be {sets[1]}, as echolearn export writes it"
    check(
        sets[0] == sets[1], f"init={earlier.told['name']} operator sets", sets[0], allowed=allowed
    )
    first, last = add_prefix(first, EARLIER), add_prefix(last, BEHIND)
    nodes, constants = _between(columns)
    [begin, *_], end = nodes, nodes[1:]
    graph = helper.make_graph(
        [
            begin,
            *first.graph.node,
            *end,
            *last.graph.node,
            helper.make_node("Identity", [f"{BEHIND}confidence"], ["confidence"]),
        ],
        "adapted",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, ["batch", *shape])],
        [helper.make_tensor_value_info("confidence", TensorProto.DOUBLE, ["batch"])],
        initializer=[*first.graph.initializer, *last.graph.initializer, *constants],
    )
    model = helper.make_model(graph, opset_imports=last.opset_import, producer_name="echolearn")
    model.ir_version = max(first.ir_version, last.ir_version)
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString(deterministic=True))


def _between(columns: int | None) -> tuple[list[onnx.NodeProto], list[onnx.TensorProto]]:
    """Return the operators before and behind the earlier filter, and their constants.

    The first one stands before it.
    """
    constants: dict[str, Array] = {
        "low": np.array(SUREST),
        "high": np.array(1.0 - SUREST),
        "one": np.array(1.0),
        "axis": np.array([1]),
        "columns": np.arange(columns or 0),
    }
    node = helper.make_node
    nodes = [
        node("Gather", ["x", "columns"], [f"{EARLIER}x"], axis=1),
        node("Clip", [f"{EARLIER}confidence", "low", "high"], ["sure"]),
        node("Sub", ["one", "sure"], ["unsure"]),
        node("Log", ["sure"], ["log_sure"]),
        node("Log", ["unsure"], ["log_unsure"]),
        node("Sub", ["log_sure", "log_unsure"], ["difference"]),
        node("Cast", ["difference"], ["single"], to=TensorProto.FLOAT),
        node("Unsqueeze", ["single", "axis"], ["logit"]),
        node("Concat", ["x", "logit"], [f"{BEHIND}x"], axis=1),
    ]
    if columns is None:
        # A tensor goes in whole, and only the logit comes out of it.
        nodes[0] = node("Identity", ["x"], [f"{EARLIER}x"])
        nodes[-1] = node("Identity", ["logit"], [f"{BEHIND}x"])
        del constants["columns"]
    return nodes, [numpy_helper.from_array(value, name) for name, value in constants.items()]
