"""A policy as an ONNX file: single precision in and out, double precision inside."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.extras import needs

from .layers import Layers

with needs("onnx"):
    import onnx
    import onnxruntime
    from onnx import TensorProto, helper, numpy_helper

OPSET, IR = 17, 8
"""Old enough for every runtime since 2022."""
NAME = "redundant_envs_policy"


def write(layers: Layers, path: Path, about: dict[str, str]) -> None:
    """Write a checked ONNX model with one input for each part of an observation, and ``actions``.

    ``about``: metadata of the model.
    """
    nodes, constants = [], []

    def node(kind: str, inputs: list[str], output: str, **attributes: Any) -> str:
        nodes.append(helper.make_node(kind, inputs, [output], **attributes))
        return output

    def constant(name: str, value: Any) -> str:
        constants.append(numpy_helper.from_array(np.asarray(value, dtype=np.float64), name))
        return name

    x = next(iter(layers.inputs))
    if len(layers.inputs) > 1:
        x = node("Concat", list(layers.inputs), "joined", axis=1)
    x = node("Cast", [x], "double", to=TensorProto.DOUBLE)
    for k, (weights, biases) in enumerate(zip(layers.weights, layers.biases, strict=True)):
        x = node("Gemm", [x, constant(f"weights_{k}", weights), constant(f"biases_{k}", biases)], f"sum_{k}",
                 transB=1)  # fmt: skip
        if k == len(layers.weights) - 1:
            break
        if layers.activation == "silu":
            x = node("Mul", [x, node("Sigmoid", [x], f"gate_{k}")], f"layer_{k}")
        else:
            x = node({"tanh": "Tanh", "relu": "Relu"}[layers.activation], [x], f"layer_{k}")
    if layers.output == "tanh":
        x = node("Tanh", [x], "squashed")
    else:
        x = node("Clip", [x, constant("least", -1.0), constant("most", 1.0)], "squashed")
    node("Cast", [x], "actions", to=TensorProto.FLOAT)

    def port(name: str, width: int) -> Any:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", width])

    graph = helper.make_graph(
        nodes, NAME, [port(name, width) for name, width in layers.inputs.items()],
        [port("actions", len(layers.biases[-1]))], constants,
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR)
    helper.set_model_props(model, about)
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, str(path))


def actions_of(path: Path, inputs: dict[str, int]) -> Any:
    """A function from observations (n, ...) to the actions (n, actions) that ONNX Runtime computes."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])

    def act(observations: Any) -> NDArray[np.float32]:
        parts = observations if isinstance(observations, dict) else {next(iter(inputs)): observations}
        given = {name: np.asarray(parts[name], dtype=np.float32) for name in inputs}
        actions: NDArray[np.float32] = session.run(["actions"], given)[0]
        return actions

    return act
