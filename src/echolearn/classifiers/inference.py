"""The function that an ONNX file computes, by onnxruntime alone: no torch, no scikit-learn."""

import os
from collections.abc import Callable

# Telemetry of onnxruntime would keep files in the home folder; it asks when it is imported.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

import numpy as np
import onnxruntime

from echolearn.acoustics.types import Array
from echolearn.classifiers.inputs import parts_of

BLOCK = 1024
"""Rows scored at once."""

POSES = "poses"
"""Name of the axis that inputs have which hold whole walks (`inputs.walks_in`)."""


def open_onnx(data: bytes) -> Callable[[Array], Array]:
    """Return the function that an ONNX file computes, float32 (B, ...) to (B,), on one thread."""
    options = onnxruntime.SessionOptions()
    # One thread: runs beside each other share the cores, and sums keep one order.
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])

    together = POSES in session.get_inputs()[0].shape

    def confidence(x: Array) -> Array:
        """Return the confidences (B,) of inputs (B, ...)."""
        x = np.ascontiguousarray(x, dtype=np.float32)
        found = [np.empty(0)]
        for block in parts_of(x, BLOCK, together=together):
            found += session.run(None, {"x": block}) if len(block) else []
        return np.concatenate(found)

    return confidence
